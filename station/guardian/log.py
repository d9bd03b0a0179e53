"""guardian.jsonl: what a guardian did for a run that died, and how the bench was left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from station.record.events import Event, read_events

GUARDIAN_LOG = "guardian.jsonl"
SAFE_STATE = "safe-state"
BENCH_READ = "bench-read"


def guardian_events(folder: Path) -> tuple[Event, ...]:
    """Return the events of a run's guardian; none where it never had to act.

    Raises RecordError when the log was altered. `after_events` in each is how many lines the log
    of the run had when its process was dead.
    """
    log = folder / GUARDIAN_LOG
    return tuple(read_events(log)) if log.is_file() else ()


def latest_safe_state(
    run_events: Sequence[Event], of_guardian: Sequence[Event]
) -> list[dict[str, Any]] | None:
    """Return the outcomes of the safe state in which a run left its bench.

    None where the bench was not made safe since its instruments were opened last, or where the
    guardian is still at it.
    """
    opened = max(
        (n for n, event in enumerate(run_events) if event.kind == "identified"), default=-1
    )
    said = [(float(n), event) for n, event in enumerate(run_events)]
    # Between the last line that the run had written, and the next one of a resumed run.
    said += [(event.details["after_events"] - 0.5, event) for event in of_guardian]
    latest = [
        (place, event.details["outcomes"])
        for place, event in said
        if event.kind == SAFE_STATE and place > opened
    ]
    latest.sort(key=lambda one: one[0])
    # A run that opened nothing has nothing to say of what was left before it.
    telling = [outcomes for _, outcomes in latest if any(one.get("used", True) for one in outcomes)]
    return list(telling[-1]) if telling else [] if latest else None


def last_word_of_guardian(
    run_events: Sequence[Event], of_guardian: Sequence[Event]
) -> Event | None:
    """Return the last event of the guardian where it came after everything that the run did."""
    acts = [event for event in of_guardian if event.kind != BENCH_READ]
    last = acts[-1] if acts else None
    return last if last and last.details["after_events"] >= len(run_events) else None
