"""`station pause`, `abort`, `acknowledge`: act on a run in another process, and on its bench."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, TypeVar, cast

from station.clock import RealClock, boot_seconds
from station.console import span, tell
from station.control.channel import NoAnswer, ask
from station.control.requests import ABORT_VERB
from station.control.status import message_of, read_state, read_status
from station.errors import (
    EXIT_ABORTED,
    EXIT_DONE,
    EXIT_FAULT,
    EXIT_WRONG_INPUT,
    Aborted,
    InputError,
    StationError,
)
from station.files.locks import is_held
from station.files.lookup import BENCHES, find
from station.guardian.notes import AtWork, guardian_at_work
from station.record.events import whole_bench
from station.record.layout import LOCK
from station.record.run_state import RunState
from station.safety.acknowledgement import acknowledge, addresses_in, user_name
from station.speech import said, show

REPEATS_EVERY_S = 10.0
"""Real time between two words of progress."""
LOOKS_EVERY_S = 0.25
GUARDIAN_WITHIN_S = 30.0
DISK_WITHIN_S = 15.0
"""Real time for what reads a run folder and asks its process, which has 5 s twice."""
LINGERS_S = 10.0
LINGERS = (
    "its process made the bench safe but does not end: its disk or a library holds it up; end it "
    "by hand when the disk answers again"
)
Result = TypeVar("Result")
EXITS = {
    "paused": EXIT_DONE,
    "refused": EXIT_FAULT,
    "ended": EXIT_WRONG_INPUT,
    "withdrawn": EXIT_ABORTED,
}


class Waiting:
    """Say now and again what a run does that has not answered yet."""

    def __init__(self, run: Path) -> None:
        self._run = run
        self._said_at = boot_seconds()

    def begin(self, told: Mapping[str, Any]) -> None:
        """Say what the run will do, and how long that takes."""
        tell(f"{told['said']}; Ctrl-C here withdraws the request")
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
        run = read_state(self._run)
        left_s = run.rest_of_step_s(run.began_s + status.run_time_s)
        left = f", expected to take another {span(left_s)} of bench time" if left_s else ""
        return f"    step {status.step}{left}: {status.message}"


def pause_run(run: Path, *, as_json: bool) -> int:
    """Ask a run to pause, wait until it does or refuses, and return the exit code."""
    waiting = Waiting(run)
    try:
        answer = ask(run, "pause", None, meanwhile=waiting.begin, waiting=waiting.go_on)
    except KeyboardInterrupt:
        raise Aborted("the request to pause is withdrawn; the run goes on") from None
    outcome = str(answer.get("outcome"))
    devices: dict[str, str] = answer.get("devices") or {}
    exit_code = EXITS.get(outcome, EXIT_FAULT)
    if as_json:
        print_json({"run": str(run), "outcome": outcome, "devices": devices}, exit_code)
        return exit_code
    for name, word in devices.items():
        print(f"{name:<20}{said(word)}")
    match outcome:
        case "paused":
            show(f"paused; `station resume {run}` goes on, `station abort {run}` ends the run")
        case "refused":
            tell("the pause is refused, the run goes on")
        case _:
            tell(f"not paused: {answer.get('said', outcome)}")
    return exit_code


def abort_run(run: Path, timeout_s: float, *, as_json: bool, by: str = ABORT_VERB) -> int:
    """End a run, wait until its bench has been made safe, and return the exit code.

    `by` is what the person did, for the run's log. A process that does not answer is about to be
    ended by its guardian, or is past its steps: the bench is reported in every case.
    """
    guardian = guardian_at_work(run)
    if guardian is not None:
        return end_guardian(run, guardian, timeout_s, as_json=as_json)
    try:
        details = {"by": f"{by} (user {user_name()})" if user_name() else by}
        answer = within(DISK_WITHIN_S, lambda: ask(run, "abort", details=details))
        tell(str(answer.get("said")))
    except NoAnswer as error:
        tell(str(error))
    message, outcomes, ended = wait_for_end(run, timeout_s)
    return say_how_it_ended(run, message, outcomes, as_json=as_json, ended=ended)


End = tuple[str, list[dict[str, Any]] | None, bool]
"""What is said of a run, how its bench was left (None: nobody knows), and whether it has ended."""


def wait_for_end(run: Path, timeout_s: float) -> End:
    """Wait until a run has ended and its bench was made safe, or for `timeout_s` of real time.

    A disk that answers nothing may be why it does not end: what the run itself read back counts.
    """
    until_s = boot_seconds() + timeout_s
    gone_s = safe_s = None
    outcomes: list[dict[str, Any]] | None = None
    while (now_s := boot_seconds()) < until_s:
        end = look_at_end(run)
        if end is not None and end[1] is not None:
            return end
        if end is not None:  # died instead of ending: its guardian is at the bench
            gone_s = gone_s or now_s
            until_s = min(until_s, gone_s + GUARDIAN_WITHIN_S)
        else:
            outcomes = read_back_by(run) or outcomes
            safe_s = safe_s or (None if outcomes is None else now_s)
            if safe_s is not None and now_s - safe_s > LINGERS_S:
                return LINGERS, outcomes, False
        RealClock().sleep(LOOKS_EVERY_S)
    return look_at_end(run) or (f"not ended within {timeout_s:g} s", None, False)


def look_at_end(run: Path) -> End | None:
    """Return how a run has ended; None while its process lives, or where its disk is silent."""

    def look() -> End | None:
        if is_held(run / LOCK):
            return None
        return (*how_left(run), True)

    try:
        return within(DISK_WITHIN_S, look)
    except NoAnswer:
        return None


def read_back_by(run: Path) -> list[dict[str, Any]] | None:
    """Return how the bench was left, as the run's process says it; None where it says nothing."""
    try:
        word = within(DISK_WITHIN_S, lambda: ask(run, "status"))
    except StationError:  # it has just ended, or does not answer
        return None
    outcomes: list[dict[str, Any]] | None = word.get("safe_state")
    return outcomes


def within(seconds: float, body: Callable[[], Result]) -> Result:
    """Return what `body` does, or raise what it raises; it may have to wait for a disk for ever.

    Raises NoAnswer after `seconds` of real time, and leaves it alone.
    """
    answers: SimpleQueue[tuple[Result | None, BaseException | None]] = SimpleQueue()

    def work() -> None:
        try:
            answers.put((body(), None))
        except BaseException as error:  # raised where somebody waits for it
            answers.put((None, error))

    Thread(target=work, name="disk", daemon=True).start()
    try:
        result, error = answers.get(timeout=seconds)
    except Empty:
        raise NoAnswer(f"the disk of the run folder did not answer within {seconds:g} s") from None
    if error is not None:
        raise error
    return cast(Result, result)


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
        if now is None or (now.waits_for and not goes_on):
            break
        RealClock().sleep(LOOKS_EVERY_S)
    return say_how_it_ended(run, *how_left(run), as_json=as_json)


def how_left(run: Path) -> tuple[str, list[dict[str, Any]] | None]:
    """Return what is said of a run last, and how each instrument came to rest."""
    state = read_state(run)
    return message_of(state, guardian_at_work(run)), state.safe_state()


def say_how_it_ended(
    run: Path,
    message: str,
    outcomes: list[dict[str, Any]] | None,
    *,
    as_json: bool,
    ended: bool = True,
) -> int:
    """Say how the bench was left; return 0 where every instrument was read back as safe, else 3."""
    unverified = [outcome for outcome in outcomes or () if not outcome["verified"]]
    safe = outcomes is not None and not unverified
    exit_code = EXIT_DONE if safe and ended else EXIT_FAULT
    # One that has not ended may have no log that can be read; it reports what it used alone.
    state = read_state(run) if ended else RunState()
    left_out = state.left_out()
    if as_json:
        data = {"run": str(run), "message": message, "bench_safe": safe}
        read_back = {"safe_state": outcomes or [], "left_out": left_out}
        print_json({**data, **read_back}, exit_code)
        return exit_code
    show(f"the run: {message}")
    for outcome in outcomes or ():
        name = outcome["instrument"]
        print(f"{name:<20}{said(outcome['read_back'].removeprefix(name + ': '))}")
    if safe:
        used = "every instrument that the run used was read back as safe, others were not read yet"
        show(whole_bench(left_out, state.age()) if ended else used)
    elif outcomes is None:
        tell(
            "NOT VERIFIED: how the bench was left is unknown; go to it now, and switch off by hand "
            "what is on"
        )
    for outcome in unverified:
        tell(
            f"NOT VERIFIED: {outcome['instrument']} could not be proven safe; switch it off by hand"
            + ("; then `station acknowledge` the bench" if outcome.get("doubted") else "")
        )
    return exit_code


def print_json(data: dict[str, Any], exit_code: int) -> None:
    """Print one JSON document."""
    print(json.dumps({**data, "exit_code": exit_code}, indent=1, ensure_ascii=False))


def acknowledge_bench(name: str, *, as_json: bool) -> None:
    """Take back the refusal of a bench whose interlock tripped, and say what it was.

    Only the file's place and the addresses in it count, so that a bench file with a fault can be
    acknowledged too.
    """
    bench = find(BENCHES, name)
    try:
        trip = acknowledge(bench, addresses_in(bench))
    except OSError as error:
        raise InputError(
            f"the acknowledgement cannot be written: {error}; make that folder writable for "
            "everybody who uses the bench"
        ) from error
    if as_json:
        trip_data = asdict(trip) if trip else None
        print(
            json.dumps(
                {"bench": str(bench), "acknowledged": trip_data}, indent=1, ensure_ascii=False
            )
        )
    elif trip is None:
        show(f"{name}: no interlock waits to be acknowledged")
    else:
        show(f"{name}: acknowledged: {trip.message} ({trip.tripped_utc}, {trip.run})")
