"""Modbus on the wire: what a raw client sees, and what the drivers make of what goes wrong."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from fixture import error_of
from places import ROOT
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from watlow_fixture import NAME, Fixture, controller

from drivers.transport.exchanges import NEVER, Repeatable
from drivers.transport.modbus_line import ModbusLine, ModbusRefusal, ModbusSettings
from sim_instruments.wire.modbus import ModbusError, Parameter, Registers, crc16, fixed
from station.clock import RealClock, VirtualClock
from station.conformance.faulty_server import FaultyServer
from station.instruments.opening import InstrumentPlace
from station.roles.patience import patience

SETTINGS = ModbusSettings(baud_rate=19200)
MODELS = ("f4t", "f4")
PROCESS = {"f4t": (2820, 2), "f4": (100, 1)}


@contextmanager
def line(
    model: str, *faults: dict[str, object], repeatable: Repeatable = NEVER
) -> Iterator[tuple[Fixture, ModbusLine]]:
    with controller(model, *faults) as fixture:
        opened = ModbusLine(fixture.place(), SETTINGS, repeatable)
        yield fixture, opened
        opened.close()


# The simulated devices, by a raw client.


def test_a_frame_may_come_in_pieces_and_the_answer_comes_in_one() -> None:
    with controller("f4t") as fixture, fixture.line() as raw:
        frame = struct.pack(">HHHBBHH", 7, 0, 6, 1, 3, 2730, 1)
        for piece in (frame[:3], frame[3:7], frame[7:9]):
            raw._send(piece)
            fixture.clock.sleep(1e-3)
        answer = raw.raw_ask(frame[9:])
        assert answer == struct.pack(">HHHBBBH", 7, 0, 5, 1, 3, 2, 62)


def test_two_requests_at_once_are_answered_one_after_the_other() -> None:
    with controller("f4t") as fixture, fixture.line() as raw:
        frames = [struct.pack(">HHHBBHH", n, 0, 6, 1, 3, 2730, 1) for n in (1, 2)]
        answer = raw.raw_ask(b"".join(frames))
        while len(answer) < 22:
            answer += raw._socket.recv(64)
        assert [answer[:2], answer[11:13]] == [b"\x00\x01", b"\x00\x02"]


@pytest.mark.parametrize(
    ("request_hex", "code"),
    [
        ("2b0e0100", 1),  # device identification
        ("0103e80001", 1),  # coils
        ("0327100001", 2),  # no such register
        ("030b030001", 2),  # between two parameters
        ("0604180001", 2),  # read-only or nothing
        ("030aaa0000", 3),  # no registers at all
        ("030aaa007e", 3),  # more than 125
        ("060aaa0001", 3),  # no such mode
        ("10ade0000204000041", 3),  # count and length disagree
        ("0383b60001", 4),  # module 1 is not fitted
    ],
)
def test_what_cannot_be_done_is_an_exception(request_hex: str, code: int) -> None:
    request = bytes.fromhex(request_hex)
    with controller("f4t") as fixture, fixture.line() as raw:
        assert raw.pdu(request) == bytes([request[0] | 0x80, code])


def test_functions_3_and_4_read_the_same_and_another_unit_stays_silent() -> None:
    with controller("f4t") as fixture, fixture.line() as raw:
        assert raw.pdu(bytes.fromhex("040aaa0001")) == bytes.fromhex("0402003e")
        assert raw.pdu(bytes.fromhex("030aaa0001"), unit=255) == bytes.fromhex("0302003e")
        raw._send(struct.pack(">HHHBBHH", 1, 0, 6, 9, 3, 2730, 1))
        assert not raw._wire.wait(fixture.clock.now() + 1.0)


def test_a_header_that_is_none_ends_the_connection() -> None:
    with controller("f4t") as fixture, fixture.line() as raw:
        assert raw.raw_ask(b"*IDN?\r\n*IDN?\r\n") == b""


def test_nothing_is_written_where_a_part_cannot_be() -> None:
    kept = []
    registers = Registers({10: Parameter(lambda: (1,), kept.append), 11: fixed(5)})
    assert registers.answer(struct.pack(">BHHBHH", 16, 10, 2, 4, 7, 8)) == bytes([0x90, 2])
    assert kept == []
    assert registers.answer(struct.pack(">BHHBH", 16, 10, 1, 2, 7)) == struct.pack(
        ">BHH", 16, 10, 1
    )
    assert kept == [(7,)]


def test_the_check_sum_is_the_standards_own() -> None:
    assert crc16(b"123456789") == 0x4B37
    assert crc16(bytes.fromhex("010200010002") + struct.pack("<H", 0x0BA8)) == 0
    for data in (b"\x01\x03\x00\x64\x00\x01", bytes(range(256))):
        assert FramerRTU.compute_CRC(data) == int.from_bytes(struct.pack("<H", crc16(data)), "big")


def test_an_rtu_device_answers_only_what_is_whole_right_and_for_it() -> None:
    def frame(data: str) -> bytes:
        body = bytes.fromhex(data)
        return body + struct.pack("<H", crc16(body))

    with controller("f4") as fixture, fixture.line() as raw:
        assert raw.raw_ask(frame("010300000001")) == frame("01030214 96".replace(" ", ""))
        for wrong in (
            frame("010300000001")[:-1] + b"\x00",
            frame("020300000001"),
            frame("000600640001"),
            frame("010300000001")[:5],
            b"VE?\r",
        ):
            raw._send(wrong)
            assert not raw._wire.wait(fixture.clock.now() + 0.2), wrong
        assert raw.raw_ask(frame("010700")) == frame("018701")


# The line of the drivers.


@pytest.mark.parametrize("model", MODELS)
def test_what_is_written_reads_back(model: str) -> None:
    with line(model) as (fixture, modbus):
        address = 2776 if model == "f4t" else 603
        words = [0, 0x42C8] if model == "f4t" else [1000]
        modbus.write(address, words)
        assert modbus.read(address, len(words)) == words
        assert modbus.read(*PROCESS[model]) != [0] * PROCESS[model][1]
        assert fixture.clock.now() < 0.1


@pytest.mark.parametrize(
    ("code", "says", "do_now"),
    [
        (1, "it knows no such function", "check that the address"),
        (2, "it has no such register", "check that the model"),
        (3, "it does not take this value", "compare the value"),
        (4, "it failed at it, or has no such input or output", "compare the modules"),
        (6, "it is busy", "wait a moment"),
        (10, "it refused", "look the exception up"),
    ],
)
def test_an_exception_is_told_in_words_and_leaves_the_line_open(
    code: int, says: str, do_now: str
) -> None:
    def refuse() -> tuple[int, ...]:
        raise ModbusError(code)

    with controller("f4t") as fixture:
        fixture.simulator._registers.add(100, Parameter(refuse))
        modbus = ModbusLine(fixture.place(), SETTINGS)
        with pytest.raises(ModbusRefusal, match=says) as raised:
            modbus.read(100)
        assert raised.value.code == code
        assert str(raised.value).startswith(f"{NAME}: read register 100: ")
        assert f"(exception {code}); {do_now}" in str(raised.value)
        assert modbus.read(2730) == [62]
        assert b"reopened" not in [data for _, data in fixture.heard]
        modbus.close()


def test_frames_on_a_serial_line_are_kept_apart_by_silence() -> None:
    with line("f4") as (fixture, modbus):
        modbus.read(100)
        before_s = fixture.clock.now()
        modbus.read(100)
        assert fixture.clock.now() - before_s == pytest.approx(3.5 * 11 / 19200)


def test_on_the_way_to_rest_one_lost_answer_does_not_decide() -> None:
    fault = {"fault": "no-reply", "command": "write 2730", "count": 2}
    with line("f4t", fault, repeatable=Repeatable(r"(read|write) \d+")) as (_, modbus), patience():
        modbus.write(2730, [62])
    with line("f4t") as (_, modbus), patience():
        error_of(lambda: modbus.read(9999))


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (struct.pack(">HHHBBBHH", 1, 0, 7, 1, 3, 4, 1, 2), "2 registers came back where 1"),
        (struct.pack(">HHHBBBH", 1, 0, 5, 1, 4, 2, 1), "the answer is to another request"),
        (struct.pack(">HHHBBBH", 1, 0, 5, 2, 3, 2, 1), "the answer is to another request"),
        (struct.pack(">HHHBBBH", 1, 0, 5, 1, 3, 9, 1), "which is no Modbus"),
        (struct.pack(">HHHBBBH", 1, 9, 5, 1, 3, 2, 1), "which is no whole answer"),
        (struct.pack(">HHHBBB", 1, 0, 3, 1, 0x6B, 1), "which is no Modbus"),
    ],
)
def test_an_answer_to_nothing_that_was_asked_is_none(answer: bytes, says: str) -> None:
    clock = VirtualClock()
    with clock.participant("test"), FaultyServer(clock, lambda data: answer) as server:
        place = InstrumentPlace(NAME, f"modbus-tcp://127.0.0.1:{server.port}", clock, {}, {})
        modbus = ModbusLine(place, SETTINGS)
        assert says in error_of(lambda: modbus.read(100))
        modbus.close()
    clock.stop()


@pytest.mark.parametrize("first", [True, False])
def test_a_frame_too_many_in_one_piece_with_the_answer_is_in_doubt(first: bool) -> None:
    def frame(value: int) -> bytes:
        return FramerRTU(DecodePDU(False)).encode(struct.pack(">BBH", 3, 2, value), 1, 0)

    def answer(data: bytes) -> bytes:
        asked.append(data)
        if len(asked) > 1:
            return frame(77)
        return frame(0) + frame(77) if first else frame(77) + frame(0)

    asked: list[bytes] = []
    clock = VirtualClock()
    with clock.participant("test"), FaultyServer(clock, answer) as server:
        place = InstrumentPlace(NAME, f"socket://127.0.0.1:{server.port}", clock, {}, {})
        modbus = ModbusLine(place, SETTINGS, Repeatable(r"read \d+"))
        assert modbus.read(107) == [77]
        assert modbus.doubts == 1
        assert len(asked) == 2
        asked.clear()
        modbus_once = ModbusLine(place, SETTINGS)
        assert "more than one answer came" in error_of(lambda: modbus_once.read(107))
        modbus_once.close()
        modbus.close()
    clock.stop()


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("modbus-tcp://", "nothing answers there"),
        ("modbus-tcp://127.0.0.1:1", "nothing answers there"),
        ("socket://nowhere", "nothing answers there"),
        ("", "nothing answers there"),
        ("/dev/none", "this computer has no serial port /dev/none"),
    ],
)
def test_an_address_where_nobody_is_is_reported(address: str, why: str) -> None:
    place = InstrumentPlace(NAME, address, RealClock(), {}, {})
    text = error_of(lambda: ModbusLine(place, SETTINGS))
    assert f"{NAME}: open {address}: {why}" in text


def test_no_simulator_of_modbus_uses_the_library_that_the_drivers_use() -> None:
    for path in (ROOT / "sim_instruments").rglob("*.py"):
        assert "pymodbus" not in path.read_text(encoding="utf-8")
