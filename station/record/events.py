"""The logs of a run: one line an event, each with the SHA-256 of the line before.

`events.jsonl` is the run's own; `guardian.jsonl` holds what a guardian did for a run that died.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.console import no_older
from station.errors import DamagedRecord
from station.record.files import AppendOnlyFile
from station.record.layout import GUARDIAN_LOG

FIRST_HASH = "0" * 64
RESUMED = "resumed"
"""The event with which another process goes on with a run."""

REVISED, SIGNED, ISSUED = "revision-written", "signed", "certificate-issued"
RECORDED_LATER = (REVISED, SIGNED, ISSUED)
"""What is done with a folder once its run has ended; the run itself says nothing by them."""

LEFT_FOR_THE_END = "prompt-left"
"""Logs a request that a person is put only once bench and results are done."""


@dataclass(frozen=True)
class Event:
    """One line of the log: run time in s, what happened, and its details."""

    time_s: float
    kind: str
    details: dict[str, Any]


class EventLog:
    """Append events so that each survives the death of the process before the caller goes on.

    A log that is there already is continued; a last line cut short is taken out of it first.
    """

    def __init__(self, path: Path) -> None:
        self._previous = FIRST_HASH
        self.last_s = 0.0
        """Run time of the last event, s."""
        if path.is_file():
            log = path.read_bytes()
            for event, self._previous in checked_lines(path, log):
                self.last_s = event.time_s
            whole = log.rfind(b"\n") + 1
            if whole < len(log):
                os.truncate(path, whole)
        self._file = AppendOnlyFile(path, new=False)

    def append(self, time_s: float, kind: str, details: dict[str, Any], *, durable: bool) -> None:
        """Write one event at run time `time_s`; `durable` waits until the disk has it.

        Raises RecordError; the log then ends with its last whole line.
        """
        line = self._line(time_s, kind, details)
        self._file.append(line + b"\n")
        self._previous = hashlib.sha256(line).hexdigest()
        self.last_s = time_s
        if durable:
            self._file.sync()

    def head_with(self, time_s: float, kind: str, details: Mapping[str, Any]) -> str:
        """Return the SHA-256 of the line that `append` would write: the head of the chain then."""
        return hashlib.sha256(self._line(time_s, kind, details)).hexdigest()

    def _line(self, time_s: float, kind: str, details: Mapping[str, Any]) -> bytes:
        return json.dumps(
            {"t_s": round(time_s, 9), "event": kind, **details, "previous": self._previous},
            ensure_ascii=False,
            allow_nan=False,
        ).encode()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_events(path: Path) -> Iterator[Event]:
    """Yield the events of a log; a last line cut short by a crash is left out.

    Raises DamagedRecord when a line does not follow the one before it. A change of the last line
    is not seen here: nothing follows it that holds its hash. The manifest covers it.
    """
    return (event for event, _ in checked_lines(path, path.read_bytes()))


def checked_lines(path: Path, log: bytes) -> Iterator[tuple[Event, str]]:
    """Yield each event of the log's bytes with its line's SHA-256; errors as `read_events`."""
    previous = FIRST_HASH
    lines = log.split(b"\n")
    # What follows the last line end is empty, or was cut short.
    for number, line in enumerate(lines[:-1], start=1):
        try:
            data = json.loads(line)
            stated_hash, time_s, kind = (
                data.pop("previous"),
                float(data.pop("t_s")),
                data.pop("event"),
            )
        except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
            raise DamagedRecord(
                f"{path}:{number}: the log was altered: this line is no event"
            ) from error
        if stated_hash != previous:
            which = f"line {number - 1} is not" if number > 1 else "the first line is not"
            raise DamagedRecord(
                f"{path}:{number}: the log was altered: {which} the one that was written"
            )
        previous = hashlib.sha256(line).hexdigest()
        yield Event(time_s, kind, data), previous


def of_the_run(events: Sequence[Event]) -> Sequence[Event]:
    """Return a log up to the last event that the run itself wrote."""
    own = (n for n, event in enumerate(events, start=1) if event.kind not in RECORDED_LATER)
    return events[: max(own, default=0)]


def recorded_in_words(event: Event) -> str:
    """Return what an event says that was done with a run folder; of others its kind alone."""
    details = event.details
    at = f" at {details['utc']}" if "utc" in details else ""
    if event.kind == REVISED:
        return f"revision {details.get('revision')} was written{at}"
    if event.kind == SIGNED:
        return f"signed by {details.get('signer')}{at}, key {details.get('key')}"
    if event.kind == ISSUED:
        return f"certificate {details.get('number')} was issued{at}"
    return event.kind


PAUSED, WENT_ON = "paused", "went-on"
ENDS = ("failed", "safe-state", "run-ended")
"""What ends a pause too: the run itself ends."""


def spans(events: Sequence[Event], now_s: float) -> Iterator[tuple[float, float]]:
    """Yield begin and end of each pause, s of run time; one that lasts ends at `now_s`."""
    began_s: float | None = None
    for event in events:
        if event.kind == PAUSED:
            began_s = event.time_s
        elif began_s is not None and event.kind in (WENT_ON, *ENDS):
            yield began_s, event.time_s
            began_s = None
    if began_s is not None:
        yield began_s, max(now_s, began_s)


def is_paused(events: Sequence[Event]) -> bool:
    """Whether the log of a run that goes on ends in a pause."""
    kinds_seen = [event.kind for event in events if event.kind in (PAUSED, WENT_ON, *ENDS)]
    return bool(kinds_seen) and kinds_seen[-1] == PAUSED


def paused_s(events: Sequence[Event], since_s: float, now_s: float) -> float:
    """Return how much of the run time from `since_s` to `now_s` was spent paused, in s."""
    ended = (span for span in spans(events, now_s) if span[1] > since_s)
    return sum(end_s - max(began_s, since_s) for began_s, end_s in ended)


SAFE_STATE = "safe-state"
BENCH_READ = "bench-read"
TIME_MISSED = "time-missed"
"""The run's process, and whoever watches it, did not run for a while."""
AT_REST_AGAIN = "at-rest-again"
"""At the last look an instrument was on again, did not answer, or a witness contradicted it."""
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
        details["outcomes"]
        for details in latest
        if any(outcome.get("used", True) for outcome in details["outcomes"])
    ]
    return list(telling[-1]) if telling else [] if latest else None


def latest_left_out(
    run_events: Sequence[Event], of_guardian: Sequence[Event]
) -> list[dict[str, str]]:
    """Return what can harm and was not read back when a run left its bench: instrument and why."""
    latest = _latest(run_events, of_guardian, SAFE_STATE, BENCH_READ)
    kinds_seen = [details["left_out"] for details in latest if "left_out" in details]
    return list(kinds_seen[-1]) if kinds_seen else []


def latest_age(run_events: Sequence[Event], of_guardian: Sequence[Event]) -> str:
    """Return how old the oldest reading was when a run looked at its bench last, for a person."""
    latest = _latest(run_events, of_guardian, SAFE_STATE, BENCH_READ)
    ages = [float(details["oldest_s"]) for details in latest if "oldest_s" in details]
    return f" ({no_older(ages[-1])})" if ages else ""


def whole_bench(left_out: Iterable[Mapping[str, str]], when: str = "") -> str:
    """Return the sentence on a bench of which everything that was read is at rest.

    What was not read comes first: with it nobody can call the bench safe. `when` it was read
    follows.
    """
    if unknown := not_known(left_out):
        return f"{unknown}; every other instrument that can harm was read back as safe{when}"
    return f"the bench is safe, read back from every instrument that can harm{when}"


def not_known(left_out: Iterable[Mapping[str, str]]) -> str:
    """Return that some instruments are not known to be safe, by name; empty where there is none."""
    by_reason: dict[str, list[str]] = {}
    for left in left_out:
        by_reason.setdefault(left["why"], []).append(left["instrument"])
    named = [f"{', '.join(names)} ({why})" for why, names in by_reason.items()]
    return f"NOT KNOWN to be safe: {' and '.join(named)}" if named else ""


def _latest(
    run_events: Sequence[Event], of_guardian: Sequence[Event], *kinds: str
) -> list[Mapping[str, Any]]:
    """Return what events of some kinds tell since the instruments were opened last."""
    opened = max(
        (n for n, event in enumerate(run_events) if event.kind == "identified"), default=-1
    )
    placed = [(float(n), event) for n, event in enumerate(run_events)]
    # Between the last line that the run had written, and the next one of a resumed run.
    placed += [(event.details["after_events"] - 0.5, event) for event in of_guardian]
    latest = [
        (place, event.details) for place, event in placed if event.kind in kinds and place > opened
    ]
    latest.sort(key=lambda timed: timed[0])
    return [details for _, details in latest]


def last_word_of_guardian(
    run_events: Sequence[Event], of_guardian: Sequence[Event]
) -> Event | None:
    """Return the last event of the guardian where it came after everything that the run did."""
    acts = [event for event in of_guardian if event.kind != BENCH_READ]
    last = acts[-1] if acts else None
    own = len(of_the_run(run_events))
    return last if last and last.details["after_events"] >= own else None
