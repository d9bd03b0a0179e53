"""The logs of a run: one line an event, each with the SHA-256 of the line before.

`events.jsonl` is the run's own; `guardian.jsonl` holds what a guardian did for a run that died.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.errors import DamagedRecord
from station.record.files import AppendOnlyFile
from station.record.layout import EVENTS, GUARDIAN_LOG

FIRST_HASH = "0" * 64
RUN_STARTED = "run-started"
"""The first event: what the run is going to do."""
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


def head_of_run(folder: Path) -> str:
    """Return the head of a run's log that its documents state: the SHA-256 of its last own line.

    What was done with the folder afterwards, such as an evaluation, is in none: a document comes
    out the same whenever it is made.
    """
    lines = (folder / EVENTS).read_bytes().split(b"\n")[:-1]
    while lines and json.loads(lines[-1])["event"] in RECORDED_LATER:
        lines.pop()
    return hashlib.sha256(lines[-1]).hexdigest() if lines else ""


def read_events(path: Path) -> Iterator[Event]:
    """Yield the events of a log; a last line cut short by a crash is left out.

    Raises DamagedRecord when a line does not follow the one before it. A change of the last line
    is not seen here: nothing follows it that holds its hash. The manifest covers it.
    """
    return (event for event, _ in checked_lines(path, path.read_bytes()))


def checked_lines(path: Path, log: bytes) -> Iterator[tuple[Event, str]]:
    """Yield each event of the log's bytes with its line's SHA-256; errors as `read_events`."""
    chain = LogChain(path)
    # What follows the last line end is empty, or was cut short.
    for line in log.split(b"\n")[:-1]:
        yield chain.next_event(line), chain.head


class BrokenChain(DamagedRecord):
    """A line that does not follow the one before: that one is not as it was written."""


class LogChain:
    """The lines of a log, read in order, each held against the one before."""

    def __init__(self, path: Path) -> None:
        self.head = FIRST_HASH
        """The SHA-256 of the line read last."""
        self._path = path
        self._lines = 0

    def next_event(self, line: bytes) -> Event:
        """Return the event of the next line, without its end; raises DamagedRecord."""
        at = f"{self._path}:{self._lines + 1}"
        try:
            data = json.loads(line)
            previous, time_s, kind = data.pop("previous"), float(data.pop("t_s")), data.pop("event")
        except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
            raise DamagedRecord(f"{at}: the log was altered: this line is no event") from error
        if previous != self.head:
            which = f"line {self._lines}" if self._lines else "the first line"
            raise BrokenChain(f"{at}: the log was altered: {which} is not the one that was written")
        self.head = hashlib.sha256(line).hexdigest()
        self._lines += 1
        return Event(time_s, kind, data)


def of_the_run(events: Sequence[Event]) -> Sequence[Event]:
    """Return a log up to the last event that the run itself wrote."""
    own = (n for n, event in enumerate(events, start=1) if event.kind not in RECORDED_LATER)
    return events[: max(own, default=0)]


SAID: dict[str, str] = {
    "run-started": "the run of {procedure} began",
    "resumed": "the run goes on in another process",
    "identified": "{instrument} is {maker} {model} {serial}",
    "bench-read": "the bench was read before anything is switched on",
    "witness-read": "{instrument} has read what is there before anything is switched on",
    "step-started": "{step} began: {title}",
    "step-finished": "{step} is done",
    "prompt-shown": "waits for an answer to [{id}] {text}",
    "prompt": "{text} Answered: {answer}",
    "prompt-left": "asked once the bench is at rest: {text}",
    "unit-started": "{unit} is being recorded",
    "unit-finished": "{unit} is recorded",
    "field-on": "what the device is tested with is on",
    "field-off": "what the device is tested with is off",
    "published-value": "{name} by the published formula: {value} {unit}",
    "residual-by-modulation": "residual field by modulation, round {round}: {field_nT} nT",
    "residual-field": "residual field, round {round}: {field_nT} nT",
    "depolarised": "precession after the gradient, attempt {attempt}: {frequency_Hz} Hz",
    "shot-stays-bad": "{unit} stays bad: {reason}",
    "pose-refused": "{unit}, attempt {attempt}: {why}",
    "overload": "{unit} is beyond the range of {range_V} V and is measured again",
    "contact-test-started": "the contact {contact} is tested: somebody opens it now",
    "contact-test-finished": "the contact {contact} opened and closed as it should",
    "pause-requested": "a pause is asked for",
    "went-on": "the run goes on after its pause",
    "terminal-closed": "the terminal was closed; the run goes on without it",
    "system-clock-jumped": "the computer's time of day jumped by {by_s} s",
    "notes-dropped": "{count} notes of drivers were left out",
    "guardian-replaced": "a guardian was lost and another one has taken its place",
}
"""What an event says to a person; one with a `message` says that."""


class _Given(dict[str, Any]):
    """The details of an event as a sentence takes them; what is not there reads "unknown"."""

    def __init__(self, details: Mapping[str, Any]) -> None:
        super().__init__({name: _plain(value) for name, value in details.items()})

    def __missing__(self, key: str) -> str:
        return "unknown"


def _plain(value: Any) -> str:
    """Return a value as people read it."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_plain(of)}" for name, of in value.items())
    if value is None:
        return "unknown"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def is_of_line(event: Event) -> bool:
    """Return whether an event is what a driver notes of its line: it tells a person nothing."""
    return "noted_s" in event.details


def in_words(event: Event) -> str:
    """Return an event as a short text."""
    details = event.details
    match event.kind:
        case "run-ended":
            return "all steps are done" if details.get("complete") else "the run has ended early"
        case "safe-state":
            left = [
                outcome["instrument"]
                for outcome in details.get("outcomes", ())
                if not outcome["verified"]
            ]
            return f"NOT VERIFIED as safe: {', '.join(left)}" if left else "the bench is made safe"
        case kind if kind in RECORDED_LATER:
            return recorded_in_words(event)
        case "paused" | "pause-refused":
            states = details.get("devices") or details.get("reasons") or {}
            return ": ".join(
                [event.kind, "; ".join(f"{who} {what}" for who, what in states.items())]
            )
        case "published-value":  # of a result, of an axis, or of both
            named = " ".join(str(details[key]) for key in ("name", "axis") if key in details)
            return SAID[event.kind].format_map(_Given({**details, "name": named}))
        case kind if kind in SAID:
            return " ".join(SAID[kind].format_map(_Given(details)).split())
    if "message" in details:
        return str(details["message"])
    plain = (f"{key} {value}" for key, value in details.items() if not isinstance(value, list))
    return f"{event.kind}: {', '.join(plain)}" if details else event.kind


def recorded_in_words(event: Event) -> str:
    """Return what an event says that was done with a run folder; of others its kind alone."""
    details = event.details
    at = f" at {details['utc']}" if "utc" in details else ""
    if event.kind == REVISED:
        return f"revision {details.get('revision')} was written{at}"
    if event.kind == SIGNED:
        return f"signed by {details.get('signer')}{at}, key {details.get('key')}"
    if event.kind == ISSUED:
        replaced = details.get("replaces")
        instead = f" and replaces {replaced}: {details.get('reason')}" if replaced else ""
        return f"certificate {details.get('number')} was issued{at}{instead}"
    return event.kind


SAFE_STATE = "safe-state"
BENCH_READ = "bench-read"
WITNESS_READ = "witness-read"
"""What a second instrument saw before anything was energised."""
STANDARD_ALARM = "check-standard-alarm"
"""An alarm of a check standard of the bench stood when the run began."""
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


def whole_bench(left_out: Iterable[Mapping[str, str]], when: str = "") -> str:
    """Return the sentence on a bench of which everything that was read is at rest.

    What was not read comes first: with it nobody can call the bench safe. `when` it was read
    follows.
    """
    if unknown := not_known(left_out):
        return f"{unknown}; every other instrument that can harm was read back as safe{when}"
    return f"the bench is safe, read back from every instrument that can harm{when}"


def rest_in_words(
    safe: Iterable[Mapping[str, Any]], left_out: Iterable[Mapping[str, str]]
) -> tuple[bool, str]:
    """Return whether every outcome of a safe state was read back, and the sentence on the bench."""
    wrong = [str(outcome["instrument"]) for outcome in safe if not outcome["verified"]]
    if wrong:
        return False, f"NOT VERIFIED as safe: {', '.join(wrong)}"
    return True, whole_bench(left_out)


def not_known(left_out: Iterable[Mapping[str, str]]) -> str:
    """Return that some instruments are not known to be safe, by name; empty where there is none."""
    by_reason: dict[str, list[str]] = {}
    for left in left_out:
        by_reason.setdefault(left["why"], []).append(left["instrument"])
    named = [f"{', '.join(names)} ({why})" for why, names in by_reason.items()]
    return f"NOT KNOWN to be safe: {' and '.join(named)}" if named else ""


class LogTail:
    """Read what was added to a run's log since the last look; whole lines alone."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / EVENTS
        self._chain = LogChain(self._path)
        self._at = 0

    def new_events(self) -> Iterator[Event]:
        """Yield the events since the last call.

        Raises OSError where the log is gone, and DamagedRecord, at each call, behind the last line
        that is as it was written.
        """
        with self._path.open("rb") as file:
            file.seek(self._at)
            added = file.read()
        chain, damage = copy(self._chain), None
        events = list[tuple[Event, LogChain, int]]()
        try:
            for line in added.split(b"\n")[:-1]:
                events.append((chain.next_event(line), copy(chain), len(line) + 1))
        except DamagedRecord as error:
            damage = error
            if isinstance(error, BrokenChain):
                del events[-1:]
        for event, self._chain, size in events:
            self._at += size
            yield event
        if damage is not None:
            raise damage
