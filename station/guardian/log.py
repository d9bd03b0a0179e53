"""guardian.jsonl: what a guardian did for a run that died, and how the bench was left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from station.record.events import Event, read_events

GUARDIAN_LOG = "guardian.jsonl"
SAFE_STATE = "safe-state"
LEFT = "left"
WHOLE_BENCH = "every instrument that can harm"
WHAT_WAS_OPENED = "every instrument that the run had opened"


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
    event, known = _latest(run_events, of_guardian)
    return list(event.details["outcomes"]) if event else [] if known else None


def read_back_from(run_events: Sequence[Event], of_guardian: Sequence[Event]) -> str:
    """Return in words which instruments the latest safe state was read back from.

    A run reads the whole bench and names what it could not read; a guardian reads what its run had
    opened.
    """
    event, _ = _latest(run_events, of_guardian)
    if event is not None and event in of_guardian:
        return WHAT_WAS_OPENED
    left_out = event.details.get("left_out", ()) if event else ()
    listed = " and ".join(f"{one['instrument']} ({one['why']})" for one in left_out)
    return f"{WHOLE_BENCH}, except {listed}" if listed else WHOLE_BENCH


def _latest(run_events: Sequence[Event], of_guardian: Sequence[Event]) -> tuple[Event | None, bool]:
    """Return the event of the latest safe state of what a run opened, and whether there is any."""
    opened = max(
        (n for n, event in enumerate(run_events) if event.kind == "identified"), default=-1
    )
    said = [(float(n), event) for n, event in enumerate(run_events)]
    # Between the last line that the run had written, and the next one of a resumed run.
    said += [(event.details["after_events"] - 0.5, event) for event in of_guardian]
    latest = [
        (place, event) for place, event in said if event.kind == SAFE_STATE and place > opened
    ]
    latest.sort(key=lambda one: one[0])
    # A run that opened nothing has nothing to say of what was left before it.
    telling = [
        event
        for _, event in latest
        if any(one.get("used", True) for one in event.details["outcomes"])
    ]
    return telling[-1] if telling else None, bool(latest)


def last_word_of_guardian(
    run_events: Sequence[Event], of_guardian: Sequence[Event]
) -> Event | None:
    """Return the last event of the guardian where it came after everything that the run did."""
    last = of_guardian[-1] if of_guardian else None
    return last if last and last.details["after_events"] >= len(run_events) else None
