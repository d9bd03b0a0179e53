"""What is found out about the computer before a run begins, and watched while it goes on."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from station.clock import RealClock, boot_seconds, system_clock_synchronised, utc_now
from station.errors import RecordError
from station.runner.calibration_flags import record_flags
from station.runner.resources import disk_of, memory_of, nearest_there
from station.runner.static_limits import problems_of_plan

if TYPE_CHECKING:
    from station.clock import Clock
    from station.files.plan import Plan
    from station.instruments.bench import Bench
    from station.procedure import Procedure
    from station.record.folder import RunRecord
    from station.runner.resources import Memory

LONG_RUN_S = 3600.0
SMALLEST_JUMP_S = 0.5
ELSEWHERE = "; choose another place with --output"


@dataclass(frozen=True)
class Warned:
    """Something that does not keep a run from going on: the event's kind, and a sentence."""

    kind: str
    sentence: str


def preflight(
    plan: Plan, procedure: Procedure, bench: Bench, output: Path, clock: Clock, *, real: bool
) -> list[Warned]:
    """Return what the operator should know before a run begins; nothing is written.

    `real` says that instruments are real ones. Raises RecordError when `output` cannot hold the
    run folder, or its disk is too small for the plan.
    """
    fault = fault_of_output(output)
    if fault is not None:
        raise RecordError(fault)
    # A plan that does not fit the bench foresees nothing; opening the bench says what is wrong.
    warned: list[Warned] = []
    if not any(problems_of_plan(procedure, plan.parameters, bench)):
        foreseen = procedure.forecast(plan.parameters, bench)
        disk = disk_of(foreseen, bench, output, clock)
        if disk.too_small:
            raise RecordError(disk.sentence())
        warned += warned_of_memory(memory_of(foreseen))
    expected_s = procedure.duration(plan.parameters).expected_s
    synchronised = system_clock_synchronised()
    return [
        *warned,
        *warned_of_limits(plan, procedure),
        *warned_of_records(plan, procedure, bench),
        *warned_of_clock(expected_s, real=real, synchronised=synchronised),
    ]


def warned_of_limits(plan: Plan, procedure: Procedure) -> Iterator[Warned]:
    """Yield each limit of a plan on a result that the plan does not determine alone."""
    limited = {name for name, _ in plan.limits}
    for name, sentence in procedure.undetermined(plan.parameters).items() if limited else ():
        if name in limited:
            yield Warned("limit-not-determined", str(plan.fault(("limits", name), sentence)))


def warned_of_records(plan: Plan, procedure: Procedure, bench: Bench) -> Iterator[Warned]:
    """Yield what calibration records lack for a plan, what of them it does not use, what is due."""
    for flag in record_flags(procedure, plan.parameters, bench):
        yield Warned(flag.code, flag.message)
    today = utc_now().date()
    for name in procedure.walk(plan.parameters).used_on(bench):
        record = bench.record(name)
        if record is not None and record.overdue(today):
            yield Warned(
                "calibration-overdue",
                f"The calibration of {name} was due on {record.due}; the results will be flagged.",
            )


def warned_of_memory(memory: Memory) -> Iterator[Warned]:
    """Yield that other programs hold the memory which the evaluation needs."""
    if memory.taken:
        yield Warned("memory-taken", memory.warning())


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


def readings() -> tuple[float, float]:
    """Return the time of day as Unix time, and seconds that never jump."""
    return utc_now().timestamp(), boot_seconds()


def watch_system_clock(
    record: RunRecord, clock: Clock, read: Callable[[], tuple[float, float]] = readings
) -> None:
    """Log at the end of each unit of work when the time of day jumped during it.

    Run time does not follow the time of day, so no data change. On virtual time nothing is
    watched: there a log is the same in every execution of a plan.
    """
    if not isinstance(clock, RealClock):
        return
    watch = SystemClockWatch(*read())

    def look(unit: str) -> None:
        jump_s = watch.jump_s(*read())
        if jump_s is not None:
            record.event("system-clock-jumped", by_s=round(jump_s, 3))

    record.after_unit.append(look)
