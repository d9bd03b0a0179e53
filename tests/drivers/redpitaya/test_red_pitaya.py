"""The digitizer: its driver and its simulator, over the wire between them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from fixture import EmptyRoom, Fixture, error_of, standing
from trigger_fixture import Room, Signal

from drivers.redpitaya.stemlab_125_14 import RedPitaya
from drivers.redpitaya.stemlab_settings import Record
from sim_instruments.redpitaya.stemlab_125_14 import RedPitaya as Board
from station.instruments.scan import recognised
from station.roles import Block

NAME = "digitizer"
TRUTH = {
    "os_version": "2.05-37",
    "jumper": "LV",
    "noise": "0 V",
    "gain_error": "0 %",
    "offset": "0 V",
    "clock_error": "0 ppm",
}
LSB_V = 1 / 8192


def ramp(after_s: np.ndarray) -> np.ndarray:
    """10 V/s for 0.2 s from the trigger on, nothing before it and after."""
    return np.where((after_s >= 0) & (after_s < 0.2), 10.0 * after_s, 0.0)


def flat(volts: float) -> Signal:
    return lambda after_s: np.full(after_s.shape, volts)


@contextmanager
def board(
    signal: Signal = ramp, *faults: dict[str, Any], room: Any = None, **truth: str
) -> Iterator[Fixture]:
    with standing(NAME, Board, {**TRUTH, **truth}, room or Room(signal), *faults) as fixture:
        yield fixture


@contextmanager
def opened(
    signal: Signal = ramp,
    *faults: dict[str, Any],
    room: Any = None,
    settings: dict[str, Any] | None = None,
    **truth: str,
) -> Iterator[tuple[Fixture, RedPitaya]]:
    with board(signal, *faults, room=room, **truth) as fixture:
        driver = RedPitaya(fixture.place(**(settings or {})))
        yield fixture, driver
        driver.close()


def record(fixture: Fixture, driver: RedPitaya) -> Block:
    for _ in range(1000):
        block = driver.fetch()
        if block is not None:
            return block
        fixture.clock.sleep(0.01)
    raise AssertionError("no record came")


def shot(fixture: Fixture, driver: RedPitaya) -> Block:
    driver.fire()
    block = record(fixture, driver)
    driver.release()
    return block


# The simulator, by a raw client.


def test_a_board_that_waits_for_nothing_says_triggered_and_a_floating_pin_reads_high() -> None:
    with board() as fixture, fixture.line() as line:
        assert line.ask("*IDN?") == "REDPITAYA,INSTR2024,0,01-02"
        assert line.ask("ACQ:TRIG:STAT?") == "TD"
        assert [line.ask(f"DIG:PIN? DIO0_{side}") for side in "NP"] == ["1", "1"]
        line.write("DIG:PIN DIO0_N,1")
        assert line.ask("SYST:ERR?").startswith("-221,")
        line.write("DIG:PIN:DIR OUT,DIO0_N")
        assert [line.ask(f"DIG:PIN? DIO0_{side}") for side in "NP"] == ["0", "0"]
        line.write("DIG:PIN DIO0_N,1")
        assert line.ask("DIG:PIN? DIO0_P") == "1"
        assert [kind for _, kind in fixture.room.edges] == ["rise"]


def test_a_capture_that_is_not_started_again_gives_the_old_values() -> None:
    with board() as fixture, fixture.line() as line:
        for text in ("ACQ:DEC 1024", "ACQ:TRIG:DLY -8000", "DIG:PIN:DIR OUT,DIO0_N", "ACQ:START"):
            line.write(text)
        line.write("ACQ:TRIG EXT_PE")
        assert line.ask("ACQ:TRIG:STAT?") == "WAIT"
        fixture.clock.sleep(0.01)
        line.write("DIG:PIN DIO0_N,1")
        assert line.ask("ACQ:TRIG:FILL?") == "0"
        fixture.clock.sleep(0.01)
        assert line.ask("ACQ:TRIG:FILL?") == "1"
        question = f"ACQ:SOUR1:DATA:START:N? {line.ask('ACQ:TPOS?')},5"
        before = line.ask(question)
        line.write("DIG:PIN DIO0_N,0")
        line.write("ACQ:TRIG EXT_PE")
        line.write("DIG:PIN DIO0_N,1")
        assert line.ask("ACQ:TRIG:STAT?;FILL?") == "TD;1"
        assert line.ask(question) == before


@pytest.mark.parametrize(
    ("version", "unknown"),
    [
        ("2.00-18", "ACQ:DEC:F?"),
        ("1.04-28", "ACQ:TRIG:FILL?"),
        ("1.04-28", "ACQ:SOUR1:DATA:START:N? 0,1"),
        ("2.04-18", "ACQ:SOUR1:DATA:STA:N? 0,1"),
    ],
)
def test_what_a_system_does_not_know_is_not_answered(version: str, unknown: str) -> None:
    with board(os_version=version) as fixture, fixture.line() as line:
        line.write(unknown)
        assert line.ask("SYST:ERR?").startswith("-113,")


# The driver.


def test_it_is_asked_with_its_own_line_end_and_is_found_by_a_scan() -> None:
    with opened() as (fixture, driver):
        driver.identify()
        assert ((">", b"*IDN?\r\n")) in fixture.heard
    for answer in ("REDPITAYA,INSTR2024,0,01-02", "REDPITAYA,INSTR2025,,01-21"):
        assert recognised("TCPIP::192.0.2.1::5000::SOCKET", answer).driver == "red-pitaya-125-14"


@pytest.mark.parametrize(
    ("version", "wanted_Hz", "decimation"),
    [
        ("2.05-37", 10e3, 12500),
        ("2.05", 1e3, 65536),
        ("2.07-48", 30e6, 4),
        ("2.00-18", 10e3, 8192),
        ("1.04-28", 10e3, 8192),
        ("1.03", 20e3, 1024),
    ],
)
def test_the_rate_is_the_nearest_one_at_or_above_the_wanted(
    version: str, wanted_Hz: float, decimation: int
) -> None:
    with opened(settings={"os_version": version}, os_version=version) as (_, driver):
        rate_Hz = driver.prepare(wanted_Hz, 100 / wanted_Hz, 1.0)
        assert rate_Hz == pytest.approx(125e6 / decimation)


@pytest.mark.parametrize("version", ["2.05-37", "2.00-30", "2.00-18", "1.04-28", "1.03"])
def test_time_zero_is_the_trigger_to_half_a_sample_on_every_system(version: str) -> None:
    with opened(settings={"os_version": version}, os_version=version) as (fixture, driver):
        rate_Hz = driver.prepare(10e3, 0.08, 1.0)
        offsets = []
        for _ in range(8):
            block = shot(fixture, driver)
            fixture.clock.sleep(0.3)
            time_s, volts = block.columns["time_s"], block.columns["voltage_V"]
            assert time_s[0] < -8 / rate_Hz * 0.999
            assert time_s[-1] >= 0.08
            begun = time_s > 0.01
            offset_s = (volts[begun] / 10.0 - time_s[begun]).mean()
            offsets.append(offset_s * rate_Hz)
            assert np.abs(volts[time_s < -1 / rate_Hz]).max() == 0.0
        assert np.abs(offsets).max() <= 0.5 + 0.02
        assert np.ptp(offsets) > 0.3, "sampling is in step with the trigger"
        assert abs(np.mean(offsets)) < 0.4


def test_a_long_buffer_comes_in_slices_that_are_each_one_short_exchange() -> None:
    with opened() as (fixture, driver):
        rate_Hz = driver.prepare(100e3, 0.155, 2 / 3)
        fixture.heard.clear()
        block = shot(fixture, driver)
        assert len(block) > 15_000
        assert np.diff(block.columns["time_s"]) == pytest.approx(1 / rate_Hz)
        asked = [data for data in fixture.sent() if b":N?" in data]
        assert len(asked) == -(-len(block) // 2048)
        clipped = block.columns["time_s"] > 0.1001
        assert (block.columns["voltage_V"][clipped] == 1.0 - round(LSB_V, 6)).all()


def test_the_window_holds_a_little_before_the_trigger_and_all_after_it() -> None:
    window = Record.of(12500, 0.1)
    assert (window.before, window.after, window.delay) == (21, 1001, 1003 - 8192)
    assert Record.of(1, 1e-7).before == 8
    assert Record.of(1250, 0.16).fits
    assert not Record.of(1250, 0.1607).fits


def test_gain_offset_and_clock_are_the_board_s_own() -> None:
    wrong = {"gain_error": "1 %", "offset": "20 mV", "clock_error": "1 %"}
    with opened(**wrong) as (fixture, driver):
        driver.prepare(10e3, 0.05, 1.0)
        columns = shot(fixture, driver).columns
        time_s, volts = columns["time_s"], columns["voltage_V"]
        begun = time_s > 0.01
        slope, level = np.polyfit(time_s[begun], volts[begun], 1)
        assert slope == pytest.approx(10.0 * 1.01 * 1.01, rel=1e-3)
        assert level == pytest.approx(0.02, abs=2e-3)


def test_noise_is_the_same_for_a_record_that_is_read_twice_and_another_for_the_next() -> None:
    def run() -> list[list[float]]:
        with opened(flat(0.1), noise="2 mV") as (fixture, driver):
            driver.prepare(10e3, 0.05, 1.0)
            return [shot(fixture, driver).columns["voltage_V"].tolist() for _ in range(2)]

    first, second = run()
    assert np.std(first) == pytest.approx(2e-3, rel=0.15)
    assert first != second
    assert run() == [first, second]


def test_jumpers_that_are_elsewhere_than_the_bench_says_scale_the_values() -> None:
    with opened(flat(0.5), settings={"jumper": "HV"}) as (fixture, driver):
        assert driver.full_scale_V == 20.0
        driver.prepare(10e3, 0.01, 15.0)
        assert shot(fixture, driver).columns["voltage_V"] == pytest.approx(10.0)


def test_an_input_that_is_not_connected_reads_zero_in_any_world() -> None:
    with opened(room=EmptyRoom()) as (fixture, driver):
        driver.prepare(10e3, 0.01, 1.0)
        assert (shot(fixture, driver).columns["voltage_V"] == 0.0).all()
    with opened(flat(0.5), settings={"channel": 2}) as (fixture, driver):
        driver.prepare(10e3, 0.01, 1.0)
        assert (shot(fixture, driver).columns["voltage_V"] == 0.0).all()


def test_the_edge_that_starts_the_record_is_the_one_that_others_get() -> None:
    with opened() as (fixture, driver):
        driver.prepare(10e3, 0.01, 1.0)
        assert not fixture.room.edges
        shot(fixture, driver)
        shot(fixture, driver)
        assert [kind for _, kind in fixture.room.edges] == ["rise", "fall"] * 2


def test_a_full_scale_beyond_the_jumpers_names_them() -> None:
    with opened() as (_, driver):
        assert "move the input's jumpers to HV" in error_of(lambda: driver.prepare(1e4, 0.01, 1.5))
    with opened(settings={"jumper": "HV"}, jumper="HV") as (_, driver):
        assert "put a divider" in error_of(lambda: driver.prepare(1e4, 0.01, 25.0))


def test_a_record_that_does_not_fit_is_refused_with_what_would() -> None:
    with opened() as (_, driver):
        text = error_of(lambda: driver.prepare(10e3, 2.0, 1.0))
        assert "its 16384 values hold 1.6 s" in text
        assert driver.prepare(10e3, 1.6, 1.0) == pytest.approx(10e3)


def test_a_wrong_system_version_is_noticed_by_reading_back() -> None:
    with opened(settings={"os_version": "2.05"}, os_version="2.00-18") as (_, driver):
        assert "ACQ:DEC:F?': no answer came" in error_of(lambda: driver.prepare(10e3, 0.05, 1.0))
    with opened(settings={"os_version": "1.04"}, os_version="1.03") as (_, driver):
        text = error_of(lambda: driver.prepare(50e3, 0.05, 1.0))
        assert "ACQ:DEC? reads '1' where 2048 belongs" in text
        assert "settings.os_version" in text


def test_a_trigger_wire_that_is_not_seated_is_noticed_before_anything_is_triggered() -> None:
    with opened(ramp, {"fault": "no-trigger"}) as (fixture, driver):
        text = error_of(lambda: driver.prepare(10e3, 0.05, 1.0))
        assert "DIG:PIN? DIO0_P reads '1' where 0 belongs" in text
        assert "seat the wire between DIO0_N and DIO0_P" in text
        assert not fixture.room.edges


def test_a_trigger_that_never_comes_is_told_at_once() -> None:
    with opened(ramp, {"fault": "no-trigger", "command": "ACQ:START"}) as (fixture, driver):
        driver.prepare(10e3, 0.05, 1.0)
        assert "ACQ:TRIG:STAT? reads 'WAIT' where TD belongs" in error_of(driver.fire)
        driver.make_safe(fixture.clock.now() + 5.0)
        assert driver.read_safety().safe
        assert not fixture.room.trigger.high


@pytest.mark.parametrize("command", ["ACQ:START", "ACQ:TRIG EXT_PE", "DIG:PIN DIO0_N,1"])
def test_a_command_that_is_lost_never_gives_an_old_record(command: str) -> None:
    fault = {"fault": "lost-command", "command": command, "nth": 2}
    with opened(ramp, fault) as (fixture, driver):
        driver.prepare(10e3, 0.05, 1.0)
        shot(fixture, driver)
        assert "where" in error_of(driver.fire)


def test_a_record_that_does_not_end_is_an_error() -> None:
    with opened(ramp, {"fault": "lost-command", "command": "ACQ:START"}) as (fixture, driver):
        driver.prepare(10e3, 0.05, 1.0)
        driver.fire()
        assert "ACQ:TRIG:FILL? still reads 0" in error_of(lambda: record(fixture, driver))
        assert fixture.clock.now() < 3.0


def test_an_input_beyond_its_range_is_kept_at_full_scale() -> None:
    with opened(flat(0.2), {"fault": "overload", "at": "0 s"}) as (fixture, driver):
        driver.prepare(10e3, 0.05, 1.0)
        volts = shot(fixture, driver).columns["voltage_V"]
        assert (volts >= driver.full_scale_V - 2 * LSB_V).all()


def test_one_lost_answer_does_not_keep_the_trigger_from_rest() -> None:
    for command in ("DIG:PIN:DIR? DIO0_N", "DIG:PIN? DIO0_N"):
        fault = {"fault": "no-reply", "command": command, "at": "1 s"}
        with opened(ramp, fault) as (fixture, driver):
            driver.prepare(10e3, 0.05, 1.0)
            driver.fire()
            assert not driver.read_safety().safe
            fixture.clock.sleep_until(1.0)
            driver.make_safe(fixture.clock.now() + 5.0)
            assert driver.read_safety() == type(driver.read_safety())(True, "trigger output low")
            assert not fixture.room.trigger.high


def test_an_interlock_can_ask_for_the_voltage_at_any_time() -> None:
    with opened(flat(0.25)) as (fixture, driver):
        assert driver.read_quantity("voltage") is None
        driver.prepare(10e3, 0.2, 1.0)
        assert driver.read_quantity("voltage") == pytest.approx(0.25)
        driver.fire()
        fixture.clock.sleep(0.05)
        assert driver.read_quantity("voltage") == pytest.approx(0.25)
        assert len(record(fixture, driver)) == Record.of(12500, 0.2).length
        assert fixture.newest("voltage") == pytest.approx(0.25)


@pytest.mark.parametrize("fault", ["no-reply", "nan"])
def test_a_record_whose_answer_was_lost_is_still_in_the_board(fault: str) -> None:
    with opened(flat(0.2), {"fault": fault, "command": ":N?"}) as (fixture, driver):
        driver.prepare(10e3, 0.05, 1.0)
        driver.fire()
        error_of(lambda: record(fixture, driver))
        assert record(fixture, driver).columns["voltage_V"] == pytest.approx(0.2, abs=LSB_V)
