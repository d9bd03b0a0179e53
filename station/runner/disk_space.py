"""How much disk a run is expected to need, and how much there is."""

from __future__ import annotations

import io
import math
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station import registry

if TYPE_CHECKING:
    from station.clock import Clock
    from station.instruments.bench import Bench
    from station.method.work import Forecast

ROOM = 1.2
"""So many times what a plan needs must be free."""
BESIDE_RAW_BYTES = 5_000_000
"""Log, tables, results and the two copies of the report."""
FRAMING_BYTES = 80
"""What a block's chunk and message add to its rows."""
COLUMNS_IF_NOT_TOLD = 8


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
    from station.method.work import POLL_S

    total = BESIDE_RAW_BYTES
    for recording in forecast.recordings:
        looks = math.ceil(recording.duration_s / clock.holding_s(POLL_S))
        row, block = widths(columns_of(bench, recording.instrument))
        total += recording.rows * row + min(looks, recording.rows) * block
    return total


def columns_of(bench: Bench, instrument: str) -> tuple[str, ...]:
    """Return the columns that the driver of an instrument says it records."""
    driver = registry.load(registry.DRIVERS, bench.instruments[instrument].driver)
    told: Any = getattr(driver, "columns", None)
    return tuple(told) if told else tuple(f"column-{n}" for n in range(COLUMNS_IF_NOT_TOLD))


def widths(columns: tuple[str, ...]) -> tuple[int, int]:
    """Return the most bytes of a row of such columns in the raw record, and of a block's frame."""
    import numpy as np

    from station.record.raw import ARRIVAL

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
    return next(one for one in (whole, *whole.parents) if one.exists())
