"""Ask the operating system not to sleep while a run drives a bench.

A laptop that sleeps stops the run and its guardian, and leaves the instruments as they are.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from contextlib import suppress

WHAT = "sleep:idle"


class StayingAwake:
    """A request that the computer stay awake until this process ends; it never fails a run."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self.problem = ""
        """Why the system was not asked, as far as is known at once."""
        if sys.platform == "win32":
            import ctypes

            continuous, system_required = 0x80000000, 0x1
            asked = ctypes.windll.kernel32.SetThreadExecutionState(continuous | system_required)
            self.problem = "" if asked else "the system refuses"
            return
        command = command_for(sys.platform)
        if not shutil.which(command[0]):
            self.problem = f"there is no {command[0]}"
            return
        try:
            # The request lasts until the pipe closes: with this process, however it ends.
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError as error:
            self.problem = f"{command[0]}: {error.strerror or error}"

    def refused(self) -> str:
        """Return why the computer may sleep all the same, empty where nothing is known of that."""
        if self._process is not None and not self.problem and self._process.poll() is not None:
            self.problem = f"{command_for(sys.platform)[0]} ended with {self._process.returncode}"
        return self.problem

    def end(self) -> None:
        """Let the computer sleep again."""
        if self._process is not None:
            with suppress(OSError):
                assert self._process.stdin is not None
                self._process.stdin.close()
            self._process.kill()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)


def command_for(platform: str) -> list[str]:
    """Return the program that keeps a system awake until this process ends, or it is killed."""
    if platform == "darwin":
        return ["caffeinate", "-i", "-s", "-w", str(os.getpid())]
    why = "instruments are energised"
    who = "--who=Inertial Station"
    return ["systemd-inhibit", f"--what={WHAT}", who, f"--why={why}", "--mode=block", "cat"]
