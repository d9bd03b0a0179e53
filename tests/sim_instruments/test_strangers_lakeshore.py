"""Two gaussmeters: what other programs send them, and what their drivers leave behind."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from variants import variant

from sim_instruments.lakeshore.gaussmeter_425 import Alarm

PROCEDURE = "rlg-magnetic-sensitivity"
F71, MODEL_425 = ("gaussmeter", PROCEDURE, "sim"), ("gaussmeter", PROCEDURE, "sim-alternate")


@pytest.mark.parametrize(
    ("algebraic", "inside", "states"),
    [
        (False, False, {-3.0: 2, -1.5: 0, 0.5: 1, 1.5: 0, 3.0: 2}),
        (True, False, {-3.0: 1, -1.5: 1, 0.5: 1, 1.5: 0, 3.0: 2}),
        (False, True, {-3.0: 0, -1.5: 3, 0.5: 0, 1.5: 3}),
        (True, True, {-1.5: 0, 1.5: 3}),
    ],
)
def test_an_alarm_compares_magnitude_or_sign_outside_or_inside(
    algebraic: bool, inside: bool, states: dict[float, int]
) -> None:
    alarm = Alarm(on=True, algebraic=algebraic, low_mT=1.0, high_mT=2.0, inside=inside)
    assert {field: alarm.state(field) for field in states} == states


@pytest.mark.parametrize(
    ("order", "said"),
    [("magnitude-first", "magnitude, x, y, z"), ("magnitude-last", "x, y, z")],
)
def test_the_order_of_all_is_compared_with_the_axes_asked_singly(order: str, said: str) -> None:
    with variant(*F71, all_order=order) as here:
        meter = here.driver()
        here.clock.sleep(1.0)
        meter.start(1.5)
        meter.start(1.5)
        assert here.met() == [f"FETC:DC? ALL gives {said}"]


def test_what_the_f71_had_set_is_put_back() -> None:
    with variant(*F71, field_unit="GAUSS") as here:
        here.simulator.execute("SENS:AVER:COUN 7")
        meter = here.driver()
        meter.start(1.5)
        assert here.simulator.execute("UNIT:FIELD?") == "TESLA"
        settings = here.settings()
        assert settings["UNIT:FIELD"] == ("GAUSS", "TESLA")
        assert settings["SENS:AVER:COUN"][0] == "7" and settings["SENS:RANG:AUTO"] == ("1", "0")
        meter.kept.put_back()
        answer = here.simulator.execute("UNIT:FIELD?;:SENS:AVER:COUN?;:SENS:RANG:AUTO?;:SENS:MODE?")
        assert answer == "GAUSS;7;1;DC"
        assert "settings-stay" not in [kind for kind, _ in here.notes]


def test_the_makers_client_begins_and_asks_as_it_does() -> None:
    with variant(*F71) as here, here.line() as line:
        assert line.ask("SYSTem:ERRor:CLEar;:SYSTem:ERRor:ALL?") == '0,"No error"'
        here.clock.sleep(1.0)
        every = [float(one) for one in line.ask("FETCh:FIELd:DC? ALL").split(",")]
        singly = [float(line.ask(f"FETC:DC? {axis}")) for axis in ("MAG", "X", "Y", "Z")]
        assert every == pytest.approx(singly, rel=1e-6)
        for name in ("MODEL", "SNUM", "PTYPE", "STYPE", "SOR", "AXES", "CALDATE"):
            assert line.ask(f"PROBE:{name}?;:SYST:ERR?").endswith('0,"No error"'), name
        line.write("SENS:MRESET;:SENS:RELATIVE:TARE;:SENS:TCOM:TSOURCE NONE")
        assert abs(float(line.ask("FETC:RELATIVE? X"))) < 1e-9
        assert float(line.ask("FETC:MAX?")) >= float(line.ask("FETC:MIN?")) > 0.0
        assert line.ask("SENS:TCOM:TSOURCE?;:SYST:ERR?") == 'NONE;0,"No error"'
        line.write("FETC:RMS?")
        assert line.ask("SYST:ERR?").startswith("-221")
        line.write("SENS:NONSENSE 1")
        assert line.ask("SYST:ERR?").startswith("-113")


def test_what_the_425_had_set_is_put_back() -> None:
    with variant(*MODEL_425, unit=4) as here:
        meter = here.driver()
        meter.start(1.5)
        assert here.settings() == {
            "UNIT": ("4", "2"),
            "RDGMODE": ("1,1,1", "1,0,1"),
            "AUTO": ("1", "0"),
            "RANGE": ("4", "1"),
        }
        meter.kept.put_back()
        simulator = here.simulator
        assert (simulator._unit, simulator._mode, simulator._auto) == (4, "1,1,1", True)


def test_a_program_that_does_not_pause_loses_some_lines_and_not_all() -> None:
    def heard() -> list[bytes]:
        with variant(*MODEL_425) as here, here.line() as line:
            lines = [here.simulator._line(b"UNIT?") for _ in range(400)]
            for _ in range(20):
                here.clock.sleep(0.05)
                assert line.ask("UNIT?") == "1"
            return lines

    lines = heard()
    assert set(lines) == {b"1\r\n", b""} and lines[0]
    assert 0.15 < lines.count(b"") / len(lines) < 0.35
    gaps = [k for k, line in enumerate(lines) if not line]
    assert len({after - before for before, after in pairwise(gaps)}) > 3
    assert heard() == lines


def test_the_425_answers_its_status_in_bits_and_units_by_number() -> None:
    with variant(*MODEL_425) as here, here.line() as line:

        def ask(text: str) -> str:
            here.clock.sleep(0.05)
            return line.ask(text)

        here.clock.sleep(1.0)
        assert int(ask("OPST?")) & 4 and not int(ask("OPST?;OPST?").split(";")[1]) & 4
        gauss = float(ask("RDGFIELD?"))
        here.clock.sleep(0.05)
        line.write("UNIT 4")
        assert float(ask("RDGFIELD?")) == pytest.approx(79.577 * gauss, rel=0.2, abs=5.0)
        for command, query, answer in (
            ("AUTO 0", "AUTO?", "0"),
            ("RELSP +1.000E+02", "RELSP?", "+100.000E+00"),
            (
                "ALARM 1,2,+001.000E+00,+002.000E+00,1,1,0",
                "ALARM?",
                "1,2,+001.000E+00,+002.000E+00,1,1,0",
            ),
            ("ALARM 1,1,100,300,2", "ALARM?", "1,1,+100.000E+00,+300.000E+00,2,1,0"),
            ("ALARM 1,1,100,300,3,0,0", "ALARM?", "1,1,+100.000E+00,+300.000E+00,2,1,0"),
            ("RELAY 2,1", "RELAY?", "2,1"),
            ("DFLT", "AUTO?", "1"),
            ("NONSENSE 3", "UNIT?", "1"),
        ):
            here.clock.sleep(0.05)
            line.write(command)
            assert ask(query) == answer, command
        here.clock.sleep(0.05)
        line.write("ZPROBE")
        assert abs(float(ask("RDGFIELD?"))) < 1.0 and int(ask("OPST?")) & 128
        here.clock.sleep(0.05)
        line.write("*RST")
        assert ask("UNIT?") == "1"


def test_the_425s_alarm_is_in_its_status_and_moves_the_relay() -> None:
    with variant(*MODEL_425) as here, here.line() as line:

        def ask(text: str) -> str:
            here.clock.sleep(0.2)
            return line.ask(text)

        def tell(text: str) -> None:
            here.clock.sleep(0.2)
            line.write(text)

        gauss = abs(float(ask("RDGFIELD?")))
        for alarm, relay, on in (
            (f"ALARM 1,1,{gauss + 5},{gauss + 9},1,0,0", "RELAY 2,1", "1"),
            (f"ALARM 1,1,{gauss + 5},{gauss + 9},1,0,0", "RELAY 2,2", "0"),
            (f"ALARM 1,1,{gauss + 5},{gauss + 9},2,0,0", "RELAY 2,3", "0"),
            (f"ALARM 1,1,{-gauss - 9},{gauss + 9},2,0,0", "RELAY 2,3", "1"),
            (f"ALARM 0,1,{gauss + 5},{gauss + 9},1,0,0", "RELAY 1,3", "1"),
        ):
            tell(alarm)
            tell(relay)
            assert ask("RELAYST?") == on, (alarm, relay)
            beyond = alarm.startswith("ALARM 1") and not (alarm.endswith("2,0,0") and on == "0")
            assert bool(int(ask("OPST?")) & 8) == beyond, alarm


def test_the_f71_measures_what_alternates_in_ac_mode_alone() -> None:
    with variant(*F71) as here, here.line() as line:
        line.write("SENS:MODE AC")
        here.clock.sleep(11.0)
        every = [float(text) for text in line.ask("FETCH:RMS? ALL").split(",")]
        singly = [float(line.ask(f"FETC:RMS? {axis}")) for axis in ("MAG", "X", "Y", "Z")]
        assert len(every) == 4 and all(0.0 < value < 1e-5 for value in singly)
        assert float(line.ask("FETC:FREQ?")) == 0.0, "nothing but noise is there"
        line.write("FETC:DC?")
        assert line.ask("SYST:ERR?").startswith("-221")
        line.write("FETC:RMS? W")
        assert line.ask("SYST:ERR?").startswith("-224")


@pytest.mark.campaign
def test_a_run_puts_the_unit_back_and_its_log_says_what_was_met(tmp_path: Path) -> None:
    from plan_runs import run_of, shipped_bench, shipped_plan

    from station.record.folder import RunFolder

    plan, bench = shipped_plan(PROCEDURE), shipped_bench()
    plan["parameters"] |= {"axes": ["IA"], "duration": "50 s", "sample_interval": "0.1 s"}
    plan["parameters"] |= {"frequency": "0.2 Hz"}
    bench["instruments"]["gaussmeter"]["simulator"]["field_unit"] = "GAUSS"
    outcome = run_of(tmp_path, plan, bench)
    events = RunFolder(outcome.folder).events
    met = [one.details for one in events if one.kind == "instrument-settings"]
    assert {"UNIT:FIELD", "SENS:RANG"} <= {one["setting"] for one in met}
    (unit,) = [one for one in met if one["setting"] == "UNIT:FIELD"]
    assert (unit["was"], unit["set"], unit["instrument"]) == ("GAUSS", "TESLA", "gaussmeter")
    assert not [one for one in events if one.kind == "settings-stay"]
    assert [one for one in events if one.kind == "instrument-variant"]
