"""How much memory the evaluation of a run is expected to need, and how much the computer has."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from station.runner.disk_space import in_bytes

if TYPE_CHECKING:
    from station.method.work import Forecast

PROGRAM_BYTES = 180_000_000
"""The program with its libraries, and a report of the usual length."""
HELD_ROW_BYTES = 250
"""What a recorded row takes in an evaluation that holds all rows at once."""
GROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")
MEMORY_TABLE = Path("/proc/meminfo")


@dataclass(frozen=True)
class Memory:
    """What the evaluation of a run is expected to need at its peak, and what the computer has.

    `fitted_bytes` is all that this process may use, `free_bytes` what of it is free now; None where
    the system does not say.
    """

    needed_bytes: int
    fitted_bytes: int | None
    free_bytes: int | None

    @property
    def too_small(self) -> bool:
        """Whether the evaluation would not fit into this computer."""
        return self.fitted_bytes is not None and self.needed_bytes > self.fitted_bytes

    @property
    def taken(self) -> bool:
        """Whether it would fit, but not beside what runs on the computer now."""
        free = self.free_bytes
        return not self.too_small and free is not None and self.needed_bytes > free

    def fault(self) -> str:
        """Say that the memory is too small, and what to do."""
        fitted = in_bytes(self.fitted_bytes or 0)
        return (
            f"the evaluation needs about {in_bytes(self.needed_bytes)} of memory, this computer "
            f"has {fitted}; take shorter records, or another computer"
        )

    def warning(self) -> str:
        """Say that others hold the memory, and what to do."""
        free = in_bytes(self.free_bytes or 0)
        return (
            f"the evaluation needs about {in_bytes(self.needed_bytes)} of memory, {free} are free "
            "now; close other programs before the run ends"
        )


def memory_of(forecast: Forecast) -> Memory:
    """Return what the evaluation of a foreseen run needs of this computer's memory."""
    held = forecast.held_bytes
    if held is None:
        held = HELD_ROW_BYTES * sum(recording.rows for recording in forecast.recordings)
    fitted, free = fitted_bytes(), free_bytes()
    return Memory(PROGRAM_BYTES + held, fitted, free)


def fitted_bytes() -> int | None:
    """Return the memory that this process may use: the computer's, or its group's limit."""
    try:
        fitted = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None
    try:
        allowed = int(GROUP_LIMIT.read_text(encoding="utf-8"))
    except (OSError, ValueError):  # no such group, or `max`: none
        return fitted
    return min(fitted, allowed)


def free_bytes() -> int | None:
    """Return the memory that programs can still take without swapping (Linux)."""
    try:
        lines = MEMORY_TABLE.read_text(encoding="utf-8").splitlines()
        (line,) = [line for line in lines if line.startswith("MemAvailable:")]
        return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        return None
