"""The run's side of its guardians: start two, stay alive, replace one that is lost, dismiss them.

Whatever they do, or do not do, the run never waits for them beyond the times named here.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import wait as wait_for_any
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import Any

from station.clock import Clock, RealClock
from station.console import tell
from station.errors import StationError
from station.guardian.messages import (
    BEAT,
    BEATS_EVERY_S,
    DISMISS,
    HAND_OVER,
    LOCKS,
    LOOKS_EVERY_S,
    PEER,
    SILENT_FOR_S,
    WATCH,
    WITNESSES,
    GuardianLine,
    Instructions,
    Looks,
    Silence,
    line_of,
    message_of,
)
from station.instruments.instrument_locks import InstrumentLocks
from station.record.layout import BENCH

ENDS_WITHIN_S, KILLED_WITHIN_S = 5.0, 2.0
A_BEAT = line_of(message_of(BEAT))
"""Made once: where there is no memory left the run may still live."""
TAKES_WITHIN_S = 5.0
"""How long the thread that talks to the guardians may take for anything that is asked of it."""
STARTS_AGAIN_EVERY_S, SAYS_EVERY_S = 10.0, 30.0
REPLACED = "{} of this run {}; a new one is being started"
LOST = (
    "{} of this run {} and no new one can be started ({}): if the run is killed now, {}; end the "
    "run with Ctrl-C, or stay beside the bench"
)
LEFT = ("only the second one makes the bench safe", "only the first one makes the bench safe")
NOBODY = "nothing makes the bench safe"


READY_WITHIN_S = 20.0
RANKS = ("first", "second")


class Partner:
    """A guardian that was started; raises OSError where that cannot be done."""

    def __init__(self, instructions: Instructions) -> None:
        own, its = socket.socketpair()
        try:
            self.process = start_process(its, instructions.rank)
        except BaseException:
            own.close()
            raise
        finally:
            its.close()
        self.channel = GuardianLine(own)
        self.pid = self.process.pid
        self.ready = False
        """Whether it has its drivers and can act."""
        self._failed = ""
        self._silence = Silence()
        self.channel.send(instructions.to_data())

    def listen(self) -> bool:
        """Take what it has said; whether it has become ready by that."""
        was_ready = self.ready
        for message, _ in self.channel.received():
            self._silence.heard()
            self.ready = self.ready or bool(message.get("ready"))
            self._failed = message.get("failed", self._failed)
        return self.ready and not was_ready

    def look(self) -> None:
        """Count one look at which it had said nothing."""
        self._silence.look()

    def lost(self) -> str | None:
        """Return why it is of no use any more, None while it is."""
        if self._failed:
            return f"cannot do its work: {self._failed}"
        if self.channel.ended:
            return "has ended" if self.ready else "ended before it was ready"
        if not self.ready:
            late = self._silence.seconds >= READY_WITHIN_S
            return f"was not ready within {READY_WITHIN_S:g} s" if late else None
        silent = self._silence.seconds >= SILENT_FOR_S
        return f"did not respond for {SILENT_FOR_S:g} s" if silent else None

    def end(self, within_s: float = 0.0) -> None:
        """Let it end, kill it where it does not, and wait for that, but not for ever."""
        for kill, seconds in ((False, within_s), (True, 1.0)):
            if kill:
                self.process.kill()
            with suppress(subprocess.TimeoutExpired):  # a process stuck in the system cannot die
                self.process.wait(seconds)
                break
        self.channel.close()


if sys.platform == "win32":

    def start_process(end: socket.socket, rank: int) -> subprocess.Popen[bytes]:
        """Start a guardian that neither Ctrl-C nor a closing terminal reaches; raises OSError."""
        from station.guardian.messages import SHARE_BYTES

        process = subprocess.Popen(
            command(rank),
            stdin=subprocess.PIPE,
            bufsize=0,
            env=environment(),
            creationflags=subprocess.CREATE_NEW_PROCESS_GROUP,
        )
        assert process.stdin is not None
        process.stdin.write(end.share(process.pid).ljust(SHARE_BYTES, b"\n"))
        process.stdin.close()
        return process

else:

    def start_process(end: socket.socket, rank: int) -> subprocess.Popen[bytes]:
        """Start a guardian that neither Ctrl-C nor a closing terminal reaches; raises OSError."""
        return subprocess.Popen(
            command(rank), stdin=end.fileno(), env=environment(), start_new_session=True
        )


def command(rank: int) -> list[str]:
    """Return how a guardian is started; it takes no package from the present folder alone.

    Its rank is there for whoever looks at the processes of the computer.
    """
    return [sys.executable, "-P", "-m", "station.guardian", RANKS[rank]]


def environment() -> dict[str, str]:
    """Return its environment: it finds the packages that this process finds."""
    places = [place or str(Path.cwd()) for place in sys.path]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(places)}


class GuardianFailed(StationError):
    """A guardian that cannot do its work; nothing was energised yet."""


def no_event(kind: str, **details: Any) -> None:
    """Keep no log."""


class Guardian:
    """Two processes that make the bench safe if this one dies or stands still.

    The first acts; the second acts when the first is gone, too. Raises GuardianFailed unless they
    are ready, their drivers in memory, within 20 s; with `wait` False only `wait_ready` does.
    `bench` is the resolved bench file, by default the run folder's; `instruments` are those that
    the run uses, by default all of the bench. What becomes of a guardian is said by `on_lost` and
    noted by `note`, in a thread of this object's own. A sign of life is given only where
    `may_beat` says that the run lives. `bench_file` and `real` are as of `Instructions`.
    """

    def __init__(
        self,
        folder: Path,
        bench: Path | None,
        addresses: Mapping[str, str],
        clock: Clock,
        *,
        instruments: Sequence[str] | None = None,
        world: str = "",
        wait: bool = True,
        on_lost: Callable[[str], None] = tell,
        note: Callable[..., None] = no_event,
        may_beat: Callable[[], bool] = lambda: True,
        bench_file: Path | None = None,
        real: bool = False,
    ) -> None:
        if not isinstance(clock, RealClock):
            raise GuardianFailed("a bench that is simulated in this process ends with it")
        self._say = on_lost
        self._note = note
        self._may_beat = may_beat
        self._instructions = Instructions(
            folder=str(folder.resolve()),
            bench=str((bench or folder / BENCH).resolve()),
            instruments=list(instruments or ()),
            addresses=dict(addresses),
            runner_pid=os.getpid(),
            speed=clock.speed,
            epoch_unix=clock.epoch_unix,
            world=world,
            bench_file=str(bench_file.resolve()) if bench_file else "",
            real=real,
        )
        self._watched: list[str] = []
        self._sightings: list[dict[str, Any]] = []
        self._locks: list[tuple[list[str], list[int]]] = []
        self._known = Event()
        """Whether it is known that both are ready, or why not."""
        self._failed = ""
        self._ended = False
        self._due: SimpleQueue[tuple[Callable[[], None], Event]] = SimpleQueue()
        self._woken, self._wake = socket.socketpair()
        self._wake.setblocking(False)
        self._partners: dict[int, Partner | None] = {}
        self._lost_s: dict[int, float] = {}
        self._starts_s: dict[int, float] = {}
        self._says_s: dict[int, float] = {}
        self._real = RealClock()
        try:
            for rank in range(len(RANKS)):
                self._partners[rank] = Partner(replace(self._instructions, rank=rank))
        except OSError as error:
            self._end_partners(0.0)
            raise GuardianFailed(f"the guardian cannot be started: {error}") from error
        self._thread = Thread(target=self._supervise, name="guardians", daemon=True)
        self._thread.start()
        if wait:
            self.wait_ready()

    @property
    def pids(self) -> list[int]:
        """The processes that are there, the first guardian's first."""
        return [partner.pid for partner in self._partners.values() if partner is not None]

    def wait_ready(self) -> None:
        """Wait until the guardians have their drivers and can act; raises GuardianFailed."""
        if not self._known.wait(READY_WITHIN_S + TAKES_WITHIN_S):
            self._failed = f"was not ready within {READY_WITHIN_S:g} s"
        if self._failed:
            raise GuardianFailed(f"the guardian of the run {self._failed}")

    def watch(self, instruments: Sequence[str], locks: InstrumentLocks | None = None) -> None:
        """From now on these are made safe, too, if the run dies; before anything is energised.

        The guardians hold the `locks` together with this process from then on. Raises
        GuardianFailed where the guardians are gone or were never ready.
        """
        self.wait_ready()
        reached: list[Partner] = []

        def begin() -> None:
            self._watched += [name for name in instruments if name not in self._watched]
            if locks is not None:
                self._locks = list(locks.to_hand_on())
            reached.extend(partner for partner in self._there() if self._brief(partner))

        if not self._in_thread(begin) or not reached:
            raise GuardianFailed("the guardian of the run has ended; run again")

    def sees(self, sightings: list[dict[str, Any]]) -> None:
        """Let the guardians know what witnesses saw; returns at once."""

        def inform() -> None:
            self._sightings = sightings
            self._tell_all(message_of(WITNESSES, sightings=sightings))

        self._ask(inform)

    def dismiss(self) -> None:
        """Let the guardians go: the run has made the bench safe itself. Takes 7 s at most."""
        if not self._ended:
            self._ask(lambda: self._end(message_of(DISMISS)))
            self._thread.join(ENDS_WITHIN_S + KILLED_WITHIN_S)

    def hand_over(self, why: str) -> str:
        """Let go of the instruments, not all of which are safe: the guardians go on trying.

        The lines are closed by then. Return what the operator must know of it. Where nothing was
        watched they have nothing to go on with.
        """
        if not self._watched:
            self.dismiss()
            return ""
        pids: list[int] = []

        def begin() -> None:
            there = [partner for partner in self._there() if partner.ready]
            pids.extend(partner.pid for partner in there)
            self._end(message_of(HAND_OVER, why=why))

        if self._ended or not self._in_thread(begin) or not pids:
            return "no guardian is left to go on trying: switch off by hand, now"
        return (
            f"the guardian of the run (process {pids[0]}) goes on trying and keeps the instruments "
            f"until they are safe; `station status {self._instructions.folder}` says how it "
            f"stands, `station abort {self._instructions.folder}` ends it"
        )

    def _in_thread(self, what: Callable[[], None]) -> bool:
        """Do something in the thread that talks to the guardians; whether it was done in time."""
        return self._ask(what).wait(TAKES_WITHIN_S)

    def _ask(self, what: Callable[[], None]) -> Event:
        done = Event()
        self._due.put((what, done))
        with suppress(OSError):
            self._wake.send(b"!")
        return done

    def _supervise(self) -> None:
        """Talk to the guardians, and look after them, until they are dismissed."""
        looks, beat_s = Looks(), 0.0
        while not self._ended:
            self._wait()
            if looks.due():
                for partner in self._there():
                    partner.look()
            if self._real.now() - beat_s >= BEATS_EVERY_S:
                beat_s = self._real.now()
                self._beat()
            for rank in range(len(RANKS)):
                self._look_after(rank)
            with suppress(Empty):
                what, done = self._due.get_nowait()
                what()
                done.set()
        for end in (self._wake, self._woken):
            end.close()

    def _wait(self) -> None:
        ends = [partner.channel.end for partner in self._there() if not partner.channel.ended]
        with suppress(OSError):
            if self._woken in wait_for_any([self._woken, *ends], LOOKS_EVERY_S):
                self._woken.recv(1)

    def _beat(self) -> None:
        if self._may_beat():
            for partner in self._there():
                if partner.ready:
                    partner.channel.send_line(A_BEAT)

    def _look_after(self, rank: int) -> None:
        """Take what a guardian says, and replace it where it is lost."""
        partner = self._partners[rank]
        if partner is None:
            self._start_again(rank)
            return
        if partner.listen():
            self._link()
            self._brief(partner)
            if rank in self._lost_s:
                after_s = round(self._real.now() - self._lost_s.pop(rank), 3)
                self._note(
                    "guardian-replaced", guardian=name_of(rank), pid=partner.pid, after_s=after_s
                )
            if all(there is not None and there.ready for there in self._partners.values()):
                self._known.set()
        if (why := partner.lost()) is None:
            return
        if not self._known.is_set():
            self._failed = why
            self._end_partners(0.0)
            self._ended = True
            self._known.set()
            return
        partner.end()
        self._partners[rank] = None
        if rank not in self._lost_s:
            self._lost_s[rank] = self._real.now()
            self._note("guardian-lost", guardian=name_of(rank), pid=partner.pid, message=why)
            self._say(REPLACED.format(name_of(rank), why))
            self._starts_s[rank] = self._real.now()
        else:
            self._cannot_start(rank, why)

    def _start_again(self, rank: int) -> None:
        if self._real.now() < self._starts_s[rank]:
            return
        try:
            self._partners[rank] = Partner(replace(self._instructions, rank=rank))
        except OSError as error:
            self._cannot_start(rank, error.strerror or str(error))

    def _cannot_start(self, rank: int, why: str) -> None:
        """Say so loudly, now and again, and try again later; the run goes on."""
        now_s = self._real.now()
        self._starts_s[rank] = now_s + STARTS_AGAIN_EVERY_S
        if now_s - self._says_s.get(rank, -SAYS_EVERY_S) >= SAYS_EVERY_S:
            self._says_s[rank] = now_s
            others = any(partner.ready for partner in self._there())
            what = LEFT[rank] if others else NOBODY
            self._say(LOST.format(name_of(rank), "is gone", why, what))

    def _link(self) -> None:
        """Make the two known to each other, over a line that this process keeps no end of."""
        both = [partner for partner in self._there() if partner.ready]
        if len(both) < len(RANKS) or not hasattr(socket, "send_fds"):
            return
        ends = socket.socketpair()
        for partner, other, end in zip(both, reversed(both), ends, strict=True):
            partner.channel.send(message_of(PEER, pid=other.pid), [end.fileno()])
        for end in ends:
            end.close()

    def _brief(self, partner: Partner) -> bool:
        """Say to a guardian what it watches and which locks it holds; whether it takes that."""
        if not partner.ready or not self._watched:
            return False
        if hasattr(socket, "send_fds"):
            for names, files in self._locks:
                partner.channel.send(message_of(LOCKS, names=names), files)
        partner.channel.send(message_of(WITNESSES, sightings=self._sightings))
        return partner.channel.send(message_of(WATCH, instruments=self._watched))

    def _there(self) -> list[Partner]:
        return [partner for partner in self._partners.values() if partner is not None]

    def _tell_all(self, message: Mapping[str, Any]) -> None:
        for partner in self._there():
            if partner.ready:
                partner.channel.send(message)

    def _end(self, last: Mapping[str, Any]) -> None:
        """Say the last thing; what is not ready then has nothing to do."""
        self._tell_all(last)
        self._ended = True
        if last["say"] == HAND_OVER:
            for partner in self._there():
                partner.channel.close()
        else:
            self._end_partners(ENDS_WITHIN_S)

    def _end_partners(self, within_s: float) -> None:
        until_s = RealClock().now() + within_s
        clock = RealClock()
        for partner in self._there():
            partner.end(max(until_s - clock.now(), 0.0) if partner.ready else 0.0)


def name_of(rank: int) -> str:
    """Return what a guardian is called."""
    return f"the {RANKS[rank]} guardian"
