"""How a run stands: while another process runs it, and after that one died."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from station.clock import utc_now
from station.errors import InputError, StationError
from station.files.locks import is_held
from station.guardian.notes import AtWork, guardian_at_work
from station.record.events import guardian_events, read_events
from station.record.layout import EVENTS, LOCK
from station.record.run_names import runs_below, stamp_of
from station.record.run_state import RunState, State


@dataclass(frozen=True)
class Status:
    """How a run stands; what its log does not tell is None. Times in s of run (bench) time."""

    run: str
    state: State
    running: bool
    procedure: str | None
    dut: dict[str, str] | None
    step: str | None
    step_title: str | None
    units_finished: tuple[str, ...]
    units_planned: int | None
    run_time_s: float
    remaining_s: float | None
    bench_safe: bool | None
    left_out: tuple[dict[str, str], ...]
    """What can harm and was not read back at the end, or before the steps: instrument and why."""
    message: str

    def to_data(self) -> dict[str, Any]:
        """Return the status as plain data."""
        lists = {"units_finished": list(self.units_finished), "left_out": list(self.left_out)}
        return {**asdict(self), **lists}


def newest_run(parent: Path) -> Path:
    """Return the run folder below `parent` that began last; raises InputError without one."""
    runs = runs_below(parent)
    if not runs:
        raise InputError(f"there is no run below {parent}; name a run folder")
    return max(runs, key=lambda run: (stamp_of(run), (run / EVENTS).stat().st_mtime))


def read_state(folder: Path) -> RunState:
    """Return what the logs of a run, and of its guardian, say of it.

    Raises InputError when it is no run folder, RecordError when a log was altered.
    """
    log = folder / EVENTS
    if not log.is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    return RunState(read_events(log), guardian_events(folder))


def read_status(folder: Path) -> Status:
    """Return how the run of a folder stands now; raises as `read_state`."""
    held = is_held(folder / LOCK)  # first: a run that ends meanwhile has then ended in its log
    run = read_state(folder)
    state, planned, at_work = run.state(held=held), run.planned, guardian_at_work(folder)
    now_s, safe = run_time_s(folder, run, state), run.safe_state()
    rests = all(outcome["verified"] for outcome in safe) if safe else None
    return Status(
        run=str(folder),
        state=state,
        running=held,
        procedure=planned.get("procedure"),
        dut=planned.get("dut"),
        step=run.step.get("step"),
        step_title=run.step.get("title"),
        units_finished=tuple(run.units),
        units_planned=len(planned.get("units") or ()) or None,
        run_time_s=round(now_s - run.began_s, 3),
        remaining_s=run.remaining_s(now_s),
        # A guardian that has read the bench back as safe looks at it once more before it says so.
        bench_safe=None if rests and at_work else rests,
        left_out=tuple(run.left_out()),
        message=message_of(run, at_work),
    )


def run_time_s(folder: Path, run: RunState, state: State) -> float:
    """Return the run time now in s: that of the last event, and what has passed since."""
    if not run.speed or state not in ("running", "paused"):
        return run.last_s
    age_s = utc_now().timestamp() - (folder / EVENTS).stat().st_mtime
    return run.last_s + max(age_s, 0.0) * run.speed


def message_of(run: RunState, at_work: AtWork | None) -> str:
    """Return the last thing there is to say of a run to a person, with what its guardian does."""
    if at_work is None:
        return run.message()
    return run.message(at_work.sentence(), goes_on=bool(at_work.waits_for))


def is_active(folder: Path) -> bool:
    """Whether a process is at work on a run, its own or its guardian's."""
    try:
        return is_held(folder / LOCK) or guardian_at_work(folder) is not None
    except (OSError, StationError):  # nobody can act on it by its name then
        return False
