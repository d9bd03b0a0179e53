"""Watch a run until it is dismissed, dies, or stands still; and the other guardian of the run.

Each guardian acts where the other cannot.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import wait as wait_for_any
from threading import Event, Thread
from typing import Any, Protocol

from station.clock import RealClock
from station.errors import StationError
from station.guardian.messages import (
    BEAT,
    BEATS_EVERY_S,
    DISMISS,
    DONE,
    HAND_OVER,
    LOCKS,
    LOOKS_EVERY_S,
    PEER,
    SILENT_FOR_S,
    WAITS,
    WATCH,
    WITNESSES,
    GuardianLine,
    Looks,
    Silence,
    message_of,
)

if sys.platform != "win32":
    import select  # now: nothing is loaded when it is needed
else:
    import ctypes

ENDED_LOOKS_EVERY_S = 0.002


class OtherProcess:
    """A process that lives now, held so that its number can never become another's."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._is_parent = hasattr(os, "getppid") and os.getppid() == pid
        self._handle = _handle_of(pid)

    if sys.platform == "win32":

        def kill(self) -> None:
            """Kill it, whatever it does."""
            ctypes.windll.kernel32.TerminateProcess(self._handle, 1)

        def has_ended(self) -> bool:
            """Whether nothing of it is left but its number."""
            return bool(ctypes.windll.kernel32.WaitForSingleObject(self._handle, 0) == 0)

    else:

        def kill(self) -> None:
            """Kill it, a stopped one too."""
            with suppress(ProcessLookupError):
                if self._handle is not None:
                    signal.pidfd_send_signal(self._handle, signal.SIGKILL)
                elif not self.has_ended():
                    os.kill(self._pid, signal.SIGKILL)

        def has_ended(self) -> bool:
            """Whether nothing of it is left but its number."""
            if self._handle is not None:
                # poll, not select: the number of the handle may be large.
                looking = select.poll()
                looking.register(self._handle, select.POLLIN)
                return bool(looking.poll(0))
            # Without such handles: a process whose parent has ended is given another one.
            if self._is_parent:
                return os.getppid() != self._pid
            with suppress(PermissionError):
                try:
                    os.kill(self._pid, 0)
                except ProcessLookupError:
                    return True
            return False


def end_all(processes: Sequence[OtherProcess], within_s: float) -> bool:
    """Kill processes and wait; whether they have ended within real time.

    Once one has, the system has closed its serial ports and connections. One that is stuck in the
    system, with a disk that hangs, cannot die.
    """
    clock = RealClock()
    until_s = clock.now() + within_s
    for process in processes:
        if not process.has_ended():
            process.kill()
    while not all(process.has_ended() for process in processes):
        if clock.now() >= until_s:
            return False
        clock.sleep(ENDED_LOOKS_EVERY_S)
    return True


def let_end(process: OtherProcess, within_s: float) -> None:
    """Wait in real time until a process has ended by itself, and kill one that does not."""
    clock = RealClock()
    until_s = clock.now() + within_s
    while not process.has_ended() and clock.now() < until_s:
        clock.sleep(ENDED_LOOKS_EVERY_S)
    if not process.has_ended():
        process.kill()


if sys.platform == "win32":
    SYNCHRONIZE, PROCESS_TERMINATE = 0x00100000, 0x0001

    def _handle_of(pid: int) -> int | None:
        return int(ctypes.windll.kernel32.OpenProcess(SYNCHRONIZE | PROCESS_TERMINATE, False, pid))

else:

    def _handle_of(pid: int) -> int | None:
        """Return a handle of the process where the system has them (Linux), else None."""
        if not hasattr(os, "pidfd_open"):
            return None
        with suppress(OSError):  # an old kernel, or one that forbids it
            return os.pidfd_open(pid)
        return None


class Peer:
    """The other guardian: none until the run has made them known to each other."""

    def __init__(self) -> None:
        self.done = False
        """Whether it has said that nothing is left to be done."""
        self.waits = False
        """Whether it has said that it goes on trying."""
        self.process: OtherProcess | None = None
        self.channel: GuardianLine | None = None
        self._silence = Silence()

    def becomes(self, end: int, pid: int) -> None:
        """From now on it is process `pid`, at the other end of a socket."""
        if self.channel is not None:
            self.channel.close()
        self.channel = GuardianLine(socket.socket(fileno=end))
        self.process = OtherProcess(pid)
        self._silence.heard()

    @property
    def can_act(self) -> bool:
        """Whether it is there and gives signs of life."""
        there = self.channel is not None and not self.channel.ended
        return there and self._silence.seconds < SILENT_FOR_S

    def listen(self) -> None:
        """Take what it has said."""
        if self.channel is not None:
            for message, _ in self.channel.received():
                self._silence.heard()
                self.done = self.done or message.get("say") == DONE
                self.waits = self.waits or message.get("say") == WAITS

    def look(self) -> None:
        """Count one look at which it had said nothing."""
        self._silence.look()

    def say(self, what: str) -> None:
        """Say something to it, if it is there."""
        if self.channel is not None:
            self.channel.send(message_of(what))

    def beat_while(self, within_time: Callable[[], bool]) -> Event:
        """Beat from a thread of its own while `within_time`, until the returned event is set."""
        ended = Event()

        def beat() -> None:
            while not ended.wait(BEATS_EVERY_S):
                if within_time():
                    self.say(BEAT)

        Thread(target=beat, name="beats", daemon=True).start()
        return ended


CHANNEL_ENDED = "the run's process ended before it had made the bench safe"
STANDS_STILL = f"the run's process did not respond for {SILENT_FOR_S:g} s of real time"
FIRST_IS_GONE = "the first guardian of the run does not act"


@dataclass(frozen=True)
class SafingOrder:
    """Why a bench must be made safe, what of it, and whether the run's process has let go of it."""

    why: str
    instruments: Sequence[str]
    let_go: bool = False


class Ready(Protocol):
    """What a guardian gets ready while the run still lives."""

    def prepare(self, names: Sequence[str]) -> None:
        """Load all that instruments need."""
        ...

    def hold(self, names: list[str], files: list[int]) -> None:
        """Hold a lock together with the run."""
        ...

    def see(self, sightings: Sequence[Mapping[str, Any]]) -> None:
        """Know what witnesses saw of the sources that the run drives."""
        ...

    def leave_to_peer(self) -> None:
        """Let the other guardian be who speaks to the operator."""
        ...


class Watching:
    """What a guardian hears of its run, and whether it is its turn to act."""

    def __init__(
        self,
        run: GuardianLine,
        peer: Peer,
        rank: int,
        ready: Ready,
    ) -> None:
        self._run = run
        self._peer = peer
        self._rank = rank
        self._ready = ready
        self._silence = Silence()
        self._watched: list[str] = []
        self._handed_over: str | None = None
        self._dismissed = False

    def until_end(self) -> SafingOrder | None:
        """Return what is to be done once it is this guardian's turn, None where nothing is.

        A run that stands still before it has anything to watch is waited for. The second guardian
        leaves it to the first as long as that gives signs of life.
        """
        looks, number = Looks(), 0
        while True:
            self._wait()
            if looks.due():
                number += 1
                self._silence.look()
                self._peer.look()
                if number * LOOKS_EVERY_S % BEATS_EVERY_S == 0.0:
                    self._run.send(message_of(BEAT))
                    self._peer.say(BEAT)
            self._peer.listen()
            if self._peer.waits:
                self._ready.leave_to_peer()
            for message, files in self._run.received():
                self._silence.heard()
                self._take(message, files)
            if self._dismissed or self._peer.done:
                return None
            why = self._why()
            if why is None:
                continue
            if not self._watched:
                return None
            if self._rank == 0 or not self._peer.can_act:
                also = f"; {FIRST_IS_GONE}" if self._rank else ""
                return SafingOrder(why + also, self._watched, let_go=self._handed_over is not None)

    def _wait(self) -> None:
        """Wait until somebody says something, not longer than until the next look."""
        channels = [self._run, self._peer.channel]
        ends = [channel.end for channel in channels if channel is not None and not channel.ended]
        wait_for_any(ends, LOOKS_EVERY_S)

    def _why(self) -> str | None:
        if self._handed_over is not None:
            return self._handed_over
        if self._run.ended:
            return CHANNEL_ENDED
        if self._watched and self._silence.seconds >= SILENT_FOR_S:
            return STANDS_STILL
        return None

    def _take(self, message: dict[str, Any], files: list[int]) -> None:
        """Do what the run says; other words are for guardians that know them."""
        match message.get("say"):
            case word if word == DISMISS:
                self._dismissed = True
            case word if word == HAND_OVER:
                self._handed_over = str(message.get("why"))
            case word if word == LOCKS:
                self._ready.hold(message["names"], files)
            case word if word == WITNESSES:
                self._ready.see(message["sightings"])
            case word if word == PEER:
                self._peer.becomes(files[0], message["pid"])
            case word if word == WATCH:
                names = message["instruments"]
                self._watched += [name for name in names if name not in self._watched]
                with suppress(StationError):  # without its driver it is named later
                    self._ready.prepare(self._watched)


def first_message(run: GuardianLine) -> dict[str, Any] | None:
    """Wait for the first message of a run and return it, None where the run ends before it."""
    while not run.ended:
        wait_for_any([run.end])
        for message, _ in run.received():
            return message
    return None
