"""What came that nobody asked for: an event, a line in step again, and the question asked again."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from wires import LIMITS, no_thread_is_left  # noqa: F401

from drivers.kepco.bop import KepcoBop
from drivers.transport.exchanges import Repeatable
from drivers.transport.kept_frames import MAX_FRAMES, KeptFrames
from drivers.transport.ports import SerialSettings
from drivers.transport.serial_stream import SerialStream, Split
from drivers.transport.text_line import SerialLine, TextLine, VisaLine
from station.clock import RealClock, boot_seconds
from station.errors import InstrumentError
from station.instruments.opening import InstrumentPlace
from station.safety.safe_state import make_bench_safe

IDENTITY = "KEPCO,BIT 802E 36-12,H148202,1.15-1.80"
HARMLESS = Repeatable(r"\*IDN\?|(A|B|MEAS:CURR|OUTP)\?|OUTP OFF|SYST:ERR\?")
Said = Callable[[socket.socket, str], None]


class Device:
    """A device on a TCP port that does with each line whatever `says` says."""

    def __init__(self, says: Said) -> None:
        self._says = says
        self.asked: list[str] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._accept, name="device", daemon=True)]
        self._threads[0].start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._clients.append(client)
                thread = threading.Thread(target=self._serve, args=(client,), daemon=True)
                self._threads.append(thread)
                thread.start()

    def _serve(self, client: socket.socket) -> None:
        pending = b""
        with suppress(OSError):
            while data := client.recv(4096):
                *lines, pending = (pending + data).replace(b"\r", b"\n").split(b"\n")
                for line in filter(None, lines):
                    self.asked.append(line.decode())
                    self._says(client, line.decode())
        with suppress(OSError):
            client.close()

    def close(self) -> None:
        for each in (self._listener, *self._clients):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            with suppress(OSError):
                each.close()
        for thread in self._threads:
            thread.join(5.0)


@contextmanager
def line_to(
    says: Said, kind: str = "visa"
) -> Iterator[tuple[TextLine, Device, list[tuple[str, dict[str, Any]]]]]:
    device = Device(says)
    notes: list[tuple[str, dict[str, Any]]] = []

    def note(what: str, details: Any) -> None:
        notes.append((what, dict(details)))

    line: TextLine
    if kind == "visa":
        address = f"TCPIP::127.0.0.1::{device.port}::SOCKET"
        line = VisaLine(
            InstrumentPlace("it", address, RealClock(), noter=note), repeatable=HARMLESS
        )
    else:
        address = f"socket://127.0.0.1:{device.port}"
        line = SerialLine(
            InstrumentPlace("it", address, RealClock(), noter=note),
            SerialSettings(baud_rate=9600),
            answer_end="\n",
            repeatable=HARMLESS,
        )
    try:
        yield line, device, notes
    finally:
        line.close()
        device.close()


class Once:
    """A device that answers a question with itself, but for one act at the n-th question."""

    def __init__(self, nth: int, act: Callable[[socket.socket, bytes], None]) -> None:
        self._nth, self._act = nth, act
        self._count = 0

    def __call__(self, client: socket.socket, asked: str) -> None:
        self._count += 1
        answer = (IDENTITY if asked == "*IDN?" else asked).encode() + b"\n"
        if self._count == self._nth:
            self._act(client, answer)
        else:
            client.sendall(answer)


def behind(client: socket.socket, answer: bytes) -> None:
    client.sendall(answer + b"0.000\n")


def before(client: socket.socket, answer: bytes) -> None:
    client.sendall(b"0.000\n" + answer)


def half_behind(client: socket.socket, answer: bytes) -> None:
    client.sendall(answer + b"0.0")


def reset(client: socket.socket, answer: bytes) -> None:
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def hangs_up(client: socket.socket, answer: bytes) -> None:
    client.shutdown(socket.SHUT_RDWR)


@pytest.mark.parametrize("kind", ["visa", "serial"])
@pytest.mark.parametrize("act", [behind, before, half_behind])
def test_an_answer_that_is_not_alone_is_not_taken_and_is_asked_for_again(
    kind: str, act: Any
) -> None:
    with line_to(Once(2, act), kind) as (line, device, notes):
        assert line.query("*IDN?") == IDENTITY
        assert line.query("A?") == "A?"
        assert [what for what, _ in notes] == ["line-resynchronised"]
        assert device.asked == ["*IDN?", "A?", "*IDN?", "A?"]


@pytest.mark.parametrize("kind", ["visa", "serial"])
def test_what_comes_after_an_answer_puts_that_answer_in_doubt(kind: str) -> None:
    taken, sent = threading.Event(), threading.Event()

    def late(client: socket.socket, answer: bytes) -> None:
        client.sendall(answer)
        taken.wait(10.0)
        client.sendall(b"12\n")
        sent.set()

    for question, harmless in (("A?", True), ("BUFFER?", False)):
        taken.clear()
        sent.clear()
        with line_to(Once(1, late), kind) as (line, device, notes):
            assert line.query(question) == question
            taken.set()
            assert sent.wait(10.0)
            RealClock().sleep(0.02)
            if harmless:
                assert line.query("B?") == "B?"
            else:
                with pytest.raises(InstrumentError, match="something came after its answer"):
                    line.query("B?")
            assert notes[0] == ("line-resynchronised", {"came": "12\n", "after": question})
            assert device.asked.count(question) == 1


def test_a_command_in_doubt_is_said_again_and_must_be_answered_alike() -> None:
    answers = iter(["0,ok", "-222,no"])
    taken, sent = threading.Event(), threading.Event()

    def says(client: socket.socket, asked: str) -> None:
        if asked.startswith("OUTP OFF"):
            answer = next(answers)
            client.sendall(f"{answer}\n".encode())
            if answer == "0,ok":
                taken.wait(10.0)
                client.sendall(b"0,ok\n")
                sent.set()
        else:
            client.sendall(f"{asked}\n".encode())

    with line_to(says) as (line, device, _):
        assert line.query("OUTP OFF;:SYST:ERR?") == "0,ok"
        taken.set()
        assert sent.wait(10.0)
        RealClock().sleep(0.1)
        with pytest.raises(InstrumentError, match="when asked again"):
            line.query("A?")
        assert device.asked.count("OUTP OFF;:SYST:ERR?") == 2


@pytest.mark.parametrize("kind", ["visa", "serial"])
@pytest.mark.parametrize("act", [reset, hangs_up])
def test_a_line_that_breaks_is_an_event_and_what_may_not_be_asked_twice_is_not(
    kind: str, act: Any
) -> None:
    with line_to(Once(2, act), kind) as (line, device, notes):
        assert line.query("*IDN?") == IDENTITY
        assert line.query("A?") == "A?"
        assert [what for what, _ in notes] == ["line-reopened"]
    with line_to(Once(1, act), kind) as (line, device, notes):
        with pytest.raises(InstrumentError, match="the line broke"):
            line.query("BUFFER?")
        assert device.asked == ["BUFFER?"] and not notes


@pytest.mark.parametrize("kind", ["visa", "serial"])
def test_another_instrument_behind_a_line_that_broke_is_not_asked(kind: str) -> None:
    who = [IDENTITY]

    def says(client: socket.socket, asked: str) -> None:
        if asked == "A?" and who == [IDENTITY]:
            who[0] = "KEPCO,another"
            reset(client, b"")
        else:
            client.sendall(f"{who[0] if asked == '*IDN?' else asked}\n".encode())

    with line_to(says, kind) as (line, device, _):
        assert line.query("*IDN?") == IDENTITY
        with pytest.raises(InstrumentError, match="'KEPCO,another' came back instead of"):
            line.query("A?")
        assert device.asked == ["*IDN?", "A?", "*IDN?"]


def test_a_line_that_always_breaks_is_opened_again_twice() -> None:
    with line_to(lambda client, _: reset(client, b"")) as (line, device, notes):
        with pytest.raises(InstrumentError, match="the line broke"):
            line.query("A?")
        assert device.asked == ["A?"] * 3
        assert [what for what, _ in notes] == ["line-reopened"] * 2


@pytest.mark.parametrize("kind", ["visa", "serial"])
def test_bytes_that_never_stop_do_not_stretch_the_deadline(kind: str) -> None:
    stopped = threading.Event()

    def trickle(client: socket.socket, asked: str) -> None:
        while not stopped.is_set():
            client.send(b"0")
            RealClock().sleep(0.01)

    def says_nothing(client: socket.socket, asked: str) -> None:
        stopped.wait(10.0)

    taken_s = []
    for says, told in ((says_nothing, "no answer"), (trickle, "without the end of an answer")):
        with line_to(says, kind) as (line, _, _notes):
            began_s = boot_seconds()
            with pytest.raises(InstrumentError, match=told):
                line.query("A?")
            taken_s.append(boot_seconds() - began_s)
            stopped.set()
        stopped.clear()
    silent_s, trickled_s = taken_s
    assert 0.5 <= trickled_s < 3.0 * silent_s


def test_a_device_that_never_stops_talking_still_hears_a_last_attempt() -> None:
    ended = threading.Event()

    def chatter(client: socket.socket, asked: str) -> None:
        def say() -> None:
            with suppress(OSError):
                while not ended.is_set():
                    client.sendall(b"BUSY\n")
                    RealClock().sleep(0.005)

        threading.Thread(target=say, daemon=True).start()

    with line_to(chatter, "serial") as (line, device, notes):
        for _ in range(3):
            with suppress(InstrumentError):
                assert line.query("A?") == "BUSY"
            RealClock().sleep(0.1)
        assert line.doubts
        line.last_attempt("OUTP OFF")
        assert device.asked[-1] == "OUTP OFF"
        assert notes[-1] == ("switched-off-at-once", {"attempted": "OUTP OFF"})
        ended.set()


def test_what_could_not_be_sent_is_not_said_to_be_switched_off() -> None:
    with line_to(lambda client, asked: None, "serial") as (line, device, notes):
        device.close()
        for _ in range(2):  # the first word into a connection that has ended may still be taken
            with suppress(InstrumentError):
                line.query("A?")
        with pytest.raises(InstrumentError):
            line.last_attempt("OUTP OFF")
        assert "switched-off-at-once" not in dict(notes)


class Stubborn:
    """A supply that says it is off and drives 5 A; `stray` comes in at the n-th question.

    From then on each answer is read as that to the next question.
    """

    def __init__(self, nth: int, stray: bytes) -> None:
        self._nth, self._stray = nth, stray
        self._count = 0

    def __call__(self, client: socket.socket, asked: str) -> None:
        answers = {
            "*IDN?": IDENTITY,
            "MEAS:CURR?": "5.0",
            "CURR?": "0",
            "OUTP?": "0",
            "STAT:OPER:COND?": "0",
        }
        if "?" not in asked:
            return
        self._count += 1
        answer = answers.get(asked, '0,"No error"').encode() + b"\n"
        if self._count == self._nth:
            client.sendall(self._stray)
            RealClock().sleep(2e-3)  # the line is empty again, and the true answer comes after
        client.sendall(answer)


@pytest.mark.parametrize(
    "stray", [b"0.000\n", b"0\n", b'0,"No error"\n', IDENTITY.encode() + b"\n"]
)
def test_a_supply_that_drives_five_ampere_is_never_called_safe(stray: bytes) -> None:
    for nth in range(2, 16):
        device = Device(Stubborn(nth, stray))
        address = f"TCPIP::127.0.0.1::{device.port}::SOCKET"
        limits = {**LIMITS, "slew": 200.0}
        place = InstrumentPlace(
            "coil_supply.x", address, RealClock(40.0), {"coil_constant": "1 mT/A"}, limits
        )
        supply = KepcoBop(place)
        try:
            supply.identify()
            (outcome,) = make_bench_safe({"coil_supply.x": supply}, [("", 1.0)], place.clock)
            assert not outcome.verified, (nth, outcome)
        finally:
            supply.close()
            device.close()


@pytest.mark.parametrize("answers_behind", [1, 2, 3, 4])
def test_readings_count_only_between_identities(answers_behind: int) -> None:
    waiting: list[bytes] = []

    def lagging(client: socket.socket, asked: str) -> None:
        waiting.append((IDENTITY if asked == "*IDN?" else "5.0").encode() + b"\n")
        client.sendall(waiting.pop(0))

    with line_to(lagging) as (line, _, _notes):

        def number_of(question: str) -> float:
            answer = line.query(question)
            if any(map(str.isalpha, answer)):
                raise InstrumentError("it", question, answer, "")
            return float(answer)

        proof = line.proof
        assert proof.of(lambda: number_of("MEAS:CURR?")) == [5.0]
        waiting += [(IDENTITY if n % 2 else "0").encode() + b"\n" for n in range(1, 5)]
        del waiting[answers_behind:]
        with pytest.raises(InstrumentError):
            proof.of(lambda: number_of("MEAS:CURR?"), lambda: number_of("OUTP?"))


@pytest.mark.parametrize("kind", ["visa", "serial"])
def test_a_driver_of_before_says_itself_where_one_lost_answer_must_not_decide(kind: str) -> None:
    """By `patient` and `repeated`, from wherever it asks; nobody else is patient by that."""

    numbers = iter([b"?\n", b"?\n", b"5.0\n", b"?\n"])
    with line_to(lambda client, asked: client.sendall(next(numbers)), kind) as (line, device, _):
        assert line.patient.number("MEAS:CURR?") == 5.0
        with pytest.raises(InstrumentError):
            line.number("MEAS:CURR?")
    numbers = iter([b"?\n", b"?\n", b"5.0\n"])
    with line_to(lambda client, asked: client.sendall(next(numbers)), kind) as (line, device, _):
        assert line.repeated("A?", lambda: float(line.number("A?"))) == 5.0
        assert device.asked == ["A?"] * 3


def test_a_resource_s_answer_ends_with_its_last_character_and_loses_the_whole_end() -> None:
    device = Device(lambda client, asked: client.sendall(f"{asked}\r\n".encode()))
    address = f"TCPIP::127.0.0.1::{device.port}::SOCKET"
    line = VisaLine(InstrumentPlace("it", address, RealClock()), answer_end="\r\n")
    try:
        assert line.query("A?") == "A?"
    finally:
        line.close()
        device.close()


class Kept(KeptFrames[bytes]):
    """Frames that nobody takes."""

    def _read(self, within_s: float) -> bool:
        return False

    def _shut(self) -> None:
        pass

    def flooded(self, count: int) -> None:
        self._keep(b"x" for _ in range(count))

    def kept(self) -> int:
        return len(self._frames)


def test_frames_that_nobody_takes_are_dropped_with_an_event() -> None:
    notes: list[str] = []
    place = InstrumentPlace("it", "", RealClock(), noter=lambda what, _: notes.append(what))
    frames = Kept(place, "nowhere", lambda _: 1)
    for _ in range(12):
        frames.flooded(MAX_FRAMES // 10)
    assert frames.kept() == MAX_FRAMES
    assert notes == ["frames-dropped"]


def test_a_stream_of_rubbish_is_not_kept() -> None:
    def says(client: socket.socket, asked: str) -> None:
        for _ in range(400):
            client.sendall(b"\xfe" * 65536)

    device = Device(says)
    try:
        place = InstrumentPlace("it", f"socket://127.0.0.1:{device.port}", RealClock())
        settings = SerialSettings(baud_rate=9600)
        stream = SerialStream(place, settings, lambda data: Split([], data, 0))
        stream.send(b"go\n")
        until_s = boot_seconds() + 20.0
        while boot_seconds() < until_s and len(stream._pending) < 1 << 16:
            RealClock().sleep(0.01)
        RealClock().sleep(0.2)
        assert len(stream._pending) == 1 << 16
        stream.close()
    finally:
        device.close()
