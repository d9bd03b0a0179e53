"""The navigator on CAN and on RS-422: drivers and simulators, and what goes over their lines."""

from __future__ import annotations

import random
import struct
from typing import Any

import cantools
import numpy as np
import pytest
from fixture import EmptyRoom, error_of, recorded, standing
from navigator_fixture import (
    KINDS,
    LATENCY_S,
    NAME,
    RESOLUTION_DEG,
    STRETCH,
    TRUTH,
    Plate,
    RawLine,
    bench_of,
    bitwise_crc,
    navigator,
    raw_frame,
    raw_frames,
)
from places import CONFIG

from drivers.generic.can_navigator import CanNavigator
from drivers.generic.navigator import fault_words
from drivers.generic.serial_navigator import SerialNavigator
from drivers.transport.can_line import CanLine
from drivers.transport.can_messages import decoder_of, message_file
from drivers.transport.serial_stream import crc32_stim300
from sim_instruments.bench import SimulatedBench
from sim_instruments.generic.serial_navigator import SerialNavigator as SimulatedOnSerial
from sim_instruments.truth import SimulationError
from sim_instruments.wire.frames import crc32
from station.clock import Clock, RealClock, VirtualClock
from station.errors import InputError
from station.instruments.opening import InstrumentPlace
from station.roles import NavigatorStatus

both = pytest.mark.parametrize("kind", KINDS)


# Outputs.


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
            text = error_of(act, argument)
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
        text = error_of(driver.read_quantity, "temperature")
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
def test_what_it_finds_wrong_with_itself_is_reported(kind: str, fault: str, word: str) -> None:
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


# What goes wrong on its line.


@both
@pytest.mark.parametrize("rate_Hz", [0.9, 10.1])
def test_the_navigator_itself_refuses_too(kind: str, rate_Hz: float) -> None:
    with navigator(kind) as (fixture, driver):
        driver._send("start", 7, {"rate_Hz": rate_Hz})
        (answer,) = driver._commands._line.wait_for("acknowledgement", fixture.clock.now() + 0.5)
        assert (answer["request_id"], str(answer["result"])) == (7, "bad_rate")
        driver.start(1.0)
        driver._send("start", 8, {"rate_Hz": 1.0})
        (answer,) = driver._commands._line.wait_for("acknowledgement", fixture.clock.now() + 0.5)
        assert str(answer["result"]) == "already_running"


FOG = "fog-scale-factor-temperature"
START, STOP, IDENTIFY, STATUS, ALIGN = 1, 2, 3, 4, 5


# CAN.


def test_the_message_file_describes_all_messages() -> None:
    messages = message_file("navigator").messages
    assert {one.name for one in messages} == {
        "NAV_COMMAND",
        "NAV_ACK",
        "NAV_STATUS",
        "NAV_IDENTITY",
        "NAV_HEADING",
        "NAV_ROLL",
        "NAV_TEMPERATURES",
    }
    assert all(one.comment for one in messages)
    board = cantools.database.load_file(str(CONFIG / "dbc" / "pulse_board.dbc"))
    shared = {one.frame_id for one in messages} & {one.frame_id for one in board.messages}
    assert not shared, "on one bus with the pulse board they would be mixed up"


@pytest.mark.parametrize("name", ["NAV_HEADING", "NAV_ROLL", "NAV_TEMPERATURES"])
def test_the_fast_decoder_agrees_with_the_library(name: str) -> None:
    message = message_file("navigator").get_message_by_name(name)
    decode, rng = decoder_of(message), random.Random(1)
    for data in (bytes(8), b"\xff" * 8, *(rng.randbytes(8) for _ in range(200))):
        cut = data[: message.length]
        expected = message.decode(cut)
        assert decode(cut) == pytest.approx(tuple(expected.values()), rel=1e-12)


def test_an_output_on_can_as_the_library_reads_it() -> None:
    with navigator("can") as (fixture, driver):
        driver.align(45.0)
        fixture.clock.sleep(110.0)
        driver.start(1.0)
        fixture.clock.sleep(1.5)
        frames = [data.split(b" ")[0] for direction, data in fixture.heard if direction == "<"]
        database = message_file("navigator")
        told: dict[str, Any] = {}
        for text in frames[-3:]:
            identifier, data = text.decode("ascii").split("#")
            told |= database.decode_message(int(identifier, 16), bytes.fromhex(data))
        block = driver.drain()
        assert told["counter"] == 1 and told["status"] == 1
        assert told["heading"] == pytest.approx(block.columns["heading_deg"][0], abs=1e-9)
        assert told["pitch"] == pytest.approx(block.columns["pitch_deg"][0], abs=1e-9)
        assert told["pitch"] < -44 and told["roll"] < -160


def test_what_the_interface_on_can_cannot_do_is_refused() -> None:
    with navigator("can") as (fixture, _):
        line = CanLine(fixture.place(), {0x0A1: "NAV_ACK"})

        def answer(data: bytes) -> tuple[int, ...]:
            line.send(0x0A0, data)
            (found,) = line.wait_for(0x0A1, fixture.clock.now() + 0.5)
            command, result, request, rate = struct.unpack("<BBHB3x", found.data)
            return command, result, request, rate

        assert answer(struct.pack("<BBHi", 99, 0, 4711, 0)) == (99, 1, 4711, 0)
        assert answer(struct.pack("<BBHi", ALIGN, 0, 1, 900_000_001)) == (ALIGN, 3, 1, 0)
        assert answer(b"\x01\x0a") == (START, 5, 0, 0)
        assert answer(struct.pack("<BBHi", START, 25, 2, 0)) == (START, 0, 2, 25)
        line.close()


# RS-422.


def test_three_ways_to_the_same_checksum() -> None:
    rng = random.Random(2)
    for length in range(41):
        data = rng.randbytes(length)
        assert crc32_stim300(data) == crc32(data) == bitwise_crc(data)


def command(number: int, argument: int, request: int = 9) -> bytes:
    return raw_frame(0x10, struct.pack(">BHi", number, request, argument))


def test_the_serial_layout_byte_by_byte() -> None:
    with standing(NAME, SimulatedOnSerial, TRUTH, Plate()) as fixture:
        line = RawLine(fixture)
        (ack, identity) = line.send(command(IDENTIFY, 0, 0x1234))
        assert ack == (0x91, bytes.fromhex("03 00 1234 00"))
        assert identity == (0x93, bytes.fromhex("00000000 01 00 01 01"))
        assert line.send(command(ALIGN, 450_000_000)) == [(0x91, bytes.fromhex("05 00 0009 00"))]
        assert fixture.room.latitudes == [45.0]
        (_, status) = line.send(command(STATUS, 0))
        assert status == (0x92, bytes.fromhex("0002 0001 0000 00"))
        fixture.clock.sleep(100.0)
        began_s = fixture.clock.now()
        assert line.send(command(START, 20)) == [(0x91, bytes.fromhex("01 00 0009 14"))]
        fixture.clock.sleep(0.5)
        line.received = b""
        fixture.clock.sleep(0.5)
        ((kind, payload),) = raw_frames(line.received)
        counter, heading, pitch, roll, x, y, z, bits = struct.unpack(">HIii3hH", payload)
        assert (kind, counter, bits) == (0x90, 2, 1)
        at = np.array([began_s + 2 * 0.5 * (1 + 200e-6)])
        true = fixture.room.navigator_attitude(at)[0]
        assert [heading * 1e-7, pitch * 1e-7, roll * 1e-7] == pytest.approx(true, abs=6e-5)
        warm = fixture.room.gyro_temperature_degC(at)[0]
        assert [x * 0.01, y * 0.01, z * 0.01] == pytest.approx(warm, abs=0.0051)
        line.close()


def test_what_the_serial_interface_cannot_do_is_refused() -> None:
    with standing(NAME, SimulatedOnSerial, TRUTH, Plate()) as fixture:
        line = RawLine(fixture)
        assert line.send(command(99, 0)) == [(0x91, bytes.fromhex("63 01 0009 00"))]
        assert line.send(command(START, 101)) == [(0x91, bytes.fromhex("01 02 0009 00"))]
        assert line.send(command(ALIGN, -900_000_001)) == [(0x91, bytes.fromhex("05 03 0009 00"))]
        assert line.send(raw_frame(0x10, b"\x01\x00")) == [(0x91, bytes.fromhex("01 05 0000 00"))]
        assert line.send(raw_frame(0x10, b"")) == [(0x91, bytes.fromhex("00 05 0000 00"))]
        wrong = bytearray(command(IDENTIFY, 0))
        wrong[-1] ^= 1
        assert line.send(bytes(wrong)) == []
        # What follows rubbish is found, in pieces too.
        assert line.send(b"\x9a\x9a\x65" + command(STOP, 0)[:5]) == []
        assert len(line.send(command(STOP, 0)[5:] + command(STOP, 0))) == 2
        line.close()


def test_a_new_client_takes_the_serial_line_over() -> None:
    with navigator("serial") as (fixture, driver):
        driver.start(10.0)
        fixture.clock.sleep(2.0)
        driver.close()
        again = SerialNavigator(fixture.place())
        assert again.identify().serial == "0"
        again.start(5.0)
        fixture.clock.sleep(2.0)
        assert len(again.drain()) == 9
        again.close()


# Its own world.


def opened(kind: str, simulation: SimulatedBench, clock: Clock) -> Any:
    driver: Any = CanNavigator if kind == "can" else SerialNavigator
    return driver(InstrumentPlace(NAME, simulation.instruments[NAME]["address"], clock))


@pytest.mark.parametrize("kind", KINDS)
def test_in_real_time_too(kind: str) -> None:
    clock = RealClock()
    simulation = SimulatedBench(bench_of(kind), clock, FOG)
    simulation.act("dut-power-on")
    driver = opened(kind, simulation, clock)
    driver.start(10.0)
    clock.sleep(0.55)
    block = driver.drain()
    assert block.columns["counter"][0] == 1 and len(block) > 1
    assert driver.status().faults == ()
    driver.close()
    simulation.close()


@pytest.mark.parametrize("kind", KINDS)
def test_in_the_fog_world_it_aligns_and_shows_the_turn_of_the_table(kind: str) -> None:
    clock = VirtualClock()
    simulation = SimulatedBench(bench_of(kind), clock, FOG)
    with clock.participant("test"):
        driver = opened(kind, simulation, clock)
        assert driver.status().faults == ("switched off",)
        simulation.act("dut-power-on")
        driver.align(39.9)
        driver.start(1.0)
        clock.sleep(330.0)
        assert driver.status().aligned
        outer = simulation._world.table.axis(1 if kind == "can" else 3)
        outer.move_to(clock.now(), 90.0, 10.0, 20.0)
        clock.sleep(30.0)
        heading = driver.drain().columns["heading_deg"]
        turned = (heading[-1] - heading[-35]) % 360.0
        assert turned == pytest.approx(90.0, abs=0.05)
        driver.close()
    simulation.close()
    clock.stop()
