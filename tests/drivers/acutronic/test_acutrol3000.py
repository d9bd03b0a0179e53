"""The turntable: its driver and its simulator, over the wire between them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from fixture import error_of
from table_bench import AXIS, LIMITED, LIMITS, TABLE, RawTable, table_bench

from drivers.acutronic.acutrol3000 import Acutrol3000
from drivers.generic.table_axis import TurnCount
from sim_instruments.acutronic.acutrol3000 import Acutrol3000 as Simulator
from sim_instruments.generic.table_axis import too_far_from_s, too_fast_from_s
from sim_instruments.world.rotation import RotationHistory
from sim_instruments.world.table import Table
from station.errors import InputError, InstrumentError

ARCSEC_DEG = 1 / 3600
LINE = {"framing": "line"}


# Turns.


def test_turns_are_counted_by_the_plan_however_long_nobody_looks() -> None:
    axis, count = RotationHistory(200.0), TurnCount(continuous=True)
    assert count.take(200.0, 0.0) == -160.0
    rng = np.random.default_rng(3)
    time_s = 1.0
    for _ in range(200):
        rate, acceleration = rng.uniform(-100, 100), rng.uniform(5, 50)
        axis.turn_at(time_s + 0.02, rate * (1 + 2e-5), acceleration)
        count.turns_at(time_s, rate, acceleration)
        time_s += rng.uniform(0.05, 60.0)
        true_deg, _ = axis.now_at(time_s)
        assert count.take(true_deg % 360.0, time_s) == pytest.approx(true_deg - 360.0)
    assert not count.lost
    assert abs(true_deg) > 1000.0


def test_an_axis_that_is_not_where_its_plan_leads_has_lost_its_turns() -> None:
    count = TurnCount(continuous=True)
    count.take(0.0, 0.0)
    count.turns_at(0.0, 10.0, 10.0)
    count.take(180.0, 10.0)
    assert re.search(r"reads 180\.000 deg where about 95\.000 deg was expected", count.lost)
    count.reset()
    count.take(0.0, 0.0)
    count.turns_at(0.0, 100.0, 50.0)
    count.take(0.0, 3600.0)
    assert "nobody read the encoder for so long" in count.lost


def test_a_trip_is_known_when_the_movement_begins() -> None:
    plan = RotationHistory(10.0)
    plan.turn_at(0.0, -20.0, 10.0)
    assert too_fast_from_s(plan, 0.0, 15.0) == pytest.approx(1.5)
    assert too_fast_from_s(plan, 0.0, 20.0) == np.inf
    assert too_far_from_s(plan, 0.0, -30.0, 100.0) == pytest.approx(2.0 + 20.0 / 20.0)
    assert too_far_from_s(plan, 0.0, 5.0, 100.0) == pytest.approx(1.0)
    assert too_far_from_s(plan, 0.0, -np.inf, np.inf) == np.inf


# The simulator, by a raw client.


def test_every_message_is_answered_with_its_error_and_its_length() -> None:
    with table_bench() as bench, RawTable(bench) as line:
        assert line.framed("*IDN?") == (
            0,
            "Acutronic R&D USA,Acutrol3000,A3-0117,A8800-001-01.000-a",
        )
        assert line.framed(":utility:lockout on") == (0, "OK")
        code, text = line.framed(":Demand:Rate 7,1")
        assert (code > 0, text) == (True, "PARAMETER OUT OF RANGE")
        assert line.says(":Status:MSG? QERROR") == f"{code}:PARAMETER OUT OF RANGE"
        assert line.says(":Status:MSG? QERROR;:Status:STB?") == ";0"


@pytest.mark.parametrize("truth", [{}, LINE], ids=["framed", "line"])
def test_the_driver_takes_all_that_is_kept_and_leaves_nothing(truth: dict[str, str]) -> None:
    with table_bench(truth) as bench:
        table = bench.driver(**truth)
        assert table.take_errors() == []
        table._line.tell(":Demand:Rate 7,1")
        if truth:  # what a message is told of its error is taken with it
            table._line._line.write(":Demand:Rate 7,1")
        (kept,) = table.take_errors()
        assert re.fullmatch(r"\d+: PARAMETER OUT OF RANGE", kept)
        assert table.take_errors() == []
        table.close()


def test_in_the_other_form_only_queries_are_answered() -> None:
    with table_bench(LINE) as bench, RawTable(bench) as line:
        line.write(":Mode 1,Rate")
        assert line.ask(":Mode? 1;:Mode? 2") == "Off;Off"
        assert "AXIS NOT SERVOED" in line.ask(":Status:MSG? QERROR")
        assert line.ask("*STB?") == "0"


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        (":D:P 3,10.5;P? 3", "10.500000"),
        ("dem:pos 2,0.01;rate 3,100;rate? 3;pos? 2", "100.000000;0.010000"),
        (":lim:acc pos,1,7;:LIMIT:ACC? p,1", "7.000000"),
        (":Limit 2,Rate,30,5,50;:Limit:Rate? rate,2;Acc? r,2;Jerk? r,2", "30.0;5.0;50.0"),
        (":Lim:Abs? 1", "200.0,100.0,1000.0,0.0,360.0,240.0,1.0"),
        (":mode? 1", "Off"),
        ("*OPC?", "UNKNOWN COMMAND"),
        (":Foo? 1", "UNKNOWN COMMAND"),
        (":Demand:Rate,1,10", "SYNTAX ERROR"),
        (":Demand:Rate 1,1e1", "SYNTAX ERROR"),
        (":Demand:Rate 1", "MISSING PARAMETER"),
        (":Read:R? ALL", "SYNTAX ERROR"),
        (":Limit:R? rate,1", "0"),
    ],
)
def test_the_grammar(message: str, answer: str) -> None:
    with table_bench() as bench, RawTable(bench) as line:
        _, text = line.framed(message)
        plain = re.sub(r"(\.\d)\d*", r"\1", text)
        wanted = re.sub(r"(\.\d)\d*", r"\1", answer)
        assert plain == wanted or (answer == "0" and float(text) == 100.0)


def test_values_of_one_message_come_from_one_servo_frame() -> None:
    with table_bench({"rate_noise": "0 deg/s", "encoder_noise": "0 deg"}) as bench:
        bench.homed().turn(1, 100.0)
        bench.clock.sleep(10.0)
        with RawTable(bench) as line:
            values = line.says(":read:pos? 1;rate? 1;pos 1").split(";")
        assert values[0] == values[2]
        assert float(values[1]) == pytest.approx(100.0, abs=1e-6)


def test_a_position_beyond_half_a_turn_is_reached_by_the_shorter_way() -> None:
    with table_bench() as bench, RawTable(bench) as line:
        bench.homed(1)
        begin_deg, _ = bench.rotation(1).now_at(bench.clock.now())
        line.says(":Demand:Position 1,300")
        line.says(":Mode 1,Position")
        bench.clock.sleep(20.0)
        end_deg, _ = bench.rotation(1).now_at(bench.clock.now())
        assert (begin_deg, end_deg) == (pytest.approx(12.0), pytest.approx(-60.0, abs=0.01))
        assert line.framed(":Demand:DeltaPosition 1,181")[1] == "PARAMETER OUT OF RANGE"
        line.says(":Demand:DeltaPosition 1,-20")
        assert line.says(":Demand:Position? 1") == pytest.approx("280.000000")


def test_a_mode_begins_with_what_was_demanded_of_it_before() -> None:
    with table_bench() as bench, RawTable(bench) as line:
        bench.homed(1)
        line.says(":Demand:Rate 1,-30")
        assert not bench.rotation(1).now_at(bench.clock.now() + 1.0)[1]
        line.says(":Mode:Rate 1")
        bench.clock.sleep(5.0)
        assert bench.rotation(1).now_at(bench.clock.now())[1] == pytest.approx(-30.0, rel=1e-4)
        line.says(":Mode ALL,Off")
        bench.clock.sleep(5.0)
        assert not bench.rotation(1).now_at(bench.clock.now())[1]
        assert int(line.says(":Status:CSR? A1STATE")) & 1 << 4, "off is no open servo"


def test_the_status_stays_frozen_until_the_interlock_is_reset() -> None:
    fault = {"fault": "emergency-stop", "at": "10 s", "for": "5 s"}
    with table_bench(None, fault) as bench, RawTable(bench) as line:
        bench.homed(2).turn(2, 50.0)
        bench.clock.sleep_until(11.0)
        assert line.says("*STB?") == "65"
        assert line.says("*STB?") == "0", "reading forgets it"
        assert line.framed(":Interlock:Reset")[1] == "INTERLOCK OPEN"
        bench.clock.sleep_until(16.0)
        assert int(line.says(":Status:CSR? A2STATE")) & 1 << 7
        assert line.framed(":Interlock:Close 2")[1] == "INTERLOCK RESET REQUIRED"
        line.says(":interlock:reset 1")
        line.says(":interlock:close 2")
        bench.clock.sleep(1.0)
        assert int(line.says(":Status:CSR? A2STATE")) == 1 << 4


def test_the_encoder_s_error_is_an_error_of_the_true_angle() -> None:
    with table_bench() as bench:
        table = bench.homed()
        errors = []
        for angle_deg in np.arange(0.0, 360.0, 60.0):
            table.move_to(1, angle_deg)
            bench.wait(table)
            true_deg, _ = bench.rotation(1).now_at(bench.clock.now())
            errors.append((angle_deg - true_deg) / ARCSEC_DEG)
            assert table.angle_deg(1) == pytest.approx(angle_deg, abs=0.5 * ARCSEC_DEG)
        sines = np.sin(np.radians(np.arange(0.0, 360.0, 60.0) + 30.0))
        assert errors == pytest.approx(5.0 + sines, abs=0.01)


class WorldTable(Table):
    """A table whose axes a test holds."""

    def __init__(self, axes: dict[int, RotationHistory]) -> None:
        self._by_number = axes


def test_it_turns_the_table_of_the_world_where_there_is_one() -> None:
    axes = {n: RotationHistory(10.0 * n) for n in (1, 2, 3)}

    def in_a_world_with_a_table(setting: Any) -> Simulator:
        setting.world.table = WorldTable(axes)
        return Simulator(setting)

    with table_bench(maker=in_a_world_with_a_table) as bench:
        table = bench.homed(2)
        assert table.angle_deg(2) == pytest.approx(20.0, abs=10 * ARCSEC_DEG)
        table.move_to(2, -40.0)
        bench.wait(table, 2)
        ends_deg = [axis.now_at(bench.clock.now())[0] for axis in axes.values()]
        assert ends_deg == pytest.approx([10.0, -40.0, 30.0], abs=10 * ARCSEC_DEG)


# The driver, in both forms of the line.


@pytest.fixture(params=["framed", "line"])
def form(request: pytest.FixtureRequest) -> dict[str, str]:
    return {"framing": request.param}


def test_its_other_name_is_recognised() -> None:
    assert re.search(Acutrol3000.recognises, "Acutronic USA, ACT3000, 1234567890, 1.0")


def test_full_turns_are_counted_in_both_ways_of_turning(form: dict[str, str]) -> None:
    with table_bench(form) as bench:
        table = bench.homed(3)
        begin_deg = table.angle_deg(3)
        assert begin_deg == pytest.approx(-0.1, abs=0.01)
        table.move_to(3, begin_deg + 3 * 360.0)
        bench.wait(table, 3)
        assert table.angle_deg(3) - begin_deg == pytest.approx(1080.0, abs=0.001)
        true_deg, _ = bench.rotation(3).now_at(bench.clock.now())
        assert true_deg - 359.9 == pytest.approx(1080.0, abs=0.001)
        table.turn(3, -10.0)
        bench.wait_for_rate(table, 3)
        first_deg, first_s = table.angle_deg(3), bench.clock.now()
        bench.clock.sleep(15 * 36.0)
        last_deg, last_s = table.angle_deg(3), bench.clock.now()
        assert (last_deg - first_deg) / (last_s - first_s) == pytest.approx(-10.0002, abs=1e-5)
        table.stop(3)
        bench.wait(table, 3)
        assert table.angle_deg(3) % 360.0 == pytest.approx(
            bench.rotation(3).now_at(bench.clock.now())[0] % 360.0, abs=0.005
        )


def test_a_long_move_is_as_fast_as_its_limits_allow_when_it_is_looked_at() -> None:
    with table_bench() as bench:
        table = bench.homed(limits={"rate": 10.0, "acceleration": 10.0})
        began_s = bench.clock.now()
        table.move_to(1, table.angle_deg(1) + 360.0)
        bench.wait(table)
        # 36 s at the rate, 1 s for both ramps, the settling, and a look each 0.1 s.
        assert bench.clock.now() - began_s == pytest.approx(37.6, abs=0.2)


def test_a_move_that_is_seldom_looked_at_still_goes_all_the_way() -> None:
    with table_bench() as bench:
        table = bench.homed()
        table.move_to(1, 700.0)
        looks = 0
        while table.is_moving(1):
            bench.clock.sleep(60.0)
            looks += 1
        assert table.angle_deg(1) == pytest.approx(700.0, abs=0.001)
        assert 5 <= looks <= 8


def test_an_axis_that_turns_is_stopped_before_it_goes_to_an_angle() -> None:
    with table_bench() as bench:
        table = bench.homed(limits=LIMITS)
        table.turn(1, 100.0)
        bench.wait_for_rate(table)
        bench.clock.sleep(30.0)
        table.move_to(1, 0.0)
        bench.wait(table)
        assert table.angle_deg(1) == pytest.approx(0.0, abs=0.001)
        assert bench.rotation(1).now_at(bench.clock.now())[0] == pytest.approx(0.0, abs=0.01)


def test_axes_are_told_apart() -> None:
    with table_bench() as bench:
        table = bench.homed(1, 2)
        table.turn(1, 20.0)
        table.move_to(2, 90.0)
        bench.wait(table, 2)
        bench.wait_for_rate(table, 1)
        assert table.rate_deg_per_s(2) == pytest.approx(0.0, abs=0.01)
        assert table.read_quantity("rate") == pytest.approx(20.0, abs=0.01)
        assert not table.is_homed(3)
        with pytest.raises(InputError, match="the table has no axis 4"):
            table.turn(4, 1.0)
        table.stop(1)
        bench.wait(table, 1)
        said = bench.readings.newest(TABLE, "motion")
        assert said is not None and said.value == "at-rest"


def test_the_limits_are_in_the_controller(form: dict[str, str]) -> None:
    with table_bench(form) as bench:
        bench.driver().programme_limits()
        served: Any = bench.simulation._served[TABLE]
        for axis in served.axes.values():
            for mode in ("POSITION", "RATE"):
                assert (axis.limits[mode].rate, axis.limits[mode].acceleration) == (110.0, 50.0)
                assert axis.limits[mode].velocity_trip == pytest.approx(121.0)
        with pytest.raises(InstrumentError, match=r"ends at 200 deg/s; lower limits\.rate"):
            bench.driver({**LIMITS, "rate": 201.0}).programme_limits()
        with pytest.raises(InstrumentError, match=r"it gives no limits\.acceleration"):
            bench.driver({"rate": 1.0}).home(1)


def test_an_axis_with_end_stops_goes_the_way_that_it_has() -> None:
    limits = {**LIMITS, "angle_low": -95.0, "angle_high": 95.0}
    with table_bench({"axis_1": LIMITED}) as bench:
        table = bench.homed(limits=limits, continuous=[2, 3])
        for angle_deg in (94.0, -94.0):
            table.move_to(1, angle_deg)
            bench.wait(table)
            assert table.angle_deg(1) == pytest.approx(angle_deg, abs=0.001)
        with pytest.raises(InstrumentError, match="the bench allows -95 deg to 95 deg"):
            table.move_to(1, 96.0)
        table.turn(1, 20.0)
        text = error_of(lambda: bench.wait_for_rate(table) or bench.wait(table))
        assert "aborted at a limit of position" in text
        assert bench.rotation(1).now_at(bench.clock.now())[0] == pytest.approx(96.0, abs=2.0)


def test_an_encoder_that_has_to_find_its_zero_finds_it() -> None:
    with table_bench({"axis_1": {**AXIS, "unreferenced": True}}) as bench:
        table = bench.driver(zero="search")
        assert table.read_quantity("angle") == pytest.approx(12.0, abs=0.01)  # of the others
        table.home(1)
        bench.wait(table)
        assert table.is_homed(1)
        assert table.angle_deg(1) == pytest.approx(0.0, abs=ARCSEC_DEG)
        true_deg, _ = bench.rotation(1).now_at(bench.clock.now())
        assert true_deg == pytest.approx(-5.5 * ARCSEC_DEG, abs=0.1 * ARCSEC_DEG)


# What goes wrong.


def test_a_following_error_is_named_and_homing_goes_on_from_there(form: dict[str, str]) -> None:
    fault = {"fault": "following-error", "at": "20 s", "for": "5 s"}
    with table_bench(form, fault) as bench:
        table = bench.homed()
        bench.clock.sleep_until(18.0)
        table.turn(1, 100.0)
        bench.clock.sleep_until(24.0)
        text = error_of(lambda: bench.wait_for_rate(table))
        assert "following error" in text and "home the axis again" in text
        assert not table.is_homed(1)
        assert "home it first" in error_of(lambda: table.turn(1, 1.0))
        bench.clock.sleep_until(26.0)
        table.home(1)
        bench.wait(table)
        table.move_to(1, 0.0)
        bench.wait(table)


def test_a_rate_trip_is_named() -> None:
    with table_bench() as bench:
        table = bench.homed()
        with RawTable(bench) as line:
            line.says(":LIM:VTR R,1,20.0")
            table.turn(1, 60.0)
            assert "faster than its rate trip" in error_of(lambda: bench.wait_for_rate(table))
        times_s = np.linspace(0.0, bench.clock.now(), 5000)
        assert np.abs(bench.rotation(1).rate_deg_per_s(times_s)).max() < 21.0


def test_the_emergency_stop_is_named_and_holds_until_it_is_released(form: dict[str, str]) -> None:
    fault = {"fault": "emergency-stop", "at": "20 s", "for": "10 s"}
    with table_bench(form, fault) as bench:
        table = bench.homed()
        bench.clock.sleep_until(19.0)
        table.turn(1, 30.0)
        assert table.read_quantity("chain") == "closed"
        bench.clock.sleep_until(21.0)
        text = error_of(lambda: bench.wait_for_rate(table))
        assert "the interlock was opened by a safety interlock (SI)" in text
        assert "nobody is in danger" in text
        assert table.read_safety().safe
        text = error_of(lambda: table.home(1))
        assert "its interlock is open" in text and "emergency stop" in text
        assert table.open_contacts() == ("interlock",)
        bench.clock.sleep_until(31.0)
        assert table.open_contacts() == (), "a break that is over is reset where nothing is homed"
        table.home(1)
        bench.wait(table)
        table.turn(1, 30.0)
        bench.wait_for_rate(table)


def test_a_servo_that_somebody_opened_is_named() -> None:
    with table_bench() as bench:
        table = bench.homed()
        with RawTable(bench) as line:
            line.says(":Int:Open 1")
            assert "though nobody here opened it" in error_of(lambda: table.is_moving(1))


def test_somebody_else_who_sets_rates_is_noticed() -> None:
    with table_bench() as bench:
        table = bench.homed()
        table.turn(1, 20.0)
        bench.wait_for_rate(table)
        with RawTable(bench) as line:
            line.says(":Demand:Rate 1,10")
            bench.clock.sleep(1.0)
            assert "it turns at 10.00" in error_of(lambda: table.angle_deg(1))


def test_a_blocked_axis_is_noticed() -> None:
    fault = {"fault": "stuck", "at": "20 s", "for": "60 s"}
    with table_bench(None, fault) as bench:
        table = bench.homed(1, 2)
        table.turn(1, 5.0)
        bench.wait_for_rate(table)
        bench.clock.sleep_until(21.0)
        text = error_of(lambda: table.angle_deg(1))
        assert "axis 1 at 5 deg/s" in text or "count axis 1" in text
        table.move_to(2, 90.0)
        text = error_of(lambda: bench.wait(table, 2))
        assert "where 90.00000 deg was commanded" in text and "blocked axis" in text


def test_turns_that_cannot_be_told_are_no_angle() -> None:
    with table_bench({"rate_error": "1 %"}) as bench:
        table = bench.homed()
        table.turn(1, 100.0)
        bench.wait_for_rate(table)
        bench.clock.sleep(600.0)
        assert "its turns cannot be counted" in error_of(lambda: table.angle_deg(1))
        assert not table.is_homed(1)


# Rest.


def test_the_axes_brake_within_their_acceleration_and_stay_servoed(form: dict[str, str]) -> None:
    with table_bench(form) as bench:
        table = bench.homed(1, 2)
        table.turn(1, -100.0)
        table.move_to(2, 170.0)
        bench.clock.sleep(3.0)
        assert not table.read_safety().safe
        began_s = bench.clock.now()
        table.make_safe(began_s + 15.0)
        assert 1.9 < bench.clock.now() - began_s < 3.0
        reading = table.read_safety()
        assert reading.safe, reading.read_back
        assert re.match(
            r"at rest: axis 1 off at -\d+\.\d{3} deg, 0\.00\d deg/s; axis 2", str(reading.read_back)
        )
        times_s = np.linspace(0.0, bench.clock.now(), 20000)
        for n in (1, 2):
            slope = np.diff(bench.rotation(n).rate_deg_per_s(times_s)) / np.diff(times_s)
            assert np.abs(slope).max() <= 50.0 * 1.001
        assert table.is_homed(1)
        before_deg = table.angle_deg(1)
        table.move_to(1, before_deg + 360.0)
        bench.wait(table)


def test_it_is_stopped_while_it_closes_its_servo() -> None:
    with table_bench() as bench:
        table = bench.driver()
        table.home(1)
        table.make_safe(bench.clock.now() + 10.0)
        assert table.read_safety().safe
        assert not table.is_homed(1)


@pytest.mark.parametrize("command", [":Demand:Rate 1,0", ":Mode ALL", ":Read:Position? 1"])
def test_one_lost_answer_does_not_keep_it_from_stopping(command: str, form: dict[str, str]) -> None:
    fault = {"fault": "no-reply", "command": command, "at": "20 s"}
    with table_bench(form, fault) as bench:
        table = bench.homed()
        table.turn(1, 100.0)
        bench.clock.sleep_until(20.0)
        table.make_safe(bench.clock.now() + 15.0)
        assert table.read_safety().safe


def test_an_interlock_can_ask_for_it_at_any_time() -> None:
    with table_bench() as bench:
        table = bench.homed(2)
        table.turn(2, -40.0)
        bench.clock.sleep(30.0)
        assert table.read_quantity("motion") == "moving"
        assert table.read_quantity("rate") == pytest.approx(-40.0, abs=0.01)
        assert table.read_quantity("angle") == pytest.approx(12 - 40 * 29.6, abs=2.0)


@pytest.mark.parametrize("served", ["framed", "line"])
def test_the_wrong_framing_is_reported(served: str) -> None:
    with table_bench({"framing": served}) as bench:
        other = "line" if served == "framed" else "framed"
        text = error_of(lambda: bench.driver(framing=other).identify())
        assert text.startswith("turntable: sent '*IDN?': ")


def test_what_closes_a_servo_or_forgets_what_it_tells_is_said_once() -> None:
    declared = Acutrol3000.repeatable
    for message in (":Demand:Rate 2,0", ":Mode 2,Rate", ":Mode ALL,Off", ":Status:CSR? A1STATE"):
        assert message in declared
    for message in (
        ":Demand:Rate 2,0.5",
        ":Interlock:Close 1",
        ":Interlock:Reset",
        "*STB?",
        ":Status:MSG? QERROR",
        ":Mode 2,Position",
    ):
        assert message not in declared
