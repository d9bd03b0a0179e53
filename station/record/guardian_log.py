"""guardian.jsonl: what a guardian did for a run that died, and how the bench was left."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from station.record.creation import GUARDIAN_LOG
from station.record.events import Event, read_events

SAFE_STATE = "safe-state"
BENCH_READ = "bench-read"
LEFT = "left"
"""A person ended a guardian that went on trying."""


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
    latest = _latest(run_events, of_guardian, SAFE_STATE)
    # A run that opened nothing has nothing to say of what was left before it.
    telling = [
        one["outcomes"]
        for one in latest
        if any(outcome.get("used", True) for outcome in one["outcomes"])
    ]
    return list(telling[-1]) if telling else [] if latest else None


def latest_left_out(
    run_events: Sequence[Event], of_guardian: Sequence[Event]
) -> list[dict[str, str]]:
    """Return what can harm and was not read back when a run left its bench: instrument and why."""
    latest = _latest(run_events, of_guardian, SAFE_STATE, BENCH_READ)
    told = [one["left_out"] for one in latest if "left_out" in one]
    return list(told[-1]) if told else []


def whole_bench(left_out: Iterable[Mapping[str, str]]) -> str:
    """Return the sentence on a bench of which everything that was read is at rest.

    What was not read comes first: with it nobody can call the bench safe.
    """
    if unknown := not_known(left_out):
        return f"{unknown}; every other instrument that can harm was read back as safe"
    return "the bench is safe, read back from every instrument that can harm"


def not_known(left_out: Iterable[Mapping[str, str]]) -> str:
    """Return that some instruments are not known to be safe, by name; empty where there is none."""
    by_reason: dict[str, list[str]] = {}
    for one in left_out:
        by_reason.setdefault(one["why"], []).append(one["instrument"])
    named = [f"{', '.join(names)} ({why})" for why, names in by_reason.items()]
    return f"NOT KNOWN to be safe: {' and '.join(named)}" if named else ""


def _latest(
    run_events: Sequence[Event], of_guardian: Sequence[Event], *kinds: str
) -> list[Mapping[str, Any]]:
    """Return what events of some kinds tell since the instruments were opened last."""
    opened = max(
        (n for n, event in enumerate(run_events) if event.kind == "identified"), default=-1
    )
    said = [(float(n), event) for n, event in enumerate(run_events)]
    # Between the last line that the run had written, and the next one of a resumed run.
    said += [(event.details["after_events"] - 0.5, event) for event in of_guardian]
    latest = [
        (place, event.details) for place, event in said if event.kind in kinds and place > opened
    ]
    latest.sort(key=lambda one: one[0])
    return [details for _, details in latest]


def last_word_of_guardian(
    run_events: Sequence[Event], of_guardian: Sequence[Event]
) -> Event | None:
    """Return the last event of the guardian where it came after everything that the run did."""
    acts = [event for event in of_guardian if event.kind != BENCH_READ]
    last = acts[-1] if acts else None
    return last if last and last.details["after_events"] >= len(run_events) else None
