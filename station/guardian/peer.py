"""The other guardian of a run, as this one sees it: each acts where the other cannot."""

from __future__ import annotations

import socket
from collections.abc import Callable
from threading import Event, Thread

from station.guardian.channel import Channel
from station.guardian.messages import (
    BEAT,
    BEATS_EVERY_S,
    DONE,
    SILENT_FOR_S,
    WAITS,
    Silence,
    said,
)
from station.guardian.other_process import OtherProcess


class Peer:
    """The other guardian: none until the run has made them known to each other."""

    def __init__(self) -> None:
        self.done = False
        """Whether it has said that nothing is left to be done."""
        self.waits = False
        """Whether it has said that it goes on trying."""
        self.process: OtherProcess | None = None
        self.channel: Channel | None = None
        self._silence = Silence()

    def becomes(self, end: int, pid: int) -> None:
        """From now on it is process `pid`, at the other end of a socket."""
        if self.channel is not None:
            self.channel.close()
        self.channel = Channel(socket.socket(fileno=end))
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
            self.channel.send(said(what))

    def beat_while(self, within_time: Callable[[], bool]) -> Event:
        """Beat from a thread of its own while `within_time`, until the returned event is set."""
        ended = Event()

        def beat() -> None:
            while not ended.wait(BEATS_EVERY_S):
                if within_time():
                    self.say(BEAT)

        Thread(target=beat, name="beats", daemon=True).start()
        return ended
