"""The process of the run, as its guardian can end it and know that it has ended."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress

from station.clock import RealClock

LOOKS_EVERY_S = 0.002


class RunnerProcess:
    """The process that started this one, held so that its number can never become another's."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._handle = _handle_of(pid)

    def end(self, within_s: float) -> bool:
        """Kill the process, a stopped one too, and wait; whether it has ended within real time.

        Once it has, the system has closed its serial ports and connections and given its locks
        back.
        """
        clock = RealClock()
        until_s = clock.now() + within_s
        if not self._ended():
            self._kill()
        while not self._ended():
            if clock.now() >= until_s:
                return False
            clock.sleep(LOOKS_EVERY_S)
        return True

    if sys.platform == "win32":

        def _kill(self) -> None:
            import ctypes

            ctypes.windll.kernel32.TerminateProcess(self._handle, 1)

        def _ended(self) -> bool:
            import ctypes

            return bool(ctypes.windll.kernel32.WaitForSingleObject(self._handle, 0) == 0)

    else:

        def _kill(self) -> None:
            with suppress(ProcessLookupError):
                if self._handle is not None:
                    signal.pidfd_send_signal(self._handle, signal.SIGKILL)
                else:
                    os.kill(self._pid, signal.SIGKILL)

        def _ended(self) -> bool:
            if self._handle is not None:
                import select

                # poll, not select: the number of the handle may be large.
                looking = select.poll()
                looking.register(self._handle, select.POLLIN)
                return bool(looking.poll(0))
            # Without such handles: a process whose parent has ended is given another one.
            return os.getppid() != self._pid


if sys.platform == "win32":
    SYNCHRONIZE, PROCESS_TERMINATE = 0x00100000, 0x0001

    def _handle_of(pid: int) -> int | None:
        import ctypes

        return int(ctypes.windll.kernel32.OpenProcess(SYNCHRONIZE | PROCESS_TERMINATE, False, pid))

else:

    def _handle_of(pid: int) -> int | None:
        """Return a handle of the process where the system has them (Linux), else None."""
        if not hasattr(os, "pidfd_open"):
            return None
        with suppress(OSError):  # an old kernel, or one that forbids it
            return os.pidfd_open(pid)
        return None
