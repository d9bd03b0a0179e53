"""One shot at the simulated cell, through the real drivers of the shipped bench."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
import yaml
from places import SIM
from scipy.optimize import curve_fit

from sim_instruments.bench import SimulatedBench
from station import registry
from station.clock import VirtualClock
from station.instruments.bench import read_bench
from station.instruments.opening import InstrumentPlace

NAMES = ("signal_generator.xy", "signal_generator.z_gradient", "digitizer", "pump_laser")
GAMMA_HZ_PER_NT = 28.02495


@contextmanager
def opened() -> Iterator[tuple[VirtualClock, dict[str, Any]]]:
    """Serve the instruments of the cell in its world and open them."""
    bench = read_bench(SIM, registry.names(registry.DRIVERS))
    data = yaml.safe_load(SIM.read_text(encoding="utf-8"))
    data["instruments"] = {name: data["instruments"][name] for name in NAMES}
    data["simulation"]["serf"]["gyro_was_running"] = False
    clock, drivers = VirtualClock(), {}
    with clock.participant("test"):
        simulation = SimulatedBench(data, clock, "serf-nonorthogonality")
        try:
            simulation.make_ready()
            for name in NAMES:
                entry = bench.instruments[name]
                address = str(simulation.instruments[name]["address"])
                place = InstrumentPlace(
                    name, address, clock, entry.settings, entry.limits, None, None
                )
                drivers[name] = registry.load(registry.DRIVERS, entry.driver)(place)
            yield clock, drivers
        finally:
            for driver in drivers.values():
                driver.close()
            simulation.close()
            clock.stop()


def test_a_shot_through_generators_shutter_and_digitizer_is_a_decaying_precession() -> None:
    with opened() as (clock, drivers):
        for name in NAMES[:2]:
            drivers[name].programme_limits()
            for channel in (1, 2):
                drivers[name].hold(channel, 0.0)
        pump, digitizer = drivers["pump_laser"], drivers["digitizer"]
        pump.open_shutter()
        clock.sleep(1.0)
        pump.follow_trigger()
        drivers["signal_generator.xy"].prepare_step(1, 2.5, 0.2)
        rate_Hz = digitizer.prepare(10_000.0, 0.12, 1.0)
        clock.sleep(1.0)
        digitizer.fire()
        block = None
        for _ in range(200):
            clock.sleep(0.01)
            block = digitizer.fetch()
            if block is not None:
                break
        assert block is not None
        digitizer.release()
        clock.sleep(0.5)
        assert pump.is_open()
        time_s, volts = block.columns["time_s"], block.columns["voltage_V"]
    assert rate_Hz >= 10_000.0
    before, record = volts[time_s < 0], time_s > pump.trigger_to_dark_s + 1e-3
    assert np.ptp(before) < 0.1
    # The field that the cell feels: the coil and what the shield lets in.
    field_nT = np.hypot(50.0 * 0.994 * 1.0005 + 1.2, 1.25)
    frequency_Hz, decay_per_s, swing_V = best_fit(time_s[record], volts[record])
    assert frequency_Hz == pytest.approx(GAMMA_HZ_PER_NT * field_nT / 6.0, rel=3e-3)
    assert 40.0 < decay_per_s < 60.0
    # The residual field has tilted the spins before, and they fade until the light is off.
    bx, by, bz = 2 * np.pi * GAMMA_HZ_PER_NT * np.array([1.2, -0.9, 0.95])
    turn = np.array([[0.0, -bz, by], [bz, 0.0, -bx], [-by, bx, 0.0]])
    spins = np.linalg.solve(267.0 * np.eye(3) - turn, [0.0, 0.0, 27.0])
    first_V = 8.0 * np.hypot(spins[1], spins[2])
    assert swing_V == pytest.approx(first_V * np.exp(-0.0094 * decay_per_s), rel=0.05)


def best_fit(time_s: np.ndarray, volts: np.ndarray) -> tuple[float, float, float]:
    """Return frequency in Hz, decay in 1/s and first swing in V of one decaying tone."""
    t = time_s - time_s[0]

    def tone(t: np.ndarray, f: float, decay: float, a: float, b: float, c: float) -> np.ndarray:
        turn = 2 * np.pi * f * t
        return np.exp(-decay * t) * (a * np.cos(turn) + b * np.sin(turn)) + c

    starts = [(235.0, 45.0, *ab, 0.0) for ab in ((0.5, 0.0), (0.0, 0.5), (-0.5, 0.0), (0.0, -0.5))]
    fits = [curve_fit(tone, t, volts, start, maxfev=5000)[0] for start in starts]
    f, decay, a, b, _ = min(fits, key=lambda fit: np.sum((tone(t, *fit) - volts) ** 2))
    return float(f), float(decay), float(np.hypot(a, b))
