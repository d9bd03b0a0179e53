"""Watch a run over the channel from it, until it is dismissed, dies, or stands still."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import wait as wait_for_any
from typing import Any, Protocol

from station.errors import StationError
from station.guardian.channel import Channel
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
    Looks,
    Silence,
    said,
)
from station.guardian.peer import Peer

CHANNEL_ENDED = "the run's process ended before it had made the bench safe"
STANDS_STILL = f"the run's process gave no sign of life for {SILENT_FOR_S:g} s of real time"
FIRST_IS_GONE = "the first guardian of the run does not act"


@dataclass(frozen=True)
class Duty:
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

    def leave_to_peer(self) -> None:
        """Let the other guardian be who speaks to the operator."""
        ...


class Watching:
    """What a guardian hears of its run, and whether it is its turn to act."""

    def __init__(
        self,
        run: Channel,
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

    def until_end(self) -> Duty | None:
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
                    self._run.send(said(BEAT))
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
                return Duty(why + also, self._watched, let_go=self._handed_over is not None)

    def _wait(self) -> None:
        """Wait until somebody says something, not longer than until the next look."""
        channels = [self._run, self._peer.channel]
        ends = [one.end for one in channels if one is not None and not one.ended]
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
            case word if word == PEER:
                self._peer.becomes(files[0], message["pid"])
            case word if word == WATCH:
                names = message["instruments"]
                self._watched += [name for name in names if name not in self._watched]
                with suppress(StationError):  # without its driver it is named later
                    self._ready.prepare(self._watched)


def first_message(run: Channel) -> dict[str, Any] | None:
    """Wait for the first message of a run and return it, None where the run ends before it."""
    while not run.ended:
        wait_for_any([run.end])
        for message, _ in run.received():
            return message
    return None
