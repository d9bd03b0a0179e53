"""A serial line: whole answers, one at a time, whatever comes late, twice, or not at all."""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from drivers.transport.ports import SerialSettings, wire_address
from drivers.transport.text_line import SerialLine
from station.clock import Clock, RealClock, VirtualClock
from station.conformance.faulty_server import FaultyServer, closed_port
from station.errors import InstrumentError, InstrumentTimeout
from station.instruments.opening import InstrumentPlace

SETTINGS = SerialSettings(baud_rate=9600)
pty = pytest.importorskip("pty", reason="pseudo-terminals are of POSIX")


def place(
    clock: Clock, address: str, heard: list[tuple[str, bytes]] | None = None
) -> InstrumentPlace:
    trace = None if heard is None else (lambda way, data: heard.append((way, data)))
    return InstrumentPlace("stage", address, clock, trace=trace)


class Acts:
    """A partner that does its n-th act for the n-th request with something in it."""

    def __init__(self, *acts: bytes | None) -> None:
        self._acts = list(acts)
        self.requests: list[bytes] = []

    def __call__(self, data: bytes) -> bytes | None:
        self.requests.append(data)
        if data == b"\r":
            return b""
        return self._acts.pop(0) if len(self._acts) > 1 else self._acts[0]


@contextmanager
def line_to(*acts: bytes | None, **options: Any) -> Iterator[tuple[SerialLine, Acts, VirtualClock]]:
    clock, partner = VirtualClock(), Acts(*acts)
    with clock.participant("test"), FaultyServer(clock, partner) as server:
        line = SerialLine(place(clock, f"socket://127.0.0.1:{server.port}"), SETTINGS, **options)
        try:
            yield line, partner, clock
        finally:
            line.close()
            clock.stop()


def test_an_answer_comes_without_its_end_and_costs_no_time() -> None:
    with line_to(b"1.25\r\n", b"2\r\n") as (line, partner, clock):
        assert [line.query("1TP?"), line.query("1MD?")] == ["1.25", "2"]
        assert partner.requests == [b"1TP?\r", b"1MD?\r"]
        assert clock.now() == 0.0


def test_after_a_fault_an_empty_request_ends_whatever_half_of_one_is_still_held() -> None:
    with line_to(b"12", b"7\r\n", ignores_empty=True) as (line, partner, _):
        with pytest.raises(InstrumentError, match="only '12' came, without the end"):
            line.query("A?")
        assert line.query("B?") == "7"
        assert partner.requests == [b"A?\r", b"\r", b"B?\r"]


def test_nobody_at_the_port_is_told() -> None:
    clock = RealClock()
    with pytest.raises(InstrumentError, match="nothing answers there"):
        SerialLine(place(clock, f"socket://127.0.0.1:{closed_port()}"), SETTINGS)
    with pytest.raises(InstrumentError, match="write socket://host:port"):
        SerialLine(place(clock, "socket://127.0.0.1"), SETTINGS)
    with pytest.raises(InstrumentError, match="this computer has no serial port /dev/there"):
        SerialLine(place(clock, "/dev/there-is-no-such-port"), SETTINGS)


@pytest.mark.parametrize(
    "wrong",
    [
        {"baud_rate": "fast"},
        {"data_bits": 9},
        {"parity": "both"},
        {"stop_bits": 3},
        {"hardware_handshake": "no"},
    ],
)
def test_wrong_serial_settings_are_told(wrong: dict[str, Any]) -> None:
    where = InstrumentPlace("stage", "socket://127.0.0.1:1", RealClock(), wrong)
    with pytest.raises(InstrumentError, match="its settings are wrong"):
        SerialSettings.of(where)


def test_the_wire_of_a_socket_is_named_as_its_server_names_it() -> None:
    assert wire_address("socket://127.0.0.1:5001") == "127.0.0.1:5001"
    assert wire_address("/dev/ttyUSB0") == "/dev/ttyUSB0"


class Terminal:
    """An instrument at the other end of a pseudo-terminal: answers `N?` with what it was given."""

    def __init__(self, answers: dict[bytes, list[bytes]]) -> None:
        self._master, slave = pty.openpty()
        self.name = os.ttyname(slave)
        self._slave = slave
        self._answers = answers
        self._unplugged = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def say(self, data: bytes) -> None:
        """Say something that nobody asked for; it has come when this returns."""
        os.write(self._master, data)
        select.select([self._slave], [], [], 5.0)

    def _serve(self) -> None:
        pending = b""
        with suppress(OSError):
            while not self._unplugged.is_set():
                if not select.select([self._master], [], [], 0.02)[0]:
                    continue
                pending += os.read(self._master, 1024)
                while b"\r" in pending:
                    request, _, pending = pending.partition(b"\r")
                    for part in self._answers.get(request, []):
                        os.write(self._master, part)

    def close(self) -> None:
        """Unplug it; its thread ends first, or it would read from whoever has the handle next."""
        self._unplugged.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)


@contextmanager
def terminal(answers: dict[bytes, list[bytes]], prefix: str = "") -> Iterator[tuple[Any, Any, Any]]:
    there = Terminal(answers)
    heard: list[tuple[str, bytes]] = []
    suffix = "::INSTR" if prefix else ""
    line = SerialLine(place(RealClock(), f"{prefix}{there.name}{suffix}", heard), SETTINGS)
    try:
        yield line, there, heard
    finally:
        line.close()
        there.close()


@pytest.mark.parametrize("prefix", ["", "ASRL"])
def test_a_port_of_the_computer_is_spoken_to_by_its_name(prefix: str) -> None:
    with terminal({b"A?": [b"1", b"2\r", b"\n"]}, prefix) as (line, _, _heard):
        assert [line.query("A?") for _ in range(3)] == ["12", "12", "12"]


def test_what_nobody_asked_for_is_forgotten_and_told_to_the_trace() -> None:
    with terminal({b"A?": [b"1\r\n"]}) as (line, there, heard):
        there.say(b"POWER FAIL\r\n")
        assert line.query("A?") == "1"
        assert ("<", b"POWER FAIL\r\n") in heard
        assert ("-", b"not asked for, forgotten") in heard


def test_a_late_answer_is_not_taken_for_the_next() -> None:
    with terminal({b"A?": [], b"B?": [b"2\r\n"]}) as (line, there, _):
        with pytest.raises(InstrumentTimeout):
            line.query("A?")
        late = threading.Timer(0.05, there.say, [b"1\r\n"])
        late.start()
        assert line.query("B?") == "2"
        late.join()


def test_a_second_program_cannot_open_the_same_port() -> None:
    with terminal({}) as (_, there, _heard):
        where = place(RealClock(), there.name)
        with pytest.raises(InstrumentError, match="another program uses the serial port"):
            SerialLine(where, SETTINGS)
