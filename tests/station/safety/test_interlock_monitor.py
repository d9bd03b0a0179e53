"""The monitor over simulated instruments on virtual time: what trips, when, and what does not."""

from __future__ import annotations

import signal
from itertools import pairwise
from typing import Any

import pytest
from interlock_helpers import BOARD, CHAIN, GAUSSMETER, SUPPLY, Watched, bench_with, watched

from station.errors import InputError, InterlockTripped
from station.safety.interlocks.monitor import IDLE_PERIOD_S, REACTS_WITHIN_S

BEGINS_S = 30.0
Entry = dict[str, Any]


def interlock(instrument: str, quantity: str, grace: str = "0 s", **test: Any) -> Entry:
    when = {"instrument": instrument, "quantity": quantity, **test}
    return {"name": f"{quantity}-limit", "when": when, "grace": grace}


def fault(instrument: str, kind: str, **more: Any) -> Entry:
    return {"instrument": instrument, "fault": kind, "at": f"{BEGINS_S:g} s", **more}


CURRENT = interlock(SUPPLY, "current", above="8.2 A", grace="0.4 s")


def tripped(fixture: Watched, until_s: float = BEGINS_S + 60.0) -> InterlockTripped:
    """Wait, as a run does, for the trip that ends it."""
    with pytest.raises(InterlockTripped) as raised:
        while fixture.clock.now() < until_s:
            fixture.clock.sleep(1.0)
    assert fixture.monitor.trip is raised.value
    return raised.value


def start(fixture: Watched) -> None:
    fixture.monitor.check_once()
    fixture.monitor.start()


def test_a_healthy_bench_trips_nothing_at_rest_or_energised() -> None:
    with watched(bench_with()) as fixture:
        start(fixture)
        fixture.instruments[BOARD].start(0.1, 1)
        fixture.energise()
        for _ in range(60):
            fixture.clock.sleep(1.0)
            fixture.instruments[BOARD].drain()
        fixture.instruments[SUPPLY].stop()
        assert fixture.monitor.trip is None


def test_a_supply_that_drives_too_much_trips_once_its_grace_is_over() -> None:
    bench = bench_with([CURRENT], [fault(SUPPLY, "overdrive", factor="4 1")])
    with watched(bench, SUPPLY) as fixture:
        start(fixture)
        fixture.energise(3.0)
        trip = tripped(fixture)
    assert trip.exit_code == 5
    assert isinstance(trip.value, float)
    assert abs(trip.value) > 8.2
    assert (trip.name, trip.limit) == ("current-limit", "above 8.2 A")
    assert f"the interlock current-limit tripped at {trip.time_s:.3f} s: " in str(trip)
    assert f"{SUPPLY} current is {trip.value:.4g} A, above 8.2 A (for 0.4 s)" in str(trip)
    # The sine of 0.1 Hz is beyond the limit within a quarter period of 2.5 s, then come 0.4 s.
    assert BEGINS_S < trip.time_s < BEGINS_S + 4.0


def test_a_level_that_comes_back_within_its_grace_trips_nothing() -> None:
    long_grace = {**CURRENT, "grace": "3 s"}
    bench = bench_with([long_grace], [fault(SUPPLY, "overdrive", factor="4 1")])
    with watched(bench, SUPPLY) as fixture:
        start(fixture)
        fixture.energise(3.0)
        # Each half period of the sine is beyond the limit for 2.6 s.
        fixture.clock.sleep_until(BEGINS_S + 30.0)
        assert fixture.monitor.trip is None


def test_a_current_is_looked_at_every_fifth_of_a_second_only_while_it_flows() -> None:
    with watched(bench_with([CURRENT]), SUPPLY) as fixture:
        start(fixture)
        times = looked_at(fixture, 30.0)
        assert min(gaps(times)) > 0.9 * IDLE_PERIOD_S
        fixture.energise()
        switched_on_s = fixture.clock.now()
        times = looked_at(fixture, 10.0)
        assert times[0] - switched_on_s <= 0.25
        assert max(gaps(times)) == pytest.approx(0.2, abs=0.03)  # the supply takes 25 ms
        fixture.instruments[SUPPLY].stop()
        times = looked_at(fixture, 45.0)[1:]
        assert min(gaps(times)) > 0.9 * IDLE_PERIOD_S


def looked_at(fixture: Watched, seconds: float) -> list[float]:
    """Return when the current was read during a time in which nobody else reads it."""
    times: dict[float, None] = {}
    until_s = fixture.clock.now() + seconds
    while fixture.clock.now() < until_s:
        fixture.clock.sleep(0.05)
        newest = fixture.readings.newest(SUPPLY, "current")
        if newest is not None:
            times[newest.time_s] = None
    return list(times)[1:]


def gaps(times: list[float]) -> list[float]:
    return [later - earlier for earlier, later in pairwise(times)]


@pytest.mark.parametrize("contact", ["e-stop", "door"])
def test_an_open_chain_trips_within_its_second_and_names_the_contact(contact: str) -> None:
    with watched(bench_with(faults=[fault(CHAIN, "chain-open", contact=contact)])) as fixture:
        start(fixture)
        trip = tripped(fixture)
    assert f"interlock_chain chain is open (open: {contact})" in str(trip)
    assert (trip.value, trip.limit) == ("open", "open")
    assert BEGINS_S <= trip.time_s <= BEGINS_S + 1.0


def test_a_chain_that_opens_while_the_bench_is_served_trips_too() -> None:
    with watched(bench_with()) as fixture:
        start(fixture)
        fixture.clock.sleep(10.0)
        fixture.simulation.answer("{instrument: interlock_chain, fault: chain-open, for: 3 s}")
        assert tripped(fixture).time_s <= 10.0 + 1.0 + 0.05


def test_nothing_is_energised_on_a_chain_that_is_open_already() -> None:
    with watched(bench_with(faults=[fault(CHAIN, "chain-open", at="0 s")])) as fixture:
        with pytest.raises(InterlockTripped, match="chain is open"):
            fixture.monitor.check_once()
        assert not any(fixture.simulation.simulation_report()["outputs"].values())


def test_a_gyro_that_becomes_too_warm_trips_at_the_next_look() -> None:
    with watched(bench_with(faults=[fault(BOARD, "overheating", rise="50 K")])) as fixture:
        start(fixture)
        fixture.instruments[BOARD].start(0.1, 1)
        trip = tripped(fixture)
    assert trip.name == "gyro-temperature"
    assert "gyro_acquisition temperature is 7" in str(trip)
    assert "outside -50 degC to 70 degC" in str(trip)
    assert BEGINS_S <= trip.time_s <= BEGINS_S + 11.0


def test_a_board_that_is_stopped_has_no_temperature_and_trips_nothing() -> None:
    limit = interlock(BOARD, "temperature", above="60 degC")
    with watched(bench_with([limit]), BOARD) as fixture:
        start(fixture)
        fixture.clock.sleep(60.0)
        assert fixture.monitor.trip is None


def test_a_board_that_should_give_samples_and_does_not_trips() -> None:
    limit = interlock(BOARD, "temperature", above="60 degC")
    with watched(bench_with([limit], [fault(BOARD, "silent")]), BOARD) as fixture:
        start(fixture)
        fixture.instruments[BOARD].start(0.1, 1)
        assert "temperature cannot be read: gyro_acquisition: looked" in str(tripped(fixture))


FIELD = interlock(GAUSSMETER, "field", above="4 mT", grace="5 s")


def test_a_field_that_is_recorded_is_not_asked_for_again() -> None:
    # Nobody would get an answer to that question.
    mute = fault(GAUSSMETER, "no-reply", command="FETC:DC?", **{"at": "10 s", "for": "10 h"})
    with watched(bench_with([FIELD], [mute]), GAUSSMETER) as fixture:
        start(fixture)
        fixture.instruments[GAUSSMETER].start(1.5)
        for _ in range(60):
            fixture.clock.sleep(1.037)
            fixture.instruments[GAUSSMETER].drain()
        assert fixture.monitor.trip is None
        assert "field cannot be read: gaussmeter: sent 'FETC:DC?'" in str(tripped(fixture, 200.0))


def test_asking_for_the_field_takes_nothing_from_the_record() -> None:
    with watched(bench_with([FIELD]), GAUSSMETER) as fixture:
        meter = fixture.instruments[GAUSSMETER]
        meter.start(1.5)
        start(fixture)
        field_mT = meter.read_quantity("field")
        assert 0.01 < field_mT < 0.1
        fixture.clock.sleep(30.0)
        rows = meter.drain().columns["x_T"]
        assert len(rows) == pytest.approx(300, abs=2)


def test_an_overload_trips_when_it_outlasts_the_grace() -> None:
    short = fault(GAUSSMETER, "overload", **{"for": "3 s"})
    with watched(bench_with([FIELD], [short]), GAUSSMETER) as fixture:
        start(fixture)
        fixture.clock.sleep_until(BEGINS_S + 30.0)
        assert fixture.monitor.trip is None
    with watched(bench_with([FIELD], [fault(GAUSSMETER, "overload")]), GAUSSMETER) as fixture:
        start(fixture)
        trip = tripped(fixture)
    assert "gaussmeter field is beyond the range of the instrument, above 4 mT" in str(trip)
    assert trip.value is None


def test_one_lost_answer_trips_nothing_and_silence_does_after_the_grace() -> None:
    lost = fault(SUPPLY, "no-reply", command="MEAS:CURR?", count=1)
    silent = fault(SUPPLY, "no-reply", command="MEAS:CURR?", **{"at": "60 s", "for": "10 h"})
    with watched(bench_with([CURRENT], [lost, silent]), SUPPLY) as fixture:
        start(fixture)
        fixture.energise()
        fixture.clock.sleep_until(59.0)
        assert fixture.monitor.trip is None
        trip = tripped(fixture, 80.0)
    assert "current cannot be read: coil_supply.x: sent 'MEAS:CURR?': no answer came" in str(trip)
    assert trip.value is None
    # Three tries of half a second each, twice: a first look, and one after the grace.
    assert 60.0 < trip.time_s < 60.0 + 2 * 1.5 + 0.4 + 0.5


def test_a_quantity_that_the_driver_cannot_read_is_a_fault_of_the_bench_file() -> None:
    warm = {"any": [CURRENT["when"], {**CURRENT["when"], "quantity": "temperature"}]}
    warm["any"][1]["above"] = "80 degC"
    bench = bench_with([{**CURRENT, "when": warm}])
    with watched(bench, SUPPLY) as fixture, pytest.raises(InputError) as raised:
        fixture.monitor.check_once()
    assert "does not read 'temperature'; it reads current, voltage, output" in str(raised.value)
    power = interlock("dut_power", "current", above="1 A")
    with watched(bench_with([power]), "dut_power") as fixture, pytest.raises(InputError) as raised:
        fixture.monitor.check_once()
    assert "the driver of dut_power does not read 'current'; it reads none" in str(raised.value)


def test_a_run_that_does_not_react_is_brought_to_rest_by_the_monitor() -> None:
    woken: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: woken.append(number))
    try:
        with watched(bench_with(faults=[fault(CHAIN, "chain-open")])) as fixture:
            start(fixture)
            trip = tripped(fixture)
            assert fixture.made_safe == []
            # The run has lost the error, and goes on.
            fixture.clock.sleep(10.0)
            assert len(fixture.made_safe) == 1
            assert fixture.made_safe[0] == pytest.approx(trip.time_s + REACTS_WITHIN_S)
    finally:
        signal.signal(signal.SIGINT, before)
    assert woken


def test_a_run_that_reacts_is_left_alone() -> None:
    with watched(bench_with(faults=[fault(CHAIN, "chain-open")])) as fixture:
        start(fixture)
        tripped(fixture)
        fixture.monitor.stop()
        fixture.clock.sleep(10.0)
        assert fixture.made_safe == []
        with pytest.raises(InterlockTripped):
            fixture.monitor.raise_trip()


def test_the_same_fault_trips_at_the_same_moment_with_the_same_words() -> None:
    said = set()
    for _ in range(3):
        bench = bench_with(faults=[fault(SUPPLY, "overdrive")])
        with watched(bench) as fixture:
            start(fixture)
            fixture.instruments[BOARD].start(0.1, 1)
            fixture.energise()
            said.add(str(tripped(fixture)))
    assert len(said) == 1


def test_what_never_says_whether_it_is_energised_is_watched_while_anything_is() -> None:
    field = {"instrument": GAUSSMETER, "quantity": "field", "above": "4 mT"}
    with watched(
        bench_with([{"name": "a", "when": field, "period": "0.5 s"}]), SUPPLY, GAUSSMETER
    ) as fixture:
        start(fixture)
        fixture.clock.sleep(5.0)
        before = fixture.readings.newest(GAUSSMETER, "field")
        fixture.energise()
        fixture.clock.sleep(1.0)
        after = fixture.readings.newest(GAUSSMETER, "field")
    assert before is not None and before.time_s < 0.1
    assert after is not None and after.time_s > fixture.clock.now() - 0.6
