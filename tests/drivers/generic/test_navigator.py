"""The navigator on CAN and on RS-422: drivers and simulators, over the wire between them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fixture import EmptyRoom, recorded
from navigator_fixture import (
    KINDS,
    LATENCY_S,
    NAME,
    RESOLUTION_DEG,
    STRETCH,
    Plate,
    navigator,
)

from drivers.generic.navigator import fault_words
from sim_instruments.truth import SimulationError
from station.errors import InputError, InstrumentError
from station.roles import Identity, Navigator, NavigatorStatus
from station.roles.role import role

both = pytest.mark.parametrize("kind", KINDS)


def told(act: Any, *arguments: Any) -> str:
    with pytest.raises(InstrumentError) as raised:
        act(*arguments)
    return str(raised.value)


# Outputs.


@both
def test_it_has_the_verbs_of_its_role_and_says_who_it_is(kind: str) -> None:
    with navigator(kind) as (_, driver):
        assert isinstance(driver, Navigator)
        found = role("navigator")
        assert found is not None and not list(found.missing_verbs(driver))
        assert driver.identify() == Identity("house-made", "FOG navigator", "0", "1.0")


@both
@pytest.mark.parametrize("rate_Hz", [1.0, 2.5, 10.0])
def test_an_output_holds_what_was_true_at_its_instant(kind: str, rate_Hz: float) -> None:
    with navigator(kind) as (fixture, driver):
        fixture.clock.sleep(3.3)
        began_s = fixture.clock.now()
        driver.start(rate_Hz)
        block = recorded(fixture, driver, 30.0)
        # Commands take a look or two of the driver's at its line.
        began_s = block.arrival_time_s[0] - STRETCH / rate_Hz - LATENCY_S
        counter = block.columns["counter"]
        assert counter.dtype == np.uint16
        np.testing.assert_array_equal(counter, np.arange(1, len(block) + 1))
        assert len(block) == pytest.approx(30.0 * rate_Hz, abs=1)
        times_s = began_s + counter / rate_Hz * STRETCH
        np.testing.assert_allclose(block.arrival_time_s, times_s + LATENCY_S, atol=1e-9)
        true = fixture.room.navigator_attitude(times_s)
        names = ("heading_deg", "pitch_deg", "roll_deg")
        for name, values in zip(names, true.T, strict=True):
            read = block.columns[name]
            assert np.abs(read - values).max() <= 0.5001 * RESOLUTION_DEG, name
            np.testing.assert_allclose(read, np.round(read, 4), atol=1e-9)
        warm = fixture.room.gyro_temperature_degC(times_s)
        for axis, values in zip("xyz", warm.T, strict=True):
            read = block.columns[f"temperature_{axis}_degC"]
            np.testing.assert_allclose(read, values, atol=0.00501)
        assert driver.columns["counter"].endswith(f"every {1 / rate_Hz:g} s")


@both
def test_a_coarser_resolution_shows(kind: str) -> None:
    with navigator(kind, resolution="0.01 deg") as (fixture, driver):
        driver.start(10.0)
        heading = recorded(fixture, driver, 60.0).columns["heading_deg"]
        np.testing.assert_allclose(heading, np.round(heading, 2), atol=1e-9)
        assert heading.min() >= 0.0 and heading.max() < 360.0
        assert (np.diff(heading) < 0).any(), "it never passed north"


@both
def test_a_second_start_counts_from_one_and_forgets(kind: str) -> None:
    with navigator(kind) as (fixture, driver):
        driver.start(10.0)
        fixture.clock.sleep(5.0)
        driver.start(5.0)
        counter = recorded(fixture, driver, 4.1).columns["counter"]
        np.testing.assert_array_equal(counter, np.arange(1, 21))


@both
def test_what_came_before_a_stop_is_kept_and_nothing_comes_after(kind: str) -> None:
    with navigator(kind) as (fixture, driver):
        driver.start(2.0)
        fixture.clock.sleep(3.2)
        driver.stop()
        assert len(driver.drain()) == 6
        assert not len(recorded(fixture, driver, 5.0))
        driver.stop()


@both
def test_the_counter_has_sixteen_bits(kind: str) -> None:
    with navigator(kind) as (fixture, driver):
        driver.start(10.0)
        model = fixture.simulator._model
        model._begin_s -= 65_530 * model._interval_s
        model.counter = 65_530
        counter = recorded(fixture, driver, 2.0).columns["counter"]
        assert counter[[0, -1]].tolist() == [65_531, 13]
        assert (np.diff(counter.astype(int)) % 65_536 == 1).all()


@both
def test_looking_ahead_changes_nothing_and_a_change_counts_at_once(kind: str) -> None:
    def outputs(disturbed: bool) -> Any:
        with navigator(kind) as (fixture, driver):
            driver.start(4.0)
            for k in range(20):
                fixture.clock.sleep(1.13)
                if disturbed:
                    fixture.room.version += 1
                if k == 10:
                    fixture.room.turn(3.0)
            return driver.drain()

    quiet, disturbed = outputs(False), outputs(True)
    for name, values in quiet.columns.items():
        np.testing.assert_array_equal(values, disturbed.columns[name])
    step = np.diff(quiet.columns["heading_deg"]) % 360.0
    assert step[0] == pytest.approx(7 / 4, abs=1e-3) and step[-1] == pytest.approx(3 / 4, abs=1e-3)
    changed_s = 11 * 1.13
    late = quiet.arrival_time_s[1:] > changed_s + 2 * 0.26
    np.testing.assert_allclose(step[late], 0.75, atol=1e-3)


@both
@pytest.mark.parametrize("rate_Hz", [0.5, 10.1, 3.33, float("nan")])
def test_a_rate_that_it_does_not_have_is_refused(kind: str, rate_Hz: float) -> None:
    with (
        navigator(kind) as (_, driver),
        pytest.raises(InputError, match=r"1 Hz to 10 Hz in steps of 0\.1 Hz"),
    ):
        driver.start(rate_Hz)


# Alignment and status.


@both
def test_an_alignment_is_told_and_so_is_its_end(kind: str) -> None:
    with navigator(kind) as (fixture, driver):
        assert driver.status() == NavigatorStatus(False, None, ())
        driver.start(1.0)
        driver.align(-39.9012345)
        fixture.clock.sleep(40.0)
        status = driver.status()
        assert not status.aligned
        assert status.aligning_for_s == pytest.approx(40.0, abs=0.2)
        fixture.clock.sleep(65.0)
        assert driver.status() == NavigatorStatus(True, None, ())
        assert fixture.room.latitudes == pytest.approx([-39.9012345], abs=1e-7)
        bits = driver.drain().columns["status"]
        assert set(bits.tolist()) == {1, 2} and (np.diff(bits.astype(int)) <= 0).all()


@both
def test_a_latitude_that_is_none_is_refused(kind: str) -> None:
    with navigator(kind) as (_, driver), pytest.raises(InputError, match="is no latitude"):
        driver.align(90.5)


@both
def test_switched_off_it_says_so_and_does_nothing(kind: str) -> None:
    with navigator(kind, room=Plate(powered=False)) as (_, driver):
        assert driver.identify().serial == "0"
        assert driver.status() == NavigatorStatus(False, None, ("switched off",))
        for act, argument in ((driver.start, 1.0), (driver.align, 40.0)):
            text = told(act, argument)
            assert "it refused with unit_off; switch the device under test on" in text


@both
def test_a_loss_of_power_ends_output_and_alignment(kind: str) -> None:
    with navigator(kind) as (fixture, driver):
        driver.align(40.0)
        driver.start(2.0)
        fixture.clock.sleep(120.0)
        fixture.room.power(False)
        assert driver.drain().columns["status"][-1] == 1
        assert not len(recorded(fixture, driver, 2.0))
        fixture.clock.sleep(2.0)
        text = told(driver.read_quantity, "temperature")
        assert text.startswith(f"{NAME}: looked for the gyros' temperature: no output came for 4")
        fixture.room.power(True)
        assert not len(recorded(fixture, driver, 2.0)), "it went on by itself"
        assert driver.status() == NavigatorStatus(False, None, ())


@both
def test_in_another_world_it_answers_and_is_off(kind: str) -> None:
    with navigator(kind, room=EmptyRoom()) as (_, driver):
        assert driver.identify().model == "FOG navigator"
        assert driver.status().faults == ("switched off",)


def test_an_unknown_fault_bit_is_told_by_its_number() -> None:
    assert fault_words(0x8103) == ("switched off", "status bit 15")
    assert fault_words(0x0003) == ()


@both
@pytest.mark.parametrize(
    ("fault", "word"),
    [("alignment-fails", "alignment failed"), ("gyro-fails", "a gyro failed its own test")],
)
def test_what_it_finds_wrong_with_itself_is_told(kind: str, fault: str, word: str) -> None:
    with navigator(kind, {"fault": fault, "at": "150 s", "for": "50 s"}) as (fixture, driver):
        driver.align(40.0)
        fixture.clock.sleep(140.0)
        assert driver.status() == NavigatorStatus(True, None, ())
        fixture.clock.sleep(20.0)
        assert driver.status() == NavigatorStatus(fault == "gyro-fails", None, (word,))
        fixture.clock.sleep(50.0)
        assert driver.status() == NavigatorStatus(True, None, ())


# The temperature, for interlocks.


@both
def test_the_warmest_gyro_is_looked_at_and_no_output_is_taken(kind: str) -> None:
    with navigator(kind) as (fixture, driver):
        assert driver.read_quantity("temperature") is None
        driver.start(10.0)
        assert driver.read_quantity("temperature") is None
        fixture.clock.sleep(5.0)
        assert driver.read_quantity("temperature") == pytest.approx(20.0, abs=0.01)
        assert fixture.newest("temperature") == pytest.approx(20.0, abs=0.01)
        assert len(driver.drain()) == 49
        driver.stop()
        assert driver.read_quantity("temperature") is None
        with pytest.raises(InputError, match="does not read 'field'"):
            driver.read_quantity("field")


@both
def test_a_frozen_navigator_counts_on(kind: str) -> None:
    with navigator(kind, {"fault": "frozen", "at": "10 s", "for": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        block = recorded(fixture, driver, 20.0)
        assert (np.diff(block.columns["counter"].astype(int)) == 1).all()
        still = np.diff(block.columns["heading_deg"]) == 0.0
        assert still.sum() == pytest.approx(50, abs=1)


@pytest.mark.parametrize(
    ("truth", "says"),
    [({"resolution": "0 deg"}, "resolution must be positive"), ({"latency": "x"}, "latency")],
)
def test_a_truth_that_cannot_be_is_refused(truth: dict[str, str], says: str) -> None:
    with pytest.raises(SimulationError, match=says), navigator("serial", **truth):
        pass
