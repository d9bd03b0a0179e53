"""Our drivers against wires that misbehave: one clear sentence each, and no thread left behind."""

from __future__ import annotations

import re
import socket
from typing import Any

import pytest
from wires import HANG_UP, NO_ERROR, KepcoWire, Pause, Wire, gaussmeter, supply

from drivers.generic.can_pulse_board import CanPulseBoard
from station.clock import RealClock
from station.errors import InstrumentError, InstrumentTimeout
from station.instruments.opening import Place

IDENTITY = bytes.fromhex("1204000001020103")


class Daemon(Wire):
    """A socketcand whose board does the acts; `greeting` and `opening` are its own manners."""

    request = re.compile(rb"[^>]*>")
    greeting = b"< hi >"
    opening = b"< ok >"

    def answered_aside(self, client: socket.socket, request: bytes) -> bool:
        aside = b"send" not in request
        if aside:
            client.sendall(self.opening)
        return aside


class Mute(Daemon):
    greeting = opening = b""


class MailServer(Daemon):
    greeting = b"220 mail ready\r\n"


class OtherBus(Daemon):
    opening = b"< error could not open bus >"


def board(wire: Wire) -> CanPulseBoard:
    address = f"socketcand://127.0.0.1:{wire.port}/can0"
    return CanPulseBoard(Place("gyro_acquisition", address, RealClock()))


def frame(identifier: int, data: bytes) -> bytes:
    return f"< frame {identifier:03X} 0.000000 {data.hex()} >".encode()


def acknowledgement(command: int, result: int, request: int) -> bytes:
    return frame(0x101, bytes([command, result, request & 255, request >> 8, 0, 0, 0, 0]))


def sentence(raised: pytest.ExceptionInfo[InstrumentError], *parts: str) -> None:
    """Assert that the error is one sentence that holds the parts."""
    text = str(raised.value)
    assert "\n" not in text
    assert "Traceback" not in text
    assert text.count("; ") >= 1
    for part in parts:
        assert part in text, text


TEXT_FAULTS = {
    "silent": ((), InstrumentTimeout, "no answer came within 0.5 s"),
    "closed": (
        (HANG_UP,),
        InstrumentError,
        "the line broke (the other side closed the connection)",
    ),
    "closed in the middle": ((b"KEPCO,BI", HANG_UP), InstrumentError, "only 'KEPCO,BI' came"),
    "partial": ((b"KEPCO,BI",), InstrumentTimeout, "only 'KEPCO,BI' came, without the end"),
    "wrong terminator": ((b"A,B,C,D\r",), InstrumentTimeout, r"only 'A,B,C,D\r' came"),
    "bytes": ((b"\xff\x80\x00\n",), InstrumentError, "which is no text"),
    "another answer": ((b"0.5\n",), InstrumentError, "'0.5' came back"),
    "empty": ((b"\n",), InstrumentError, "'' came back"),
}


@pytest.mark.parametrize("make", [supply, gaussmeter])
@pytest.mark.parametrize("fault", TEXT_FAULTS)
def test_a_faulty_answer_is_one_sentence_with_the_bytes_seen(make: Any, fault: str) -> None:
    acts, kind, said = TEXT_FAULTS[fault]
    with Wire(acts) as wire:
        instrument = make(wire)
        with pytest.raises(kind) as raised:
            instrument.identify()
        sentence(raised, instrument.place.name, "*IDN?", said)
        instrument.close()
        instrument.close()


def test_a_closed_port_says_that_nobody_answers() -> None:
    with Wire(()) as wire:
        pass
    with pytest.raises(InstrumentError) as raised:
        supply(wire).identify()
    sentence(raised, "coil_supply.x", "Connection refused", "check")
    with pytest.raises(InstrumentError) as raised:
        board(wire)
    sentence(raised, "gyro_acquisition", "nothing answers there", "Connection refused")


def test_a_late_answer_is_not_taken_for_the_next_one() -> None:
    late = (Pause(0.8), b"111\n")
    with Wire(late, (b"222\n",), (Pause(0.6), b"333\n"), (b"444\n",)) as wire:
        instrument = supply(wire)
        with pytest.raises(InstrumentTimeout):
            instrument.current_A()
        assert instrument.current_A() == 222.0
        with pytest.raises(InstrumentTimeout):
            instrument.current_A()
        assert instrument.current_A() == 444.0
        instrument.close()


def test_an_answer_in_pieces_is_put_together() -> None:
    with Wire((b"0.", Pause(0.1), b"1", Pause(0.1), b"25\n")) as wire:
        instrument = supply(wire)
        assert instrument.current_A() == 0.125
        instrument.close()


def test_an_answer_that_trickles_for_ever_ends_at_its_deadline() -> None:
    trickle = (b"1", Pause(0.1)) * 100
    with Wire(trickle, (b"2\n",)) as wire:
        instrument = supply(wire)
        with pytest.raises(InstrumentTimeout) as raised:
            instrument.current_A()
        sentence(raised, "only '1", "within 0.5 s")
        assert len(wire.requests) == 1
        assert instrument.current_A() == 2.0
        instrument.close()


def test_a_line_feed_alone_ends_an_answer_of_the_gaussmeter() -> None:
    with Wire((b"Lake Shore,F71,LSA1/2,1.0\n",)) as wire:
        instrument = gaussmeter(wire)
        assert instrument.identify().serial == "LSA1"
        instrument.close()


@pytest.mark.parametrize("answer", [b"ERR\n", b"nan\n", b"inf\n", b"1,2\n", b"\n"])
def test_what_is_no_number_is_never_a_current(answer: bytes) -> None:
    with Wire((answer,)) as wire:
        instrument = supply(wire)
        with pytest.raises(InstrumentError) as raised:
            instrument.current_A()
        sentence(raised, "MEAS:CURR?", "where a number belongs")
        instrument.close()


def test_a_refused_command_says_what_the_instrument_said() -> None:
    refusal = b'-222,"Data out of range"\n'
    with KepcoWire((b"0\n",), (NO_ERROR,), (refusal,)) as wire:
        instrument = supply(wire)
        with pytest.raises(InstrumentError) as raised:
            instrument.programme_limits()
        sentence(raised, "FUNC:MODE CURR", 'refused with -222,"Data out of range"')
        instrument.close()


def test_a_supply_that_refuses_everything_is_switched_off_all_the_same() -> None:
    with Wire((b'-310,"System error"\n',)) as wire:
        instrument = supply(wire)
        with pytest.raises(InstrumentError):
            instrument.make_safe(instrument.place.clock.now() + 5.0)
        with pytest.raises(InstrumentError):
            instrument.read_safety()
        instrument.close()
    assert wire.requests[0].startswith(b"*CLS")
    assert b"OUTP OFF\n" in wire.requests


@pytest.mark.parametrize(
    "record",
    [
        b"rubbish",
        b"2026-01-01T00:00:00,1,2",
        b"yesterday,1e-3,1e-3,1e-3,1e-3,0,0",
        b"2026-01-01T00:00:00.1,1e-3,abc,1e-3,1e-3,0,0",
        b"2026-01-01T00:00:00.1,1e-3,nan,1e-3,1e-3,0,0",
        b"2026-01-01T00:00:00.1,1,1,1,1,0,0;2026-01-01T00:00:00.2+01:00,1,1,1,1,0,0",
    ],
)
def test_a_buffer_with_something_else_in_it_is_told(record: bytes) -> None:
    with Wire((b'"' + record + b';"\r\n',)) as wire:
        instrument = gaussmeter(wire)
        with pytest.raises(InstrumentError) as raised:
            instrument.drain()
        sentence(raised, "read its buffer", "is no reading")
        instrument.close()


@pytest.mark.parametrize("daemon", [Mute, MailServer, OtherBus])
def test_what_is_no_can_daemon_is_told_when_the_line_opens(daemon: type[Daemon]) -> None:
    with daemon(()) as wire:
        with pytest.raises(InstrumentError) as raised:
            board(wire)
        sentence(raised, "gyro_acquisition", "nothing answers there", "start socketcand")


CAN_FAULTS = {
    "silent": ((), "no acknowledgement came within 0.5 s"),
    "closed": ((HANG_UP,), "the other side closed the connection"),
    "closed in the middle": ((b"< frame 101 0.0 03", HANG_UP), "closed the connection"),
    "partial": ((b"< frame 101 0.0 03",), "no acknowledgement came"),
    "bytes": ((b"\xff\x80",), "no acknowledgement came"),
    "bad hexadecimal": ((b"< frame 101 0.0 zz >",), "no acknowledgement came"),
    "wrong terminator": ((b"< frame 101 0.0 0300010000000000 }",), "no acknowledgement came"),
    "short frame": ((frame(0x101, b"\x03"),), "101#03 is none of its messages"),
    "refused": ((acknowledgement(3, 2, 1),), "refused with bad_interval"),
    "unknown refusal": ((acknowledgement(3, 77, 1),), "refused with 77"),
    "identity missing": ((acknowledgement(3, 0, 1),), "no identity came"),
    "another's answer": ((acknowledgement(3, 0, 9),), "no acknowledgement came"),
    "other traffic": ((frame(0x555, b"\x01") * 50,), "no acknowledgement came"),
}


@pytest.mark.parametrize("fault", CAN_FAULTS)
def test_a_faulty_board_is_one_sentence(fault: str) -> None:
    acts, said = CAN_FAULTS[fault]
    with Daemon(acts) as wire:
        instrument = board(wire)
        with pytest.raises(InstrumentError) as raised:
            instrument.identify()
        sentence(raised, "gyro_acquisition", said)
        instrument.close()
        instrument.close()


def test_a_late_acknowledgement_is_passed_over() -> None:
    late = (Pause(0.8), acknowledgement(3, 2, 1))
    good = (Pause(0.05), acknowledgement(3, 0, 2), frame(0x111, IDENTITY))
    with Daemon(late, good) as wire:
        instrument = board(wire)
        with pytest.raises(InstrumentTimeout):
            instrument.identify()
        assert instrument.identify().serial == "1042"
        instrument.close()
