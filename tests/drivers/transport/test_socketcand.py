"""Opening a CAN bus on which there is traffic: frames come with the last word of the opening."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest

from drivers.transport.can_line import MAX_MESSAGE, CanLine, Frame, Socketcand
from station.clock import RealClock
from station.errors import InstrumentError
from station.instruments.opening import InstrumentPlace

FRAMES = b"< frame 111 12.500000 0102030405060708 >< frame 00000222 12.6 AA BB >"
Said = tuple[int, bytes, bool]
SAID: list[Said] = [(0x111, bytes(range(1, 9)), False), (0x222, b"\xaa\xbb", False)]


class Daemon:
    """A socketcand that sends what it has to say in the pieces that it is given."""

    def __init__(self, *pieces: bytes, openings: tuple[bytes, ...] = (b"< ok >",)) -> None:
        self._pieces, self._openings = pieces, openings
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.heard = b""
        self.done = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="hostile daemon", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        with suppress(OSError):
            client, _ = self._listener.accept()
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with client:
                client.sendall(b"< hi >")
                for opening in self._openings:
                    self._until(client, b"open can0 >")
                    client.sendall(opening)
                self._until(client, b"< rawmode >")
                for piece in self._pieces:
                    client.sendall(piece)
                    RealClock().sleep(1e-3)
                self.done.set()
                while data := client.recv(4096):
                    self.heard += data

    def _until(self, client: socket.socket, wanted: bytes) -> None:
        while wanted not in self.heard:
            data = client.recv(4096)
            if not data:
                raise OSError
            self.heard += data

    def close(self) -> None:
        self._listener.close()
        self._thread.join(5.0)


@contextmanager
def daemon(*pieces: bytes, openings: tuple[bytes, ...] = (b"< ok >",)) -> Iterator[Daemon]:
    there = Daemon(*pieces, openings=openings)
    try:
        yield there
    finally:
        there.close()


def heard_at(there: Daemon) -> tuple[list[Said], list[bytes]]:
    """Return what a client hears until all is said, and what it passed over."""
    passed_over: list[bytes] = []
    bus = Socketcand("127.0.0.1", there.port, "can0", passed_over.append)
    heard: list[Said] = []
    while (message := bus.recv(0.05)) is not None or not there.done.is_set():
        if message is not None:
            data = bytes(message.data)
            heard.append((message.arbitration_id, data, message.is_error_frame))
    bus.shutdown()
    return heard, passed_over


def test_frames_that_come_with_the_end_of_the_opening_are_the_first_ones() -> None:
    with daemon(b"< ok >" + FRAMES) as there:
        assert heard_at(there) == (SAID, [])


@pytest.mark.parametrize("cut", range(1, len(b"< ok >" + FRAMES)))
def test_whatever_is_said_may_be_cut_in_any_place(cut: int) -> None:
    said = b"< ok >" + FRAMES
    with daemon(said[:cut], said[cut:]) as there:
        assert heard_at(there) == (SAID, [])


@pytest.mark.parametrize("opening", [b"< ok >" + FRAMES, FRAMES + b"< ok >"])
def test_frames_before_the_last_word_of_the_opening_are_the_first_ones(opening: bytes) -> None:
    with daemon(FRAMES[:20], FRAMES[20:] + b"< ok >" + FRAMES, openings=(opening,)) as there:
        assert heard_at(there) == (SAID * 3, [])


def test_bytes_come_one_by_one() -> None:
    said = b"< ok >" + FRAMES
    with daemon(*(said[k : k + 1] for k in range(len(said)))) as there:
        assert heard_at(there) == (SAID, [])


def test_what_is_no_message_is_passed_over_and_never_kept() -> None:
    rubbish = b"x" * (3 * MAX_MESSAGE)
    with daemon(b"< ok >", rubbish, b"< frame 111 zz >", FRAMES) as there:
        heard, passed_over = heard_at(there)
        assert heard == SAID
        assert len(b"".join(passed_over)) >= len(rubbish)


def test_a_driver_gets_the_frames_of_a_busy_bus() -> None:
    with daemon(b"< ok >" + FRAMES) as there:
        place = InstrumentPlace("board", f"socketcand://127.0.0.1:{there.port}/can0", RealClock())
        line = CanLine(place, {0x111: "SAMPLE"})
        try:
            (frame,) = line.wait_for(0x111, place.clock.now() + 2.0)
            assert isinstance(frame, Frame) and frame.data == bytes(range(1, 9))
            line.send(0x100, b"\x01\x02")
        finally:
            line.close()
    assert there.heard.endswith(b"< send 100 2 1 2 >")


@pytest.mark.parametrize("answer", [b"< error could not open bus >", b"x" * 1000, b"< ok"])
def test_a_daemon_that_does_not_open_the_bus_is_refused_in_time(answer: bytes) -> None:
    with daemon(openings=(answer,)) as there:
        place = InstrumentPlace("board", f"socketcand://127.0.0.1:{there.port}/can0", RealClock())
        began_s = place.clock.now()
        with pytest.raises(InstrumentError, match="no socketcand with a bus can0"):
            CanLine(place, {})
        assert place.clock.now() - began_s < 10.0
