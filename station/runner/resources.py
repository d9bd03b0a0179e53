"""How much disk and memory a run is expected to need, and how much there is."""

from __future__ import annotations

import io
import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station import registry

if TYPE_CHECKING:
    from station.clock import Clock
    from station.instruments.bench import Bench
    from station.method.dry_run import Forecast


ROOM = 1.2
"""So many times what a plan needs must be free."""
BESIDE_RAW_BYTES = 5_000_000
"""Log, tables, results and the two copies of the report."""
FRAMING_BYTES = 80
"""What a block's chunk and message add to its rows."""
DEFAULT_COLUMN_COUNT = 8


@dataclass(frozen=True)
class Disk:
    """The room on the disk of the output folder, and what a run is expected to need of it."""

    folder: Path
    needed_bytes: int
    free_bytes: int

    @property
    def too_small(self) -> bool:
        """Whether the run would fill the disk, or nearly."""
        return self.needed_bytes * ROOM > self.free_bytes

    def sentence(self) -> str:
        """Say that the disk is too small, and what to do."""
        return (
            f"the disk of {self.folder} is too small for this plan: it needs about "
            f"{in_bytes(self.needed_bytes)} and {ROOM:g} times that must be free, free are "
            f"{in_bytes(self.free_bytes)}; make room, or choose another disk with --output"
        )


def disk_of(forecast: Forecast, bench: Bench, output: Path, clock: Clock) -> Disk:
    """Return the room on the disk of `output` and what a run that is foreseen needs of it."""
    there = nearest_there(output)
    return Disk(output, needed_bytes(forecast, bench, clock), shutil.disk_usage(there).free)


def needed_bytes(forecast: Forecast, bench: Bench, clock: Clock) -> int:
    """Return the bytes a run folder is expected to need.

    Rows count with their number and the width of their columns; blocks with what frames them, one
    block at each look at a source, which the clock says how often comes.
    """
    from station.method.verbs import POLL_S

    total = BESIDE_RAW_BYTES
    for recording in forecast.recordings:
        looks = math.ceil(recording.duration_s / clock.holding_s(POLL_S))
        row, block = widths(columns_of(bench, recording.instrument))
        total += recording.rows * row + min(looks, recording.rows) * block
    return total


def columns_of(bench: Bench, instrument: str) -> tuple[str, ...]:
    """Return the columns that the driver of an instrument says it records."""
    driver = registry.load(registry.DRIVERS, bench.instruments[instrument].driver)
    names: Any = getattr(driver, "columns", None)
    return tuple(names) if names else tuple(f"column-{n}" for n in range(DEFAULT_COLUMN_COUNT))


def widths(columns: tuple[str, ...]) -> tuple[int, int]:
    """Return the most bytes of a row of such columns in the raw record, and of a block's frame."""
    import numpy as np

    from station.roles.base import ARRIVAL

    # No column of raw data is wider than this.
    rows = np.empty(0, dtype=[(name, np.float64) for name in (*columns, ARRIVAL)])
    header = io.BytesIO()
    np.save(header, rows)
    return rows.dtype.itemsize, FRAMING_BYTES + header.tell()


def in_bytes(count: int) -> str:
    """Return a number of bytes for a person: `2.3 MB`."""
    size = float(count)
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.4g} TB"


def nearest_there(path: Path) -> Path:
    """Return the path, or the nearest one above it that exists."""
    whole = path.absolute()
    return next(folder for folder in (whole, *whole.parents) if folder.exists())


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
