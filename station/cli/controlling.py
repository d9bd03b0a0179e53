"""`station pause` and `station abort`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from station.clock import RealClock, boot_seconds
from station.console import tell
from station.control.client import ask
from station.errors import EXIT_DONE, EXIT_FAULT, EXIT_WRONG_INPUT
from station.locks import is_held
from station.record.events import Event, read_events
from station.record.folder import EVENTS
from station.record.manifest import LOCK
from station.runner.progress import span
from station.status import read_status

REPEATS_EVERY_S = 10.0
"""Real time between two words of progress."""
LOOKS_EVERY_S = 0.1
EXITS = {"paused": EXIT_DONE, "refused": EXIT_FAULT, "ended": EXIT_WRONG_INPUT}


class Waiting:
    """Say now and again what a run does that has not answered yet."""

    def __init__(self, run: Path) -> None:
        self._run = run
        self._said_at = boot_seconds()

    def begin(self, told: Mapping[str, Any]) -> None:
        """Say what the run will do, and how long that takes."""
        tell(f"{told['said']}; Ctrl-C here takes that back")
        tell(self.sentence())

    def go_on(self) -> None:
        """Say how the run stands where that was said long ago."""
        if boot_seconds() - self._said_at >= REPEATS_EVERY_S:
            tell(self.sentence())

    def sentence(self) -> str:
        """Return what the run does now and how long it is expected to take."""
        self._said_at = boot_seconds()
        status = read_status(self._run)
        step = f"step {status.step}" if status.step else "opening the bench"
        if status.step_remaining_s is None:
            return f"    {step}: {status.message}"
        return f"    {step}, at most about {span(status.step_remaining_s)}: {status.message}"


def pause_run(run: Path, *, as_json: bool) -> int:
    """Ask a run to pause, wait until it does or refuses, and return the exit code."""
    waiting = Waiting(run)
    answer = ask(run, "pause", None, meanwhile=waiting.begin, waiting=waiting.go_on)
    outcome = str(answer.get("outcome"))
    devices: dict[str, str] = answer.get("devices") or {}
    exit_code = EXITS.get(outcome, EXIT_FAULT)
    if as_json:
        print_json({"run": str(run), "outcome": outcome, "devices": devices}, exit_code)
        return exit_code
    for name, word in devices.items():
        print(f"{name:<20}{word}")
    match outcome:
        case "paused":
            print(f"paused; `station resume {run}` goes on, `station abort {run}` ends the run")
        case "refused":
            tell("the pause is refused, the run goes on")
        case _:
            tell(f"not paused: {answer.get('said', outcome)}")
    return exit_code


def abort_run(run: Path, timeout_s: float, *, as_json: bool) -> int:
    """End a run, wait until its bench has been made safe, and return the exit code."""
    log = run / EVENTS
    before = len(list(read_events(log))) if log.is_file() else 0
    tell(str(ask(run, "abort").get("said")))
    until_s = boot_seconds() + timeout_s
    while is_held(run / LOCK):
        if boot_seconds() > until_s:
            return say_how_it_ended(run, [], f"not ended within {timeout_s:g} s", as_json=as_json)
        RealClock().sleep(LOOKS_EVERY_S)
    events = list(read_events(log))[before:]
    return say_how_it_ended(run, events, read_status(run).message, as_json=as_json)


def say_how_it_ended(run: Path, events: list[Event], message: str, *, as_json: bool) -> int:
    """Say how the bench was left, from the log; return 0 where that was verified, else 3."""
    outcomes = safe_outcomes(run, events)
    unverified = [one for one in outcomes or () if not one["verified"]]
    safe = outcomes is not None and not unverified
    exit_code = EXIT_DONE if safe else EXIT_FAULT
    if as_json:
        data = {"run": str(run), "message": message, "bench_safe": safe}
        print_json({**data, "safe_state": outcomes or []}, exit_code)
        return exit_code
    print(f"the run: {message}")
    for one in outcomes or ():
        print(f"{one['instrument']:<20}{one['read_back']}")
    if safe:
        print("the bench is safe, read back from every instrument that can harm")
    elif outcomes is None:
        tell("NOT VERIFIED: the run left no word of how its bench was left; look at it now")
    for one in unverified:
        tell(
            f"NOT VERIFIED: {one['instrument']} could not be proven safe; switch it off by hand"
        )
    return exit_code


def safe_outcomes(run: Path, events: list[Event]) -> list[dict[str, Any]] | None:
    """Return how each instrument came to rest, as the last word after the wish says it.

    None where there is no word: the run's process died, or has not come so far.
    """
    said = [event for event in events if event.kind == "safe-state"]
    return list(said[-1].details["outcomes"]) if said else None


def print_json(data: dict[str, Any], exit_code: int) -> None:
    """Print one JSON document."""
    print(json.dumps({**data, "exit_code": exit_code}, indent=1, ensure_ascii=False))
