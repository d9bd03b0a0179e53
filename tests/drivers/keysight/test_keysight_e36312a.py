"""The Keysight E36312A that feeds the device: what it proves, and what it cuts off."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fixture import Fixture, standing
from plan_runs import run_of, shipped_bench, shipped_plan

from drivers.keysight.supply_e36312a import KeysightE36312A
from sim_instruments.keysight.supply_e36312a import KeysightE36312A as SimulatedSupply
from sim_instruments.world import base as world
from station.errors import EXIT_INTERLOCK, InstrumentError
from station.record.folder import RunFolder

TRUTH = {
    "feeds": "2",
    "resistance": "48 ohm",
    "readback_gain_error": "0 %",
    "readback_offset": "0 A",
}
LIMITS = {"current": 0.8, "voltage": 25.0}
SHORTED = {"fault": "device-shorted", "at": "10 s"}


class Room(world.Room):
    """A world with a device that can be switched."""

    def __init__(self) -> None:
        super().__init__()
        self.switched: list[bool] = []

    def power(self, time_s: float, on: bool) -> None:
        self.switched.append(on)


@contextmanager
def power(
    *faults: Any, limits: Any = LIMITS, truth: Any = None, **settings: Any
) -> Iterator[tuple[Fixture, Any]]:
    given = {**TRUTH, **(truth or {})}
    with standing(
        "dut_power", SimulatedSupply, given, Room(), *faults, serial="MY59002391"
    ) as fixture:
        asked = {"channel": 2, "voltage": "24 V", **settings}
        driver = KeysightE36312A(fixture.place(limits, **asked))
        yield fixture, driver
        driver.close()


def test_it_feeds_the_device_and_says_what_it_takes() -> None:
    with power() as (fixture, supply):
        supply.switch_on()
        supply.switch_on()
        assert fixture.room.switched == [True]
        assert supply.read_quantity("output") == "on"
        assert supply.read_quantity("current") == pytest.approx(0.5)
        assert supply.read_quantity("voltage") == pytest.approx(24.0)
        assert supply.pause() == "the device stays on"
        assert not supply.read_safety().safe
        supply.switch_off()
        assert fixture.room.switched == [True, False]
        assert fixture.newest("output") == "off"
        assert supply.read_safety().safe


def test_limits_and_protection_are_in_the_instrument_before_the_output_is_on() -> None:
    with power() as (fixture, supply):
        supply.switch_on()
        sent = [line for line in fixture.sent() if b"?" not in line.split(b";")[0]]
        assert b"OUTP ON,(@2)" in sent[-1]
        for question, answer in (
            ("CURR? (@2)", 0.8),
            ("VOLT:PROT? (@2)", 25.0),
            ("CURR:PROT:STAT? (@2)", 1.0),
            ("CURR:PROT:DEL? (@2)", 0.05),
        ):
            assert float(fixture.at_its_front_panel(question) or "nan") == pytest.approx(answer)


@pytest.mark.parametrize(
    ("limits", "settings", "said"),
    [
        ({"voltage": 25.0}, {}, "it gives no limits.current"),
        ({"current": 0.8}, {}, "it gives no limits.voltage"),
        ({"current": 1.5, "voltage": 25.0}, {}, "output 2 ends at 1 A"),
        ({"current": 0.8, "voltage": 26.0}, {}, "output 2 ends at 25 V"),
        ({"current": 0.8, "voltage": 12.0}, {}, "the bench allows 12 V"),
        (LIMITS, {"channel": 4}, "settings.channel"),
        (LIMITS, {"inrush": "2 s"}, "settings.inrush"),
    ],
)
def test_what_bench_and_output_do_not_allow_is_refused(
    limits: Any, settings: Any, said: str
) -> None:
    with (
        pytest.raises(InstrumentError, match=said),
        power(limits=limits, **settings) as (fixture, _),
    ):
        assert not fixture.sent()


def test_a_device_that_is_shorted_from_the_start_is_cut_off_and_named() -> None:
    with power(truth={"resistance": "2 ohm"}) as (fixture, supply):
        with pytest.raises(InstrumentError, match=r"over-current protection has tripped.*cut off"):
            supply.switch_on()
        assert fixture.at_its_front_panel("OUTP? (@2)") == "0"
        assert fixture.newest("output") == "off"


def test_the_instrument_itself_cuts_a_device_that_takes_too_much_and_the_look_says_so() -> None:
    with power(SHORTED) as (fixture, supply):
        supply.switch_on()
        fixture.clock.sleep(12.0)
        with pytest.raises(InstrumentError, match="over-current protection has tripped"):
            supply.read_quantity("current")
        assert fixture.room.switched[-1] is False


@pytest.mark.parametrize("look", ["current", "voltage", "output"])
def test_where_its_own_limit_does_not_act_one_look_cuts_the_device_off(look: str) -> None:
    with power(SHORTED, truth={"own_limit": False}) as (fixture, supply):
        supply.switch_on()
        assert supply.read_quantity(look) is not None
        fixture.clock.sleep(12.0)
        assert fixture.room.switched == [True]
        with pytest.raises(InstrumentError, match=r"carried 48\.000 A at 24\.000 V"):
            supply.read_quantity(look)
        assert fixture.room.switched == [True, False]
        assert fixture.newest("output") == "off"


def test_a_protection_that_somebody_switches_off_is_noticed_when_it_is_switched_on() -> None:
    with power() as (fixture, supply):
        supply.switch_on()
        fixture.at_its_front_panel("CURR:PROT:STAT OFF,(@2)")
        with pytest.raises(InstrumentError, match="set CURR:PROT:STAT of output 2 to 1"):
            supply.switch_on()


def test_a_tripped_output_is_cleared_by_the_next_switching_on() -> None:
    with power({**SHORTED, "for": "5 s"}) as (fixture, supply):
        supply.switch_on()
        fixture.clock.sleep(12.0)
        with pytest.raises(InstrumentError):
            supply.read_quantity("current")
        fixture.clock.sleep(10.0)
        with pytest.raises(InstrumentError, match="has tripped"):
            supply.read_quantity("output")
        supply.switch_on()
        assert supply.read_quantity("output") == "on"


def test_a_strangers_session_on_the_wire() -> None:
    with power() as (fixture, supply):
        supply.identify()
        line = fixture.at_its_front_panel
        assert line("*IDN?") == "Keysight Technologies,E36312A,MY59002391,2.1.0-1.0.4-1.12"
        line("SOURCE:VOLT 5, (@1)")
        line("SOURce:CURRent:LEVel:IMMediate:AMPlitude 0.5,(@1)")
        line("OUTP ON, (@1)")
        assert line("OUTPUT:STATE? (@1)") == "1"
        assert line("OUTP? (@1:3)") == "1,0,0"
        assert float(line("MEAS:VOLT? (@1)") or "nan") == 5.0
        assert line("VOLT:PROT:TRIP? (@1);:CURR:PROT:TRIP? (@1)") == "0;0"
        for wrong, code in (
            ("VOLT 7,(@1)", -222),
            ("VOLT 7,(@9)", -222),
            ("VOLT 5,2", -108),
            ("VOLT", -109),
            ("VOLT abc,(@1)", -120),
            ("NOSUCH 1", -113),
        ):
            line(wrong)
            assert (line("SYST:ERR?") or "").startswith(str(code)), wrong
        assert line("SYST:ERR?") == '0,"No error"'


def test_a_device_that_shorts_ends_a_whole_run_with_the_device_off(tmp_path: Path) -> None:
    bench = shipped_bench("sim-alternate")
    bench["simulation"]["faults"] = [
        {"instrument": "dut_power", "fault": "device-shorted", "at": "400 s"}
    ]
    plan = shipped_plan("rlg-magnetic-sensitivity")
    outcome = run_of(tmp_path, plan, bench)
    assert outcome.exit_code == EXIT_INTERLOCK, outcome.error
    assert "device-current" in str(outcome.error)
    events = RunFolder(outcome.folder).events
    (safe,) = (one for one in events if one.kind == "safe-state")
    assert all(one["verified"] for one in safe.details["outcomes"])
    (tripped,) = (one for one in events if one.kind == "interlock-tripped")
    assert tripped.details["tripped_s"] - 400.0 < 1.0, "cut in one look"
