"""Another process of the run, as a guardian can end it and know that it has ended."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress

from station.clock import RealClock

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
    for one in processes:
        if not one.has_ended():
            one.kill()
    while not all(one.has_ended() for one in processes):
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
