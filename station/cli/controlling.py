"""`station pause` and `station abort`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from station.clock import RealClock, boot_seconds
from station.console import span, tell
from station.control.client import NoAnswer, ask
from station.errors import EXIT_DONE, EXIT_FAULT, EXIT_WRONG_INPUT
from station.guardian.at_work import AtWork, guardian_at_work
from station.guardian.log import guardian_events, latest_safe_state
from station.locks import is_held
from station.record.creation import EVENTS
from station.record.events import read_events
from station.record.manifest import LOCK
from station.status import RUN_STARTED, Status, read_status, remaining_s

REPEATS_EVERY_S = 10.0
"""Real time between two words of progress."""
LOOKS_EVERY_S = 0.1
GUARDIAN_WITHIN_S = 30.0
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
        """Return what the run does now, and how long the step it is in may still take."""
        self._said_at = boot_seconds()
        status = read_status(self._run)
        if status.step is None:
            return f"    {status.message}"
        left_s = real_rest_of_step_s(self._run, status)
        left = f", expected to take another {span(left_s)} at most" if left_s else ""
        return f"    step {status.step}{left}: {status.message}"


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


def real_rest_of_step_s(run: Path, status: Status) -> float | None:
    """Return the real time in s that the present step is expected to take still.

    None where it is not known, as on virtual time. A unit of work ends with its step, or before.
    """
    events = list(read_events(run / EVENTS))
    planned = next((event.details for event in events if event.kind == RUN_STARTED), {})
    speed, steps = planned.get("speed"), planned.get("steps", [])
    present = [one for one in steps if one["step"] == status.step]
    left_s = remaining_s({"steps": present}, events, status.run_time_s)
    return left_s / speed if speed and present and left_s is not None else None


def abort_run(run: Path, timeout_s: float, *, as_json: bool) -> int:
    """End a run, wait until its bench has been made safe, and return the exit code.

    A process that does not answer is about to be ended by its guardian, or is past its steps: the
    bench is told of in every case.
    """
    guardian = guardian_at_work(run)
    if guardian is not None:
        return end_guardian(run, guardian, timeout_s, as_json=as_json)
    try:
        tell(str(ask(run, "abort").get("said")))
    except NoAnswer as error:
        tell(str(error))
    until_s = boot_seconds() + timeout_s
    while is_held(run / LOCK) and boot_seconds() < until_s:
        RealClock().sleep(LOOKS_EVERY_S)
    # A process that died instead of ending leaves the bench to its guardian.
    until_s = min(until_s, boot_seconds() + GUARDIAN_WITHIN_S)
    while (outcomes := left_safe(run)) is None and boot_seconds() < until_s:
        RealClock().sleep(LOOKS_EVERY_S)
    message = read_status(run).message
    if is_held(run / LOCK):
        message, outcomes = f"not ended within {timeout_s:g} s ({message})", None
    return say_how_it_ended(run, message, outcomes, as_json=as_json)


def end_guardian(run: Path, guardian: AtWork, timeout_s: float, *, as_json: bool) -> int:
    """End a guardian that goes on trying, or wait for one that has just begun.

    Say how the bench is left, and return the exit code.
    """
    tell(guardian.sentence())
    goes_on = bool(guardian.waits_for)
    if goes_on:
        tell("it ends after one more attempt")
        guardian.leave()
    until_s = boot_seconds() + timeout_s
    while boot_seconds() < until_s:
        now = guardian_at_work(run)
        if now is None or bool(now.waits_for) != goes_on:
            break
        RealClock().sleep(LOOKS_EVERY_S)
    return say_how_it_ended(run, read_status(run).message, left_safe(run), as_json=as_json)


def left_safe(run: Path) -> list[dict[str, Any]] | None:
    """Return how each instrument came to rest; None where no log tells it, or not yet."""
    return latest_safe_state(tuple(read_events(run / EVENTS)), guardian_events(run))


def say_how_it_ended(
    run: Path, message: str, outcomes: list[dict[str, Any]] | None, *, as_json: bool
) -> int:
    """Say how the bench was left; return 0 where every instrument was read back as safe, else 3."""
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
        tell("NOT VERIFIED: no word of how the bench was left; look at it now")
    for one in unverified:
        tell(f"NOT VERIFIED: {one['instrument']} could not be proven safe; switch it off by hand")
    return exit_code


def print_json(data: dict[str, Any], exit_code: int) -> None:
    """Print one JSON document."""
    print(json.dumps({**data, "exit_code": exit_code}, indent=1, ensure_ascii=False))
