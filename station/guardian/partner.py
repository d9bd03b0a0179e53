"""One guardian process, as the run that started it sees it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from station.guardian.channel import Channel
from station.guardian.messages import SILENT_FOR_S, Instructions, Silence

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
        self.channel = Channel(own)
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
        return f"gave no sign of life for {SILENT_FOR_S:g} s" if silent else None

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
        from station.guardian.channel import SHARE_BYTES

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
