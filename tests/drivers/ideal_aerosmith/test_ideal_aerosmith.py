"""An Ideal Aerosmith table: its driver and its simulator, over the wire between them."""

from __future__ import annotations

import itertools
import re
from typing import Any

import pytest
from aerosmith_bench import AXIS, LIMITS, THREE, TRUTH, RawTable, aerosmith_bench
from fixture import error_of

from drivers.generic.table_axis import TurnCount
from sim_instruments.world.rotation import RotationHistory
from station.errors import AnotherInstrument, InstrumentError

LIMITED = {**AXIS, "angle_at_start": "10 deg", "low": "-100 deg", "high": "100 deg"}
FORMS: dict[str, dict[str, Any]] = {
    "as two clients have it": {},
    "no answer to JOG": {"acknowledges": "no-motion"},
    "positions count turns": {"position": "turns"},
    "echoes": {"echoes": True},
    "tells no setting": {"settings_asked": False},
    "no motor command": {"settings_asked": False, "unknown": "SRV"},
    "three axes": THREE,
}


def notes_of(table: Any) -> list[str]:
    """Return which forms the driver has met."""
    return sorted(table._variants)


# The plan of a movement by an angle.


@pytest.mark.parametrize("by_deg", [0.5, -30.0, 1000.0])
def test_a_movement_by_an_angle_is_counted_by_its_plan(by_deg: float) -> None:
    axis, count = RotationHistory(), TurnCount(continuous=True)
    count.take(0.0, 0.0)
    axis.move_to(1.0, by_deg, 100.0, 50.0)
    count.goes_by(1.0, by_deg, 100.0, 50.0)
    for step in range(1, 300):
        time_s = 1.0 + 0.05 * step**1.01
        true_deg, rate = axis.now_at(time_s)
        assert count.planned_rate(time_s) == pytest.approx(rate, abs=1e-6)
        assert count.take(true_deg % 360.0, time_s) == pytest.approx(true_deg)
    assert not count.lost


# All forms that the clients leave open.


@pytest.mark.parametrize("form", FORMS)
def test_it_homes_moves_turns_and_rests_whatever_the_form(form: str) -> None:
    with aerosmith_bench(FORMS[form]) as bench:
        table = bench.driver()
        assert table.identify().maker == "Ideal Aerosmith"
        table.home(1)
        bench.wait(table)
        assert table.is_homed(1)
        for angle_deg in (40.0, 1000.25, -200.0):
            table.move_to(1, angle_deg)
            bench.wait(table)
            assert table.angle_deg(1) == pytest.approx(angle_deg, abs=1e-3)
        true_deg, _ = bench.rotation().now_at(bench.clock.now())
        assert true_deg == pytest.approx(-200.0, abs=0.01)
        table.turn(1, -50.5)
        bench.wait_for_rate(table)
        begin_s, begin_deg = bench.clock.now(), table.angle_deg(1)
        bench.clock.sleep(30.0)
        went = (table.angle_deg(1) - begin_deg) / (bench.clock.now() - begin_s)
        assert went == pytest.approx(-50.5, rel=1e-4)
        assert not table.read_safety().safe
        table.make_safe(bench.clock.now() + 15.0)
        assert table.read_safety().safe
        assert not bench.table.energised()


def test_the_forms_that_are_met_are_said() -> None:
    with aerosmith_bench({"acknowledges": "no-motion", "settings_asked": False}) as bench:
        table = bench.homed()
        table.turn(1, 10.0)
        assert notes_of(table) == [
            "answers JOG by nothing",
            "does not tell its settings",
            "does not tell whether a motor is on",
        ]


@pytest.mark.parametrize("command", ["RMO", "MOV", "P"])
def test_each_command_that_moves_is_taken(command: str) -> None:
    with aerosmith_bench({"position": "turns"}) as bench:
        table = bench.homed(moves_by=command, longest_move="150 deg")
        table.move_to(1, 400.0)
        bench.wait(table)
        assert table.angle_deg(1) == pytest.approx(400.0, abs=1e-3)
        sent = [data for direction, data in bench.heard if direction == ">"]
        moves = [data for data in sent if data.startswith(command.encode("ascii") + b"1")]
        assert len(moves) >= 1
        assert sum(data.startswith(command.encode("ascii")) for data in sent) >= 3


@pytest.mark.parametrize(
    ("position", "settings"),
    [("wraps", {"moves_by": "MOV"}), ("wraps", {"continuous": []})],
)
def test_an_axis_that_ends_whole_turns_away_names_the_settings(
    position: str, settings: dict[str, Any]
) -> None:
    with aerosmith_bench({"position": position}) as bench:
        table = bench.homed(**settings)
        table.move_to(1, 400.0)
        said = error_of(lambda: bench.wait(table))
        assert "stands whole turns away" in said
        assert "settings.longest_move: 170 deg" in said
        assert "settings.continuous" in said


def test_an_axis_on_its_way_stops_before_it_goes_elsewhere() -> None:
    with aerosmith_bench() as bench:
        table = bench.homed()
        table.move_to(1, 200.0)
        bench.clock.sleep(1.5)
        assert abs(table.rate_deg_per_s(1)) > 10.0
        table.move_to(1, -20.0)
        bench.wait(table)
        assert table.angle_deg(1) == pytest.approx(-20.0, abs=1e-3)
        table.move_to(1, 30.0)  # and before it has begun to move
        table.move_to(1, -30.0)
        bench.wait(table)
        assert table.angle_deg(1) == pytest.approx(-30.0, abs=1e-3)


# Limits.


def test_limits_go_into_the_table_and_read_back() -> None:
    with aerosmith_bench(THREE) as bench:
        bench.driver().programme_limits()
        for axis in bench.table.axes.values():
            assert (axis.velocity, axis.acceleration) == (110.0, 50.0)


@pytest.mark.parametrize(("limit", "beyond"), [("rate", 201.0), ("acceleration", 101.0)])
def test_a_limit_beyond_the_axis_is_refused(limit: str, beyond: float) -> None:
    with aerosmith_bench() as bench:
        table = bench.driver({**LIMITS, limit: beyond})
        assert f"lower limits.{limit} in the bench file" in error_of(table.programme_limits)


def test_a_turn_out_of_the_bench_s_angles_is_stopped() -> None:
    limits = {**LIMITS, "angle_low": -90.0, "angle_high": 90.0}
    with aerosmith_bench({"axis_1": LIMITED}) as bench:
        table = bench.homed(limits=limits, continuous=[])
        assert "the bench allows -90 deg to 90 deg" in error_of(lambda: table.move_to(1, 91.0))
        table.turn(1, 20.0)
        with pytest.raises(InstrumentError, match="and was stopped"):
            bench.wait_for_rate(table)
            while table.is_at_rate(1):
                bench.clock.sleep(0.1)
        bench.clock.sleep(2.0)
        true_deg, rate = bench.rotation().now_at(bench.clock.now())
        assert rate == 0.0
        assert true_deg < 100.0


# What goes wrong.


@pytest.mark.parametrize("home", ["never", "refused"])
def test_a_search_for_the_zero_that_never_ends_is_stopped(home: str) -> None:
    with aerosmith_bench({"home": home}) as bench:
        table = bench.driver(home_within="20 s")
        table.home(1)
        words = "not done long after it should be|it refused"
        with pytest.raises(InstrumentError, match=words):
            bench.wait(table)
        bench.clock.sleep(5.0)
        assert not table.is_homed(1)
        assert not bench.table.energised()


def test_a_search_that_ends_elsewhere_than_at_zero_is_no_zero() -> None:
    stuck = {"fault": "stuck", "at": "0 s"}
    with aerosmith_bench(None, stuck) as bench:
        table = bench.driver(home_within="20 s")
        bench.table.axes[1].encoder.lost_deg -= 3.0
        bench.clock.sleep(0.1)
        table.home(1)
        said = error_of(lambda: bench.wait(table))
        assert re.search(r"its encoder reads (2\.9|3\.0)\d+ deg after that, not zero", said)


def test_a_motor_that_the_panel_switches_off_is_named_and_needs_homing() -> None:
    with aerosmith_bench() as bench:
        table = bench.homed()
        assert table.open_contacts() == ()
        table.turn(1, 30.0)
        bench.wait_for_rate(table)
        bench.table.axes[1].switch_off()
        said = error_of(lambda: table.is_moving(1))
        assert "its motor is off, though nobody here switched it off" in said
        assert table.open_contacts() == ("motor 1",)
        assert "home it first" in error_of(lambda: table.turn(1, 10.0))
        table.home(1)
        bench.wait(table)
        assert table.open_contacts() == ()


def test_an_emergency_stop_keeps_the_motor_off() -> None:
    pressed = {"fault": "emergency-stop", "at": "20 s", "for": "10 s"}
    with aerosmith_bench(None, pressed) as bench:
        table = bench.homed()
        bench.clock.sleep_until(21.0)
        assert table.open_contacts() == ("motor 1",)
        assert "its motor is off" in error_of(lambda: table.move_to(1, 10.0))
        said = error_of(lambda: table.home(1))
        assert "its motor does not go on" in said
        assert "emergency stop" in said
        bench.clock.sleep_until(31.0)
        table.home(1)
        bench.wait(table)
        assert table.is_homed(1)


def test_a_firmware_that_tells_of_no_motor_is_no_contact() -> None:
    with aerosmith_bench({"settings_asked": False}) as bench:
        assert "the shares of interlock_chain" in error_of(bench.driver().open_contacts)


@pytest.mark.parametrize("fault", ["stuck", "following-error"])
def test_an_axis_that_does_not_follow_is_a_fault(fault: str) -> None:
    struck = {"fault": fault, "at": "20 s"}
    with aerosmith_bench({"settings_asked": False}, struck) as bench:
        table = bench.homed()
        table.turn(1, 30.0)
        bench.wait_for_rate(table)
        bench.clock.sleep_until(25.0)
        with pytest.raises(InstrumentError, match=r"it turns at|where about"):
            table.angle_deg(1)
        table.make_safe(bench.clock.now() + 15.0)
        assert table.read_safety().safe


def test_a_table_whose_rates_are_by_the_minute_ends_the_run_or_is_told() -> None:
    with aerosmith_bench({"rates": "minute", "rate_noise": "0 deg/s"}) as bench:
        table = bench.homed()
        table.turn(1, 60.0)
        with pytest.raises(InstrumentError, match=r"it turns at|its encoder goes at"):
            bench.wait_for_rate(table)
        table.make_safe(bench.clock.now() + 15.0)
        assert table.read_safety().safe
        table.close()
        told = bench.homed(rates_by="minute")
        told.turn(1, 60.0)
        bench.wait_for_rate(told)
        _, rate = bench.rotation().now_at(bench.clock.now())
        assert rate == pytest.approx(60.0, rel=1e-3)


@pytest.mark.parametrize("form", [{}, {"position": "turns"}, THREE])
def test_a_movement_in_another_unit_of_rates_names_the_setting_at_once(
    form: dict[str, Any],
) -> None:
    with aerosmith_bench({**form, "rates": "minute", "rate_noise": "0 deg/s"}) as bench:
        table = bench.homed()
        table.move_to(1, 90.0)
        said = error_of(lambda: bench.wait(table))
        assert "go to 90 deg on axis 1: it says 109.9" in said
        assert re.search(r"its encoder goes at 1\.8\d+ deg/s", said)
        assert "settings.rates_by" in said
        assert abs(bench.rotation().now_at(bench.clock.now())[0]) < 5.0
        bench.clock.sleep(3.0)
        assert not bench.table.energised()


def test_equal_rates_before_and_after_the_top_of_a_movement_are_no_other_unit() -> None:
    with aerosmith_bench() as bench:
        table = bench.homed()
        table.move_to(1, 300.0)
        middle_s = bench.clock.now() + 0.01 + (300.0 / 110.0 + 110.0 / 50.0) / 2
        for at_s in (middle_s - 0.9, middle_s + 0.9):
            bench.clock.sleep_until(at_s)
            assert table.is_moving(1)
            assert table.rate_deg_per_s(1) == pytest.approx(79.0, abs=2.0)
        bench.wait(table)
        assert table.angle_deg(1) == pytest.approx(300.0, abs=1e-3)


@pytest.mark.parametrize("turns", [False, True])
def test_angles_that_are_taken_up_late_are_no_other_unit(turns: bool) -> None:
    """As on a computer that has other work to do for a moment."""
    with aerosmith_bench() as bench:
        table = bench.homed(limits={**LIMITS, "rate": 20.0})
        asks, late_s = table._line.value, itertools.cycle([0.0, 0.0, 0.3])

        def takes_up_late(n: int, question: str) -> float:
            answer: float = asks(n, question)
            bench.clock.sleep(next(late_s) if question == "PPO" else 0.0)
            return answer

        table._line.value = takes_up_late
        if turns:
            table.turn(1, 20.0)
            bench.wait_for_rate(table)
        else:
            table.move_to(1, 300.0)
            bench.wait(table)
            assert table.angle_deg(1) == pytest.approx(300.0, abs=1e-3)


def test_an_encoder_that_disagrees_with_the_rate_is_no_rate() -> None:
    with aerosmith_bench() as bench:
        table = bench.homed()
        axis = bench.table.axes[1]
        true = axis.rate_deg_per_s
        axis.rate_deg_per_s = lambda: 2.0 * true()
        table.turn(1, 20.0)
        axis.turn_at(10.0)
        with pytest.raises(InstrumentError, match=r"its encoder goes at (9|10)\.\d+ deg/s"):
            bench.wait_for_rate(table)
        bench.clock.sleep(3.0)
        assert not bench.table.energised()


def test_an_axis_that_nobody_commanded_stops_all() -> None:
    """As where the word before a command names another axis than was meant."""
    with aerosmith_bench(THREE) as bench:
        table = bench.homed(1, 2, 3)
        swapped = bench.table.axes
        swapped[2], swapped[3] = swapped[3], swapped[2]
        table.turn(2, 20.0)
        bench.clock.sleep(0.5)
        swapped[2], swapped[3] = swapped[3], swapped[2]
        said = error_of(lambda: table.is_at_rate(2))
        assert "axis 3 turns at" in said
        assert "settings.prefixes" in said
        bench.clock.sleep(3.0)
        assert not bench.table.energised()
        assert not any(map(table.is_homed, (1, 2, 3)))


@pytest.mark.parametrize("stands", [2, 1])
def test_no_angle_counts_while_another_program_moves_an_axis_that_stands(stands: int) -> None:
    """The plate tilts while it turns, or turns while it should stand."""
    with aerosmith_bench(THREE) as bench:
        table = bench.homed(1, 2, 3)
        table.turn(1, 20.0)
        bench.wait_for_rate(table)
        if stands == 1:
            table.stop(1)
            bench.wait(table)
        table.angle_deg(1)
        bench.table.axes[stands].turn_at(0.5)
        bench.clock.sleep(0.5)
        said = error_of(lambda: table.angle_deg(1))
        assert re.search(rf"axis {stands} turns at 0\.(49|50)", said)
        assert "nobody works at its panel" in said


def test_no_angle_counts_when_a_levelled_axis_is_elsewhere() -> None:
    with aerosmith_bench(THREE) as bench:
        table = bench.homed(1, 2, 3)
        table.move_to(2, 0.0)
        bench.wait(table, 2)
        table.turn(1, 20.0)
        bench.wait_for_rate(table)
        table.angle_deg(1)
        bench.table.axes[2].move_by(1.0)
        bench.clock.sleep(3.0)
        said = error_of(lambda: table.angle_deg(1))
        assert re.search(r"the encoder of axis 2 reads (0\.999|1\.000)", said)
        assert not table.is_homed(2)


def test_limits_in_the_other_unit_and_a_refused_search_name_their_setting() -> None:
    with aerosmith_bench({"home": "refused"}) as bench:
        said = error_of(bench.driver(rates_by="minute").programme_limits)
        assert "settings.rates_by" in said
        table = bench.driver()
        table.home(1)
        assert "settings.zero: absolute" in error_of(lambda: bench.wait(table))


def test_a_lost_answer_to_a_movement_is_an_error_and_rest_is_reached() -> None:
    cut = {"fault": "dropped-connection", "command": "JOG"}
    with aerosmith_bench(None, cut) as bench:
        table = bench.homed()
        with pytest.raises(InstrumentError):
            table.turn(1, 30.0)
        table.make_safe(bench.clock.now() + 15.0)
        assert table.read_safety().safe
        assert not bench.table.energised()


def test_a_cable_that_is_pulled_while_it_turns_leaves_it_unproved() -> None:
    pulled = {"fault": "port-gone", "at": "30 s", "for": "60 s"}
    with aerosmith_bench(None, pulled) as bench:
        table = bench.homed()
        table.turn(1, 30.0)
        bench.wait_for_rate(table)
        bench.clock.sleep_until(31.0)
        for act in (lambda: table.make_safe(bench.clock.now() + 1.0), table.read_safety):
            with pytest.raises(InstrumentError):
                act()
        bench.clock.sleep_until(91.0)
        table.make_safe(bench.clock.now() + 15.0)
        assert table.read_safety().safe


def test_another_model_behind_the_address_is_sent_nothing_more() -> None:
    with aerosmith_bench() as bench:
        table = bench.driver()
        bench.table._answer = lambda text: "KEPCO,BOP 72-14MG,K2304411,2.24\r\n>\r\n"
        with pytest.raises(AnotherInstrument):
            table.identify()


def test_a_prefix_that_the_table_does_not_know_is_said() -> None:
    with aerosmith_bench(THREE) as bench:
        table = bench.driver(prefixes=["1", "2", "Z"])
        said = error_of(table.identify)
        assert "asked ZPPO" in said
        assert "settings.prefixes" in said


@pytest.mark.parametrize("reading", ["12.3a", "", "nan", "1.0 2.0"])
def test_a_garbled_angle_is_no_angle(reading: str) -> None:
    with aerosmith_bench() as bench:
        table = bench.homed()
        bench.table._position = None
        bench.table._acts["PPO"] = lambda axis, number: reading
        with pytest.raises(InstrumentError):
            table.angle_deg(1)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"prefixes": ["1"], "axes": 2}, "a prefix of its own"),
        ({"prefixes": ["1", "1"], "axes": 2}, "a prefix of its own"),
        ({"prefixes": ["1\r", "2"], "axes": 2}, "prefixes"),
        ({"moves_by": "PMO"}, "moves_by"),
    ],
)
def test_settings_that_name_no_axis_are_refused(settings: dict[str, Any], words: str) -> None:
    with aerosmith_bench() as bench:
        assert words in error_of(lambda: bench.driver(**settings))


def test_a_laboratory_may_name_its_axes_otherwise() -> None:
    with aerosmith_bench({**THREE, "axis_1": TRUTH["axis_1"]}) as bench:
        table = bench.driver(axes=1, prefixes=["3"])
        table.home(1)
        bench.wait(table)
        table.move_to(1, 30.0)
        bench.wait(table)
        true_deg, _ = bench.rotation(3).now_at(bench.clock.now())
        assert true_deg % 360.0 == pytest.approx(30.0, abs=0.01)


def test_the_raw_forms() -> None:
    with aerosmith_bench() as bench, RawTable(bench) as line:
        assert re.fullmatch(rb"[\d.]+\r\n>\r\n", line.says(b"PPO\r"))
        assert line.says(b"ACL20\r\n") == b"\r\n>\r\n"
        assert line.says(b"NONSENSE\r") == b"?\r\n>\r\n"
        assert line.says(b"JOG10\r") == b"?\r\n>\r\n"
