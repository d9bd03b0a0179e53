"""What is found out about the computer before a run begins, and watched while it goes on."""

from __future__ import annotations

import io
import math
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station import registry
from station.acquisition import POLL_S
from station.clock import RealClock, boot_seconds, system_clock_synchronised, utc_now
from station.errors import RecordError

if TYPE_CHECKING:
    from station.bench import Bench
    from station.clock import Clock
    from station.plan import Plan
    from station.procedure import Forecast, Procedure
    from station.record.folder import RunRecord

LONG_RUN_S = 3600.0
ROOM = 1.2
"""So many times what a plan needs must be free."""
BESIDE_RAW_BYTES = 5_000_000
"""Log, tables, results and the two copies of the report."""
BYTES_OF_A_NUMBER = 8
"""No column of raw data is wider."""
FRAMING_BYTES = 80
"""What a block's chunk and message add to its rows."""
COLUMNS_IF_NOT_TOLD = 8
SMALLEST_JUMP_S = 0.5


@dataclass(frozen=True)
class Warned:
    """Something that does not keep a run from going on: the event's kind, and a sentence."""

    kind: str
    sentence: str


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


def look_before_a_run(
    plan: Plan, procedure: Procedure, bench: Bench, output: Path, clock: Clock, *, real: bool
) -> list[Warned]:
    """Return what the operator should know before a run begins; nothing is written.

    `real` says that instruments are real ones. Raises RecordError when `output` cannot hold the
    run folder, or its disk is too small for the plan.
    """
    fault = fault_of_output(output)
    if fault is not None:
        raise RecordError(fault)
    disk = disk_of(procedure.forecast(plan.parameters, bench), bench, output, clock)
    if disk.too_small:
        raise RecordError(disk.sentence())
    expected_s = procedure.duration_s(plan.parameters)
    return list(warned_of_clock(expected_s, real=real, synchronised=system_clock_synchronised()))


def warned_of_clock(
    expected_s: float, *, real: bool, synchronised: bool | None
) -> Iterator[Warned]:
    """Yield that the system clock may be wrong, where a long run on real instruments is to begin.

    `synchronised` None says that it is not known, and is no reason to warn.
    """
    if real and expected_s > LONG_RUN_S and synchronised is False:
        yield Warned(
            "system-clock-unsynchronised",
            "nothing keeps this computer's clock right, so the times of day in the record may be "
            "wrong; raw data and results do not depend on it; switch on time synchronisation "
            "(NTP) before the next run",
        )


def fault_of_output(output: Path) -> str | None:
    """Return why no run folder can be created below `output`, None where nothing is known of."""
    there = nearest_there(output)
    if not there.is_dir():
        return f"{there} is no folder, so no run can be recorded in {output}" + ELSEWHERE
    if not os.access(there, os.W_OK | os.X_OK):
        return f"nothing can be written in {there}, so no run can be recorded there" + ELSEWHERE
    return None


ELSEWHERE = "; choose another place with --output"


def nearest_there(path: Path) -> Path:
    """Return the path, or the nearest one above it that exists."""
    whole = path.absolute()
    return next(one for one in (whole, *whole.parents) if one.exists())


def disk_of(forecast: Forecast, bench: Bench, output: Path, clock: Clock) -> Disk:
    """Return the room on the disk of `output` and what a run that is foreseen needs of it."""
    there = nearest_there(output)
    return Disk(output, needed_bytes(forecast, bench, clock), shutil.disk_usage(there).free)


def needed_bytes(forecast: Forecast, bench: Bench, clock: Clock) -> int:
    """Return the bytes a run folder is expected to need.

    Rows count with their number and the width of their columns; blocks with what frames them, one
    block at each look at a source, which the clock says how often comes.
    """
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

    rows = np.empty(0, dtype=[(name, np.float64) for name in (*columns, ARRIVAL)])
    header = io.BytesIO()
    np.save(header, rows)
    return BYTES_OF_A_NUMBER * len(rows.dtype), FRAMING_BYTES + header.tell()


def in_bytes(count: int) -> str:
    """Return a number of bytes for a person: `2.3 MB`."""
    size = float(count)
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.4g} TB"


class SystemClockWatch:
    """Find jumps of the time of day against seconds that never jump.

    Slow corrections of a synchronised clock move both alike. A computer that slept shows as a jump.
    """

    def __init__(self, unix_s: float, boot_s: float) -> None:
        self._ahead_s = unix_s - boot_s

    def jump_s(self, unix_s: float, boot_s: float) -> float | None:
        """Return the seconds by which the time of day jumped since the last call, None if not."""
        jumped_s = unix_s - boot_s - self._ahead_s
        if abs(jumped_s) < SMALLEST_JUMP_S:
            return None
        self._ahead_s += jumped_s
        return jumped_s


def watch_system_clock(record: RunRecord, clock: Clock) -> None:
    """Log at the end of each unit of work when the time of day jumped during it.

    Run time does not follow the time of day, so no data change. On virtual time nothing is
    watched: there a log is the same in every execution of a plan.
    """
    if not isinstance(clock, RealClock):
        return
    watch = SystemClockWatch(utc_now().timestamp(), boot_seconds())

    def look() -> None:
        jump_s = watch.jump_s(utc_now().timestamp(), boot_seconds())
        if jump_s is not None:
            record.event("system-clock-jumped", by_s=round(jump_s, 3))

    record.after_unit = look
