"""The rotary stage: its driver and its simulator, over the wire between them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from fixture import error_of
from stage_bench import LIMITS, STAGE, RawStage, stage_bench
from variants import variant

from sim_instruments.world.rotation import RotationHistory
from station.errors import InstrumentError

ARCSEC_DEG = 1 / 3600


def at(time_s: float) -> np.ndarray:
    return np.array([time_s])


# Where the axis is.


def test_a_movement_takes_what_its_limits_give() -> None:
    axis = RotationHistory()
    # 10 deg at 20 deg/s and 40 deg/s^2: half a second each to speed up and to brake.
    assert axis.move_to(1.0, 10.0, 20.0, 40.0) == pytest.approx(2.0)
    assert axis.angle_deg(at(1.5))[0] == pytest.approx(5.0)
    assert axis.rate_deg_per_s(at(1.5))[0] == pytest.approx(20.0)
    assert axis.move_to(3.0, 110.0, 20.0, 40.0) == pytest.approx(3.0 + 1.0 + 90.0 / 20.0)
    assert axis.angle_deg(at(1e6))[0] == 110.0
    assert axis.angle_deg(at(1.5))[0] == pytest.approx(5.0), "the past has changed"


def test_a_movement_that_is_changed_on_its_way_stays_smooth_and_arrives() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        axis, time_s = RotationHistory(rng.uniform(-90, 90)), 0.0
        for _ in range(5):
            rate, speed_up, brake = rng.uniform(1, 40, 3)
            if rng.random() < 0.7:
                target = rng.uniform(-180, 180)
                end_s = axis.move_to(time_s, target, rate, speed_up, brake)
                assert axis.angle_deg(at(end_s))[0] == target
            else:
                end_s = axis.turn_at(time_s, rng.uniform(-40, 40), speed_up)
            time_s += rng.uniform(0.0, 1.3) * (end_s - time_s)
        times_s = np.linspace(0.0, end_s + 1.0, 5001)
        step_s = times_s[1]
        rates = axis.rate_deg_per_s(times_s)
        assert np.abs(np.diff(rates)).max() <= 40.0 * step_s * 1.001
        middle = 0.5 * (rates[1:] + rates[:-1]) * step_s
        assert np.abs(np.diff(axis.angle_deg(times_s)) - middle).max() <= 40.0 * step_s**2


def test_a_table_keeps_its_rate_until_it_is_stopped() -> None:
    axis = RotationHistory()
    assert axis.turn_at(0.0, -10.0, 5.0) == pytest.approx(2.0)
    assert axis.angle_deg(at(12.0))[0] == pytest.approx(-110.0)
    assert axis.at_rest_from_s == np.inf
    assert axis.stop(12.0) == pytest.approx(14.0)
    assert axis.angle_deg(at(20.0))[0] == pytest.approx(-120.0)


# The simulator, by a raw client.


def test_the_controller_says_who_it_is_and_joins_answers_by_lines() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        assert line.lines("VE?") == ["ESP301 Version 3.0.1 6/1/99"]
        assert line.lines("1ID?") == ["URS100BPP, SNB1234"]
        assert line.lines("1MD?; 1mo?;TE?") == ["1", "0", "0"]


def test_errors_come_only_when_asked_for_oldest_first_and_ten_at_most() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        bench.clock.sleep(2.0)
        for text in ("XX", "1QQ5", "PA5", "1PA", "4PA5", "2PA5", "1PAx", "1PA5", "1VA100", "1SN2"):
            line.tell(text)
        line.tell("1VA-1")
        assert re.fullmatch(r"6, 5\d\d\d, COMMAND DOES NOT EXIST", line.lines("TB?")[0])
        codes = [line.code() for _ in range(10)]
        assert codes == [6, 37, 38, 9, 208, 7, 113, 110, 101, 0]
        line.tell("1PA" + "0" * 80)
        assert line.code() == 7


def test_the_driver_takes_all_that_is_kept_and_leaves_nothing() -> None:
    with stage_bench() as bench:
        with RawStage(bench) as line:
            for text in ("XX", "PA5", "4PA5"):
                line.tell(text)
        stage = bench.driver()
        kept = stage.take_errors()
        assert kept[0] == "6, COMMAND DOES NOT EXIST"
        assert [one.partition(",")[0] for one in kept] == ["6", "37", "9"]
        assert stage.take_errors() == []
        stage.close()


def test_the_angle_is_unknown_until_the_index_is_found() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        assert abs(line.value("1TP?")) < 2 * ARCSEC_DEG
        line.tell("1MO")
        line.tell("1OR1")
        assert line.value("1MD?") == 0
        line.tell("1PA5")
        assert line.code() == 130
        began_s = bench.clock.now()
        while line.value("1MD?") == 0:
            bench.clock.sleep(0.1)
        assert 2.0 < bench.clock.now() - began_s < 10.0
        assert line.code() == 0
        assert abs(line.value("1TP?")) < 2 * ARCSEC_DEG
        true_deg = bench.rotation.angle_deg(at(bench.clock.now()))[0]
        assert true_deg == pytest.approx(-10 * ARCSEC_DEG, abs=1e-9)


def test_a_stop_in_the_search_breaks_it_off() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        line.tell("1MO;1OR1")
        bench.clock.sleep(0.3)
        line.tell("1ST")
        bench.clock.sleep(2.0)
        assert line.lines("1MD?;TE?;TE?") == ["1", "120", "0"]


def test_software_limits_and_a_motor_that_is_off_refuse_a_movement() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        line.tell("1SL-10;1SR10;1PA5;1MO;1PA11;1PA-11;1SL20;1PA9")
        assert [line.code() for _ in range(5)] == [113, 106, 107, 101, 0]
        bench.clock.sleep(5.0)
        assert line.value("1DP?") == pytest.approx(9.0)
        line.tell("1PR-3")
        bench.clock.sleep(5.0)
        assert line.value("1TP?") == pytest.approx(6.0, abs=2 * ARCSEC_DEG)


# The driver.


def test_the_stage_goes_to_its_angles_and_the_world_turns_with_it() -> None:
    with stage_bench() as bench:
        stage = bench.homed()
        for angle_deg in (0.0, 45.0, 360.0, -170.0):
            stage.move_to(angle_deg)
            assert stage.is_moving()
            bench.wait(stage)
            assert stage.angle_deg() == pytest.approx(angle_deg, abs=2 * ARCSEC_DEG)
            true_deg = bench.rotation.angle_deg(at(bench.clock.now()))[0]
            assert true_deg == pytest.approx(angle_deg - 10 * ARCSEC_DEG, abs=1e-6)
        said = bench.readings.newest(STAGE, "motion")
        assert said is not None and said.value == "at-rest"


def test_the_limits_are_in_the_controller() -> None:
    with stage_bench() as bench:
        bench.driver().programme_limits()
        with RawStage(bench) as line:
            values = [line.value(f"1{name}?") for name in ("VA", "VU", "AC", "AG", "AU")]
            assert values == [20.0, 20.0, 40.0, 40.0, 40.0]
            assert [line.value("1SL?"), line.value("1SR?")] == [-175.0, 365.0]


def test_limits_that_lie_beside_the_present_ones_are_written_in_the_right_order() -> None:
    with stage_bench() as bench:
        bench.driver({**LIMITS, "angle_low": 400.0, "angle_high": 500.0}).programme_limits()
        bench.driver({**LIMITS, "angle_low": -500.0, "angle_high": -400.0}).programme_limits()


def test_a_stage_that_protects_its_settings_is_used_at_the_bench_s_rate() -> None:
    with stage_bench({"settings_protected": True}) as bench:
        bench.driver().programme_limits()
        with RawStage(bench) as line:
            assert line.lines("1VA?;1VU?;TE?") == ["20.000000", "80.000000", "0"]
        with pytest.raises(
            InstrumentError, match=r"the stage ends at 80 deg/s; lower limits\.rate"
        ):
            bench.driver({**LIMITS, "rate": 90.0}).programme_limits()


def test_a_stage_without_a_rate_limit_does_not_turn() -> None:
    with stage_bench() as bench:
        stage = bench.driver({"acceleration": 10.0})
        with pytest.raises(InstrumentError, match=r"it gives no limits\.rate"):
            stage.home()
        assert not stage.is_moving()


def test_errors_of_others_are_not_taken_for_ours() -> None:
    with stage_bench() as bench:
        with RawStage(bench) as line:
            line.tell("XX;1PA5;1VA1000")
        stage = bench.homed()
        stage.move_to(5.0)


def test_a_following_error_is_named_and_asks_for_homing() -> None:
    with stage_bench(None, {"fault": "following-error", "command": "1PA"}) as bench:
        stage = bench.homed()
        stage.move_to(90.0)
        text = error_of(lambda: bench.wait(stage))
        assert "following error" in text and "error 103" in text and "homes it" in text
        assert stage.read_safety().safe
        assert not stage.is_homed()
        assert 10.0 < bench.rotation.angle_deg(at(bench.clock.now()))[0] < 60.0


def test_the_emergency_stop_is_named_and_holds_until_it_is_released() -> None:
    fault = {"fault": "emergency-stop", "at": "60 s", "for": "10 s"}
    with stage_bench(None, fault) as bench:
        stage = bench.homed()
        bench.clock.sleep_until(58.0)
        stage.move_to(90.0)
        text = error_of(lambda: bench.wait(stage))
        assert "the emergency stop was pressed (error 4" in text
        assert "nobody is in danger" in text
        assert "emergency stop" in error_of(stage.home)
        bench.clock.sleep_until(71.0)
        stage.home()
        bench.wait(stage)
        assert stage.is_homed()


def test_a_motor_that_somebody_switched_off_is_named() -> None:
    with stage_bench() as bench:
        stage = bench.homed()
        with RawStage(bench) as line:
            line.tell("1MF")
            text = error_of(lambda: stage.move_to(20.0))
            assert "the motor is off (error 113, MOTOR NOT ENABLED)" in text
            assert not stage.is_homed()


def test_an_encoder_that_jumps_is_noticed_at_rest() -> None:
    with stage_bench(None, {"fault": "encoder-jump", "at": "60 s"}) as bench:
        stage = bench.homed()
        stage.move_to(30.0)
        bench.wait(stage)
        stage.angle_deg()
        bench.clock.sleep_until(61.0)
        text = error_of(stage.angle_deg)
        assert re.search(r"the encoder reads 30\.05\d* deg where 30\.00000 deg was commanded", text)
        assert not stage.is_homed()


def test_a_blocked_stage_is_noticed_and_homing_finds_its_lost_steps() -> None:
    fault = {"fault": "stuck", "at": "60 s", "for": "20 s"}
    with stage_bench(None, fault) as bench:
        stage = bench.homed()
        bench.clock.sleep_until(59.0)
        stage.move_to(90.0)
        bench.wait(stage)
        assert "look for a blocked stage" in error_of(stage.angle_deg)
        bench.clock.sleep_until(81.0)
        stage.home()
        bench.wait(stage)
        stage.move_to(90.0)
        bench.wait(stage)
        assert stage.angle_deg() == pytest.approx(90.0, abs=2 * ARCSEC_DEG)


def test_a_movement_that_does_not_end_is_an_error() -> None:
    with stage_bench({"settling": "1 h"}) as bench:
        stage = bench.driver()
        stage.home()
        text = error_of(lambda: bench.wait(stage))
        assert "has not settled" in text
        assert bench.clock.now() == pytest.approx(120.0, abs=1.0)


def test_the_stage_is_stopped_with_its_deceleration_and_stays_on() -> None:
    with stage_bench() as bench:
        stage = bench.homed()
        stage.move_to(180.0)
        bench.clock.sleep(3.0)
        assert not stage.read_safety().safe
        began_s = bench.clock.now()
        stage.make_safe(began_s + 10.0)
        assert 0.5 <= bench.clock.now() - began_s < 1.5
        reading = stage.read_safety()
        assert reading.safe and "motor on" in reading.read_back
        times_s = np.linspace(began_s - 1.0, bench.clock.now(), 2000)
        slope = np.diff(bench.rotation.rate_deg_per_s(times_s)) / np.diff(times_s)
        assert np.abs(slope).max() <= 40.0 * 1.001
        assert stage.is_homed()
        stage.move_to(0.0)


def test_a_stop_while_homing_leaves_no_error_behind_and_no_zero() -> None:
    with stage_bench() as bench:
        stage = bench.driver()
        stage.home()
        bench.clock.sleep(0.5)
        stage.make_safe(bench.clock.now() + 10.0)
        assert stage.read_safety().safe
        assert not stage.is_homed()
        stage.home()
        bench.wait(stage)
        assert stage.is_homed()


def test_one_lost_answer_does_not_keep_it_from_stopping() -> None:
    for command in ("1ST", "1MD?"):
        fault = {"fault": "no-reply", "command": command, "at": "60 s"}
        with stage_bench(None, fault) as bench:
            stage = bench.homed()
            stage.move_to(170.0)
            bench.clock.sleep_until(60.0)
            stage.move_to(-170.0)
            bench.clock.sleep(2.0)
            stage.make_safe(bench.clock.now() + 10.0)
            assert stage.read_safety().safe


@pytest.mark.parametrize(
    ("quantity", "value"), [("motion", "moving"), ("rate", 20.0), ("angle", 35.0)]
)
def test_an_interlock_can_ask_for_it_at_any_time(quantity: str, value: Any) -> None:
    with stage_bench() as bench:
        stage = bench.homed()
        stage.move_to(180.0)
        bench.clock.sleep(2.0)
        assert stage.read_quantity(quantity) == pytest.approx(value, abs=0.01)


# Stages of several kinds.


SHIPPED = (STAGE, "accelerometer-magnetic-sensitivity")


@pytest.mark.parametrize("protected", [False, True])
def test_a_stage_that_protects_its_settings_is_noted(protected: bool) -> None:
    with variant(*SHIPPED, settings_protected=protected) as here:
        here.driver().programme_limits()
        assert here.met() == (["keeps its own VU", "keeps its own AU"] if protected else [])


def test_a_movement_that_somebody_waits_for_delays_the_driver_and_ends_where_it_should() -> None:
    with variant(*SHIPPED) as here:
        stage = here.driver()
        stage.home()
        while stage.is_moving():
            here.clock.sleep(0.05)
        began_s = here.clock.now()
        stage._line.command("1PA0.1;1WS")
        assert here.clock.now() - began_s > 0.2, "the settling at least"
        assert not stage.is_moving()
        assert stage.angle_deg() == pytest.approx(0.1, abs=0.002)
