"""What goes over the navigator's lines, byte by byte and bit by bit, and in its own world."""

from __future__ import annotations

import random
import struct
from typing import Any

import cantools
import numpy as np
import pytest
from fixture import standing
from navigator_fixture import (
    KINDS,
    NAME,
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
from drivers.generic.serial_navigator import SerialNavigator
from drivers.transport.can_line import CanLine
from drivers.transport.can_messages import decoder_of, message_file
from drivers.transport.serial_stream import crc32_stim300
from sim_instruments.bench import SimulatedBench
from sim_instruments.generic.serial_navigator import SerialNavigator as SimulatedOnSerial
from sim_instruments.wire.frames import crc32
from station.clock import Clock, RealClock, VirtualClock
from station.errors import InstrumentError
from station.instruments.opening import Place

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


def test_a_frame_of_another_length_is_none_of_its_messages() -> None:
    entry = {"fault": "partial", "command": "0B1", "nth": 3, "count": 1}
    with navigator("can", entry) as (fixture, driver):
        driver.start(10.0)
        fixture.clock.sleep(2.0)
        with pytest.raises(InstrumentError, match=r"0B1#.* is none of its messages; check"):
            driver.drain()


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
    return driver(Place(NAME, simulation.instruments[NAME]["address"], clock))


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
        outer = simulation._world.table.axis(1)
        outer.move_to(clock.now(), 90.0, 10.0, 20.0)
        clock.sleep(30.0)
        heading = driver.drain().columns["heading_deg"]
        turned = (heading[-1] - heading[-35]) % 360.0
        assert turned == pytest.approx(90.0, abs=0.05)
        driver.close()
    simulation.close()
    clock.stop()
