"""A wire that leads to a transcript, on virtual time: the far end of an unchanged driver."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from difflib import SequenceMatcher

from station.clock import VirtualClock
from station.clock.base import Attendant, Wire
from station.errors import StationError
from station.replay.deviations import Deviations
from station.replay.transcript import Entry, Opening, Transcript

SAME_TIME_S = 2e-6
"""Times are recorded in microseconds."""
EARLY_S = 1e-6
"""A stream comes so much before its recorded time: whoever looked just then had seen it."""
LATE_S = 1.0
"""A stream waits no longer than this for a message that it came behind."""
MAX_AHEAD = 20
"""So many messages may be sent in another order: two threads take a line as they come."""
ALIKE = 0.7
BROKE = b"the line broke"


class TranscriptEnds(StationError):
    """The transcript is over before the run: it was killed there."""


class ReplayClock(VirtualClock):
    """Virtual time on which a wire leads to the transcript of the instrument in its address."""

    def __init__(self, transcripts: Mapping[str, Transcript], deviations: Deviations) -> None:
        super().__init__()
        self._replayed: dict[str, ReplayWire] = {}
        self._by_name = dict(transcripts)
        self._deviations = deviations

    def wire(self, address: str) -> Wire:
        """Return the wire of an instrument, whose name stands in its address."""
        parts = address.replace("/", ":").split(":")
        name = next((part for part in parts if part in self._by_name), None)
        if name is None:
            return super().wire(address)
        if name not in self._replayed:
            transcript = self._by_name[name]
            self._replayed[name] = ReplayWire(self, transcript, self._deviations)
        return self._replayed[name]

    def finish(self) -> None:
        """Note what the transcripts have and nobody sent."""
        for name, transcript in self._by_name.items():
            wire = self._replayed.get(name)
            opened = wire.opened if wire else 0
            for opening in transcript.openings[opened:]:
                note_unsent(transcript, opening.entries, self._deviations)
            if wire:
                wire.finish()


def note_unsent(transcript: Transcript, entries: Sequence[Entry], deviations: Deviations) -> None:
    """Note the messages among `entries` that nobody sent."""
    for entry in entries:
        if entry.direction == ">":
            deviations.add(transcript.instrument, entry.time_s, entry.data, None, entry.line)


class ReplayWire(Wire):
    """Serves one transcript, opening by opening; whoever waits sleeps until the recorded time."""

    def __init__(self, clock: ReplayClock, transcript: Transcript, deviations: Deviations) -> None:
        self.clock, self.transcript, self.deviations = clock, transcript, deviations
        self.opened = 0
        self._port: ReplayPort | None = None
        self._read: Callable[[], bool] | None = None
        self._pumps = 0

    def port(self) -> ReplayPort:
        """Return the far end of the next opening; OSError where nobody answered then."""
        self.finish()
        openings = self.transcript.openings
        if self.opened < len(openings):
            opening = openings[self.opened]
            self.opened += 1
        else:
            if not self.transcript.whole:
                self.ends()
            self.deviations.add(self.transcript.instrument, self.clock.now(), None, b"(opened)")
            opening = Opening("nobody opened it")
        if opening.refused:
            raise OSError("nobody answered when this was recorded")
        last = self.opened == len(openings) and not self.transcript.whole
        self._port = ReplayPort(self, opening, cut=last)
        return self._port

    def ends(self) -> None:
        """End the replay here: the transcript does not go on."""
        if self.deviations.ended_s is None:
            self.deviations.ended_s = self.clock.now()
            self.clock.interrupt(TranscriptEnds("the transcript ends here"))

    def finish(self) -> None:
        """Note what the opening in use has and nobody sent."""
        if self._port is not None:
            note_unsent(self.transcript, self._port.unsent, self.deviations)
            self._port = None

    def open(self) -> None:
        """Nothing is in flight here."""

    def close(self) -> None:
        """Nothing is in flight here; a stream is read no more."""
        self._read = None

    def sent(self, units: int) -> None:
        """Nothing is in flight here: the port has the bytes."""

    def wait(self, deadline_s: float) -> bool:
        """Sleep until the answer was recorded, or the deadline where none was."""
        due_s = self._port.due_s() if self._port is not None else None
        in_time = due_s is not None and due_s <= deadline_s + SAME_TIME_S
        until_s = due_s if due_s is not None and in_time else deadline_s
        if until_s > self.clock.now() + SAME_TIME_S:
            self.clock.sleep_until(until_s)
        return in_time

    def received(self) -> None:
        """Nothing is in flight here."""

    def listen(self, read: Callable[[], bool]) -> bool:
        """Have a stream read at the times at which it came."""
        self._read = read
        if self._port is not None:
            self._port.stream()
            self.pump()
        return True

    def pump(self) -> None:
        """Have what has come of a stream read now, and the rest of it when it came."""
        port, read = self._port, self._read
        if port is None or read is None:
            return
        self._pumps += 1
        pump = self._pumps

        def step() -> float | None:
            if pump != self._pumps or self._read is None:
                return None
            read()
            return port.next_s()

        first_s = port.next_s()
        if first_s is not None and first_s <= self.clock.now():
            read()
            first_s = port.next_s()
        if first_s is not None:
            name = f"the transcript of {self.transcript.instrument} {pump:09d}"
            self.clock.repeat(name, first_s, step)

    def picked_up(self, units: int) -> None:
        """Nothing is in flight here."""

    def serving(self, units: int) -> AbstractContextManager[None]:
        """Nobody serves here."""
        return nullcontext()

    def attend(self, attendant: Attendant) -> bool:
        """Nobody serves here."""
        return False

    def answered(self, units: int) -> None:
        """Nobody serves here."""

    def streamed(self, units: int) -> None:
        """Nobody serves here."""

    def written(self) -> None:
        """Nobody serves here."""


class ReplayPort:
    """The far end of one opening: what is written is held against it, what came is read."""

    def __init__(self, wire: ReplayWire, opening: Opening, *, cut: bool) -> None:
        self._wire, self._clock = wire, wire.clock
        self._cut = cut
        self._entries = opening.entries
        self._sent = deque(n for n, entry in enumerate(self._entries) if entry.direction == ">")
        self._due: deque[Entry] = deque()
        self._known: dict[bytes, int] = {}
        self._came: deque[Entry] | None = None
        address = wire.transcript.address.lower()
        self.is_connection = address.endswith("::socket") or "://" in address
        self._due.extend(self._behind(-1))

    @property
    def unsent(self) -> list[Entry]:
        """What nobody has sent yet."""
        return [self._entries[n] for n in self._sent]

    def stream(self) -> None:
        """Give out what came at its time, whatever was asked."""
        self._came = deque(entry for entry in self._entries if entry.direction == "<")

    def next_s(self) -> float | None:
        """Return when the next of a stream comes: as recorded, but behind what asked for it."""
        if not self._came:
            return None
        due_s = self._came[0].time_s - EARLY_S
        if self._sent and (asked := self._entries[self._sent[0]]).line < self._came[0].line:
            due_s = max(due_s, asked.time_s + LATE_S)
        return max(due_s, self._clock.now())

    def due_s(self) -> float | None:
        """Return when the answer to the last message came, None where none did."""
        return max(self._due[0].time_s, self._clock.now()) if self._due else None

    def write(self, data: bytes) -> None:
        """Hold what a driver sends against the transcript, at its recorded time or later."""
        place = self._place_of(data)
        if place is None:
            return
        entry = self._entries[place]
        if entry.time_s > self._clock.now() + SAME_TIME_S:
            self._clock.sleep_until(entry.time_s)
        if self._came is not None:
            self._wire.pump()
            return
        self._due.clear()
        self._due.extend(self._behind(place))

    def read(self, timeout_s: float) -> bytes:
        """Return what has come by now."""
        return b"".join(self.messages())

    def messages(self) -> list[bytes]:
        """Return each message that has come by now; OSError where the line broke then."""
        now_s = self._clock.now() + SAME_TIME_S
        messages: list[bytes] = []
        if self._came is not None:
            while (due_s := self.next_s()) is not None and due_s <= self._clock.now():
                messages.append(self._came.popleft().data)
            return messages
        if self._due and self._due[0].time_s <= now_s:
            entry = self._due.popleft()
            if entry.direction == "!":
                raise ConnectionResetError("the line broke when this was recorded")
            messages.append(entry.data)
        return messages

    def close(self) -> None:
        """Nothing is left behind."""

    def _place_of(self, data: bytes) -> int | None:
        """Return which entry a message is; a deviation is noted, and stands for what it is like."""
        wire = self._wire
        wire.deviations.exchanges += 1
        for n in list(self._sent)[:MAX_AHEAD]:
            if self._entries[n].data == data:
                self._sent.remove(n)
                self._known[data] = n
                return n
        if not self._sent and self._cut:
            wire.ends()
            return None
        name, now_s = wire.transcript.instrument, self._clock.now()
        expected = self._entries[self._sent[0]] if self._sent else None
        if expected is None:
            wire.deviations.add(name, now_s, None, data)
            return self._known.get(data)
        wire.deviations.add(name, now_s, expected.data, data, expected.line)
        if data in self._known or not alike(expected.data, data):
            return self._known.get(data)
        return self._sent.popleft()

    def _behind(self, number: int) -> list[Entry]:
        """Return what came behind an entry, up to the next that was sent."""
        behind = []
        for entry in self._entries[number + 1 :]:
            if entry.direction == ">":
                break
            if entry.direction == "<" or (entry.direction == "!" and BROKE in entry.data):
                behind.append(entry)
        return behind


def alike(expected: bytes, sent: bytes) -> bool:
    """Whether a message is probably another form of the one expected."""
    return SequenceMatcher(None, expected, sent, autojunk=False).ratio() >= ALIKE
