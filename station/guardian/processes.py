"""Processes of a run: the guardian that a run starts, and a process that a guardian ends."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from station.clock import RealClock
from station.guardian.messages import SILENT_FOR_S, Channel, Instructions, Silence

if sys.platform != "win32":
    import select  # now: nothing is loaded when it is needed
else:
    import ctypes

LOOKS_EVERY_S = 0.002


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
        clock.sleep(LOOKS_EVERY_S)
    return True


def let_end(process: OtherProcess, within_s: float) -> None:
    """Wait in real time until a process has ended by itself, and kill one that does not."""
    clock = RealClock()
    until_s = clock.now() + within_s
    while not process.has_ended() and clock.now() < until_s:
        clock.sleep(LOOKS_EVERY_S)
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
