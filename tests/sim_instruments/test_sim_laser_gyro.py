"""The simulated laser gyro as the board counts it: earth rate, warm-up, sensitivity."""

from __future__ import annotations

import numpy as np
import pytest
from sim_bench import Frames, Line, bench_with, counts, served

from sim_instruments.bench import SimulatedBench
from sim_instruments.kepco.bop import KepcoBop
from sim_instruments.wire.socketcand import HOST_BEGAN_S
from station.clock import Clock

START, COUNTS_1 = 1, 0x121
PULSE_ARCSEC = 0.3


def test_a_gyro_that_is_off_counts_nothing(
    bench: SimulatedBench, board: Frames, clock: Clock
) -> None:
    board.command(START, 1, 100.0)
    clock.sleep(20.0)
    assert not counts(board, bench)[:, 1].any()
    bench.act("dut-power-on")
    clock.sleep(20.0)
    assert abs(counts(board, bench)[-1, 1]) > 100
    bench.act("dut-power-off")
    clock.sleep(1.0)
    stopped = counts(board, bench)[-1, 1]
    clock.sleep(20.0)
    assert abs(counts(board, bench)[-1, 1] - stopped) <= 2


def test_the_mean_rate_is_the_earth_rate_on_the_input_axis_and_the_bias(clock: Clock) -> None:
    quiet = bench_with(
        gyro__warm_up__amplitude="0 deg/h",
        gyro__magnetic_sensitivity=dict.fromkeys(("IA", "NA", "LA"), "0 deg/h/mT"),
        gyro__quadratic_sensitivity_per_mT=dict.fromkeys(("IA", "NA", "LA"), "0 deg/h/mT"),
        gyro__rate_random_walk_in_one_hour="0 deg/h",
    )
    with served(clock, quiet) as bench, Frames(bench, clock) as board:
        bench.act("dut-power-on")
        board.command(START, 1, 1000.0)
        clock.sleep(3600.0)
        rows = counts(board, bench)
        seconds = rows.shape[0] * (1 - 8e-6)
        rate = rows[-1, 1] * PULSE_ARCSEC / seconds
    expected = 15.041067 * np.cos(np.deg2rad(26.9)) * np.cos(np.deg2rad(40.0)) + 0.006
    # White noise of 0.001 deg/sqrt(h) over one hour: 0.001 deg/h.
    assert rate == pytest.approx(expected, abs=0.004)


def test_the_warm_up_decays_with_its_time_constant_and_the_temperature_with_it(
    clock: Clock,
) -> None:
    drifting = bench_with(gyro__warm_up__amplitude="2 deg/h")
    with served(clock, drifting) as bench, Frames(bench, clock) as board:
        bench.act("dut-power-on")
        board.command(START, 1, 1000.0)
        clock.sleep(7200.0)
        rows = counts(board, bench)
    rate = np.diff(rows[:, 1]) * PULSE_ARCSEC
    early, later, late = rate[:120].mean(), rate[720:840].mean(), rate[-600:].mean()
    assert (later - late) / (early - late) == pytest.approx(np.exp(-1), abs=0.03)
    assert rows[0, 2] == pytest.approx(22.0, abs=0.05)
    assert rows[719, 2] == pytest.approx(22.0 + 9.0 * (1 - np.exp(-1)), abs=0.05)


def demodulated(rate: np.ndarray, middle_s: np.ndarray, frequency_Hz: float) -> complex:
    angle = 2 * np.pi * frequency_Hz * middle_s
    drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, rate.size), 3)
    design = np.column_stack([np.cos(angle), np.sin(angle), drift])
    fit, *_ = np.linalg.lstsq(design, rate, rcond=None)
    return complex(fit[0], -fit[1])


@pytest.mark.parametrize(("coil", "axis", "expected"), [("x", 0, 0.45), ("z", 2, -0.3)])
def test_a_sine_field_shows_the_signed_sensitivity(
    clock: Clock, coil: str, axis: int, expected: float
) -> None:
    sensitivity = {"IA": "0.45 deg/h/mT", "NA": "0.2 deg/h/mT", "LA": "-0.3 deg/h/mT"}
    data = bench_with(gyro__magnetic_sensitivity=sensitivity)
    supply_name = f"coil_supply.{coil}"
    with (
        served(clock, data) as bench,
        Frames(bench, clock) as board,
        Line(bench, supply_name, clock) as supply,
    ):
        bench.act("dut-power-on")
        clock.sleep(3600.0)
        supply.ask("FUNC:MODE CURR;:VOLT 30;:CURR:RANG 1;:OUTP ON;*OPC?")
        points = 3.0 * np.sin(2 * np.pi * np.arange(1000) / 1000)
        for first in range(0, 1000, 20):
            part = ",".join(f"{point:.5f}" for point in points[first : first + 20])
            supply.ask(f"LIST:CURR {part};*OPC?")
        supply.ask("LIST:DWEL 0.01;COUN 0;:CURR:MODE LIST;*OPC?")
        drive_s = clock.now() - KepcoBop.command_s
        clock.sleep(5.0)
        board.command(START, 1, 100.0)
        clock.sleep(600.0)
        rows = counts(board, bench)
        end_s = np.array([time_s for number, time_s, _ in board.received if number == COUNTS_1])
        end_s -= HOST_BEGAN_S
        field = 3.0 * 1.0005 * bench._world.gyro_mT_per_A[:, "xyz".index(coil)]
    rate = np.diff(rows[:, 1]) * PULSE_ARCSEC / 0.1
    frequency = 0.1 / (1 + 50e-6)
    line = demodulated(rate, end_s[1:] - 0.05 - drive_s, frequency)
    # The field goes as a sine from the start of the list: its phasor is -j.
    lag = 1 / (1 + 2j * np.pi * frequency * 0.015)
    seen = line / (-1j * lag * np.sinc(0.1 * frequency))
    values = np.array([0.45, 0.2, -0.3])
    assert seen.real / field[axis] == pytest.approx(values @ field / field[axis], abs=0.012)
    assert np.sign(seen.real) == np.sign(expected)
    assert abs(seen.imag) / field[axis] < 0.015
