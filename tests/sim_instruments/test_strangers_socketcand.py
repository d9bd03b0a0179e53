"""What other clients of a CAN bus behind socketcand send, and what they see."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from sim_bench import Frames, served

from sim_instruments.bench import SimulatedBench
from sim_instruments.wire.socketcand import frame_text
from station.clock import VirtualClock


@contextmanager
def stranger(bench: SimulatedBench) -> Iterator[socket.socket]:
    entry = bench.instruments["gyro_acquisition"]
    with socket.create_connection((entry["host"], entry["port"]), timeout=5.0) as line:
        assert line.recv(256) == b"< hi >"
        yield line


def says(line: socket.socket, text: str) -> bytes:
    line.sendall(text.encode("ascii"))
    return line.recv(256)


def test_a_bus_that_is_not_there_is_refused_and_the_line_ended() -> None:
    with served(VirtualClock()) as bench, stranger(bench) as line:
        assert says(line, "< open can9 >") == b"< error could not open bus >"
        assert line.recv(256) == b""


@pytest.mark.parametrize("mode", ["rawmode", "bcmmode", "controlmode", "isotpmode"])
def test_every_mode_is_entered_with_ok(mode: str) -> None:
    with served(VirtualClock()) as bench, stranger(bench) as line:
        assert says(line, "< open can0 >") == b"< ok >"
        assert says(line, f"< {mode} >") == b"< ok >"


def test_what_a_client_sends_the_others_see_and_it_does_not() -> None:
    clock = VirtualClock()
    with served(clock) as bench, Frames(bench, clock) as one, Frames(bench, clock) as other:
        one.send(0x5A5, bytes.fromhex("01F1000A"))
        clock.sleep(0.1)
        assert other.of(0x5A5) == [bytes.fromhex("01F1000A")]
        assert one.of(0x5A5) == []


def test_a_frame_that_is_none_is_passed_over_in_silence() -> None:
    clock = VirtualClock()
    with served(clock) as bench, Frames(bench, clock) as one, Frames(bench, clock) as other:
        for text in ("< send 5A5 9 0 0 0 0 0 0 0 0 0 >", "< send 5A5 2 1 >", "< send zz 1 1 >"):
            one._wire.sent(1)
            one._socket.sendall(text.encode("ascii"))
        one.send(0x5A6, b"\x01")
        clock.sleep(0.1)
        assert other.of(0x5A5) == []
        assert other.of(0x5A6) == [b"\x01"]
        assert one._thread.is_alive()


def test_frames_are_written_in_capitals_without_blanks_and_with_the_host_s_time() -> None:
    assert frame_text(0x123, 9.854832, "01f1000a") == "< frame 123 1795331009.854832 01F1000A >"
    assert frame_text(0x1ABCDEF, 0.5, "ff").split()[2] == "01ABCDEF"


def test_what_is_unknown_before_a_bus_is_open_is_an_error_and_ok() -> None:
    with served(VirtualClock()) as bench, stranger(bench) as line:
        assert says(line, "< echo >") == b"< error unknown command >< ok >"
        assert says(line, "< open can0 >") == b"< ok >"
        assert says(line, "< echo >") == b"< echo >"
        assert says(line, "< rawmode >") == b"< ok >"
        assert says(line, "< subscribe 0 0 123 >") == b"< error unknown command >"


def test_a_client_in_bcm_mode_gets_what_it_subscribes_to() -> None:
    clock = VirtualClock()
    with (
        served(clock) as bench,
        Frames(bench, clock) as other,
        Frames(bench, clock, mode="< bcmmode >") as client,
    ):

        def told(*frames: tuple[int, str]) -> list[tuple[int, bytes]]:
            client.received.clear()
            for identifier, digits in frames:
                other.send(identifier, bytes.fromhex(digits))
            clock.sleep(0.1)
            assert all(time_s > 1.7e9 for _, time_s, _ in client.received)
            return [(identifier, data) for identifier, _, data in client.received]

        assert told((0x5A5, "01")) == []
        client.says("< subscribe 0 0 5A5 >< filter 0 0 5A6 1 F0 >< subscribe x >")
        frames = (0x5A5, "01F1"), (0x5A7, "01"), (0x5A6, "12"), (0x5A6, "13"), (0x5A6, "23")
        assert told(*frames) == [(0x5A5, b"\x01\xf1"), (0x5A6, b"\x12"), (0x5A6, b"\x23")]
        client.says("< unsubscribe 5A5 >< subscribe 10 0 5A6 >")
        assert told((0x5A5, "01"), (0x5A6, "01"), (0x5A6, "02")) == [(0x5A6, b"\x01")]


def test_a_job_sends_its_frame_until_it_is_deleted() -> None:
    clock = VirtualClock()
    with (
        served(clock) as bench,
        Frames(bench, clock) as other,
        Frames(bench, clock, mode="< bcmmode >") as client,
    ):
        client.says("< add 0 100000 5A5 2 1 F1 >< add 0 0 5A6 1 7 >< add 1 0 5A7 3 1 >")
        clock.sleep(1.05)
        assert other.of(0x5A5) == [b"\x01\xf1"] * 11
        assert other.of(0x5A6) == [b"\x07"] and other.of(0x5A7) == []
        client.says("< update 5A5 1 42 >")
        clock.sleep(0.1)
        assert other.of(0x5A5)[11:] == [b"\x42"]
        client.says("< delete 5A5 >")
        clock.sleep(1.0)
        assert len(other.of(0x5A5)) == 12 and client.of(0x5A5) == []
