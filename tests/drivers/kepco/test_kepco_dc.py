"""A steady current from the supply: how it is reached, how it settles, and what may go wrong."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

import numpy as np
import pytest
import yaml
from places import SIM

from drivers.kepco.bop import KepcoBop
from drivers.kepco.steady_current import moves_one_way, set_point_A
from sim_instruments.bench import SimulatedBench
from sim_instruments.kepco.bop import KepcoBop as SimulatedKepco
from station.clock import VirtualClock
from station.errors import InstrumentError, PauseRefused
from station.instruments.opening import InstrumentPlace
from station.units import parse_as

NAME = "coil_supply.dc"
BENCH: dict[str, Any] = yaml.safe_load(SIM.read_text(encoding="utf-8"))
ENTRY = BENCH["instruments"][NAME]
UNITS = {"current": "A", "voltage": "V", "slew": "A/s", "zero_current": "A"}
LIMITS = {key: parse_as(ENTRY["limits"][key], unit) for key, unit in UNITS.items()}
SLEW = LIMITS["slew"]


class Bench:
    """The supply in its world, seen from both sides."""

    def __init__(
        self, clock: VirtualClock, simulation: SimulatedBench, place: InstrumentPlace
    ) -> None:
        self.clock, self.simulation = clock, simulation
        self.supply = KepcoBop(place)
        self.coil = simulation._world.coil("dc")

    def true_A(self) -> float:
        return float(self.coil.current(np.array([self.clock.now()]))[0])


@contextmanager
def bench(
    *faults: dict[str, Any],
    published: dict[str, Any] | None = None,
    sent: list[str] | None = None,
    settings: dict[str, Any] | None = None,
    coil: dict[str, str] | None = None,
    **limits: float,
) -> Iterator[Bench]:
    data = copy.deepcopy(BENCH)
    data["instruments"] = {NAME: data["instruments"][NAME]}
    data["simulation"]["faults"] = [{"instrument": NAME, **fault} for fault in faults]
    data["simulation"]["dc_coil"] |= coil or {}
    clock = VirtualClock()

    def publish(quantity: str, value: Any, unit: str) -> None:
        if published is not None:
            published[quantity] = value

    def trace(direction: str, message: bytes) -> None:
        if sent is not None and direction == ">":
            sent.append(message.decode("ascii").strip())

    with clock.participant("test"):
        simulation = SimulatedBench(
            data,
            clock,
            "accelerometer-magnetic-sensitivity",
            {"kepco-bop-36-12": SimulatedKepco},
        )
        address = simulation.instruments[NAME]["address"]
        place = InstrumentPlace(
            NAME,
            address,
            clock,
            ENTRY["settings"] if settings is None else settings,
            LIMITS | limits,
            trace=trace,
            publisher=publish,
        )
        here = Bench(clock, simulation, place)
        try:
            here.supply.programme_limits()
            yield here
        finally:
            here.supply.close()
            simulation.close()
            clock.stop()


def test_it_is_switched_on_at_zero_and_says_so() -> None:
    published: dict[str, Any] = {}
    with bench(published=published) as here:
        assert not here.simulation.simulation_report()["outputs"][NAME]
        here.supply.switch_on()
        assert here.simulation.simulation_report()["outputs"][NAME]
        here.clock.sleep(1.0)
        assert abs(here.true_A()) < 1e-3
    assert published["output"] == "on"


@pytest.mark.parametrize("course", [(10.0, -10.0, 0.0), (-3.0, 4.0), (0.5, 0.501, 0.5)])
def test_each_current_of_either_sign_is_there_when_it_returns(course: tuple[float, ...]) -> None:
    published: dict[str, Any] = {}
    with bench(published=published) as here:
        here.supply.switch_on()
        for wanted_A in course:
            here.supply.ramp_to(wanted_A)
            # Within the supply's own gain and offset, and at rest.
            assert here.true_A() == pytest.approx(wanted_A, abs=1e-3 + 3e-4 * abs(wanted_A))
            arrived_A = here.true_A()
            here.clock.sleep(5.0)
            assert here.true_A() == pytest.approx(arrived_A, abs=2e-4)
            assert published["current"] == pytest.approx(wanted_A, abs=0.01)


def test_it_never_changes_faster_than_the_slew_limit_nor_is_it_slow() -> None:
    with bench() as here:
        here.supply.switch_on()
        began_s = here.clock.now()
        here.supply.ramp_to(10.0)
        here.supply.ramp_to(-10.0)
        here.supply.stop()
        ended_s = here.clock.now()
        # The supply's level, which the current follows, in steps of one twentieth of a second.
        times = np.arange(began_s, ended_s, 1e-3)
        levels = here.coil.level(times)
        for later in (50, 200, 1000):
            change = np.abs(levels[later:] - levels[:-later]).max()
            assert change <= SLEW * (1e-3 * later + 0.05) * 1.001
        # The supply takes half as long again to answer as a step lasts.
        assert ended_s - began_s < 1.5 * 40.0 / SLEW + 3.0
        assert here.supply.read_safety().safe


def test_every_step_is_verified_by_the_error_query() -> None:
    sent: list[str] = []
    with bench(sent=sent) as here:
        here.supply.switch_on()
        sent.clear()
        here.supply.ramp_to(2.0)
    steps = [message for message in sent if message.startswith("CURR ")]
    assert len(steps) == 8 and all(message.endswith(";:SYST:ERR?") for message in steps)
    assert steps[-1] == "CURR 2.0000;:SYST:ERR?"


def test_a_switched_on_supply_that_carries_current_is_ramped_to_zero_not_cut() -> None:
    with bench() as here:
        here.supply.switch_on()
        here.supply.ramp_to(8.0)
        here.supply.switch_on()
        assert abs(here.true_A()) < 2e-3
        report = here.simulation.simulation_report()["coils"]["dc"]
        assert report["largest_slew_A_per_s"] * report["time_constant_s"] < SLEW * 0.05 * 1.6


def test_a_ramp_that_is_interrupted_goes_on_to_zero_no_faster() -> None:
    with bench() as here:
        here.supply.switch_on()
        here.supply.ramp_to(8.0)
        sleep_until, sleeps = here.clock.sleep_until, count()

        def interrupted(time_s: float) -> None:
            if next(sleeps) == 10:
                raise KeyboardInterrupt
            sleep_until(time_s)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(here.clock, "sleep_until", interrupted)
            with pytest.raises(KeyboardInterrupt):
                here.supply.ramp_to(-8.0)
        here.supply.make_safe(here.clock.now() + 60.0)
        assert here.supply.read_safety().safe
        report = here.simulation.simulation_report()["coils"]["dc"]
        assert report["largest_slew_A_per_s"] * report["time_constant_s"] < SLEW * 0.05 * 1.6


def test_a_set_point_counts_when_it_comes_twice() -> None:
    answers = iter([1.0, 8.0, 8.0])
    assert set_point_A(lambda question: next(answers)) == 8.0
    assert next(answers, None) is None


def test_a_supply_that_an_earlier_run_left_on_is_not_cut_when_its_limits_are_set() -> None:
    with bench() as here:
        here.supply.switch_on()
        here.supply.ramp_to(8.0)
        here.supply.programme_limits()
        assert here.supply.read_safety().safe
        report = here.simulation.simulation_report()["coils"]["dc"]
        assert report["largest_slew_A_per_s"] * report["time_constant_s"] < SLEW * 0.05 * 1.6


def test_a_slow_coil_is_waited_for() -> None:
    settings = ENTRY["settings"] | {"coil_inductance": "1900 mH"}
    with bench(settings=settings, coil={"inductance": "1900 mH"}) as here:
        here.supply.switch_on()
        here.supply.ramp_to(5.0)
        assert here.true_A() == pytest.approx(5.0, abs=3e-3)


@pytest.mark.parametrize("wanted_A", [11.01, -11.01, 400.0, float("nan")])
def test_a_current_beyond_the_benchs_limit_is_refused_and_nothing_is_sent(wanted_A: float) -> None:
    sent: list[str] = []
    with bench(sent=sent) as here:
        here.supply.switch_on()
        sent.clear()
        with pytest.raises(InstrumentError, match=r"coil_supply\.dc: .*the bench allows 11 A"):
            here.supply.ramp_to(wanted_A)
    assert not sent


def test_an_output_that_is_off_is_named() -> None:
    with bench() as here, pytest.raises(InstrumentError, match="the output is off; switch it on"):
        here.supply.ramp_to(1.0)


def test_a_supply_in_compliance_is_named_in_time() -> None:
    with bench({"fault": "compliance", "voltage": "3.8 V", "at": "0 s"}) as here:
        here.supply.switch_on()
        began_s = here.clock.now()
        with pytest.raises(InstrumentError, match=r"in compliance: 3\.\d+ V .* and 2\.\d+ A flow"):
            here.supply.ramp_to(5.0)
        # The ramp with its answers, two seconds, twenty time constants of 35 ms, and two looks.
        assert here.clock.now() - began_s < 1.5 + 2.0 + 0.75 + 0.25
        here.supply.stop()
        assert here.supply.read_safety().safe


def test_a_frozen_read_back_is_a_set_point_that_is_never_reached() -> None:
    with bench({"fault": "frozen", "at": "1 s"}) as here:
        here.supply.switch_on()
        here.supply.current_A()
        here.clock.sleep_until(1.5)
        with pytest.raises(InstrumentError, match="never reached"):
            here.supply.ramp_to(3.0)
        # And what it reads back does not decide from where it comes down.
        assert here.true_A() == pytest.approx(3.0, abs=0.01)
        here.supply.stop()
        here.clock.sleep(0.5)
        assert abs(here.true_A()) < 1e-3
        report = here.simulation.simulation_report()["coils"]["dc"]
        assert report["largest_slew_A_per_s"] * report["time_constant_s"] < SLEW * 0.05 * 1.6


def test_an_output_that_goes_off_on_the_way_is_named() -> None:
    with bench() as here:
        here.supply.switch_on()
        here.supply.ramp_to(6.0)
        output = here.simulation._served[NAME]._output
        output.protections["CURR", "POS"] = 7.0
        with pytest.raises(InstrumentError, match=r"the output went off, 0\.00\d A flow"):
            here.supply.ramp_to(8.0)


def test_it_is_a_refusal_of_the_supply_that_ends_a_ramp() -> None:
    with bench() as here:
        here.supply.switch_on()
        here.simulation._served[NAME]._output.limits["CURR", "POS"] = 1.0
        with pytest.raises(InstrumentError, match="-222"):
            here.supply.ramp_to(3.0)


def test_an_approach_moves_one_way_and_noise_does_not() -> None:
    assert moves_one_way([1.0, 1.1, 1.15, 1.17])
    assert moves_one_way([1.0, 0.9, 0.85, 0.84])
    assert not moves_one_way([1.0, 1.1, 1.05, 1.07])
    assert not moves_one_way([1.0, 1.0, 1.0, 1.0])


def test_a_pause_holds_zero_current_and_is_refused_while_a_sine_runs() -> None:
    with bench() as here:
        here.supply.programme_limits()
        here.supply.switch_on()
        here.supply.ramp_to(4.0)
        assert here.supply.pause().startswith("output on")
        assert abs(here.true_A()) < 2e-3
        here.supply.ramp_to(1.0)
        assert here.true_A() == pytest.approx(1.0, abs=5e-3)
        here.supply.stop()
        here.supply.load_sine(0.1, 2.0)
        here.supply.start_sine()
        with pytest.raises(PauseRefused, match="not at rest: output on, list running"):
            here.supply.pause()
