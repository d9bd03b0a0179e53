"""Ask the process that is at work on a run folder, from any other process of the same user."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection, answer_challenge, deliver_challenge
from pathlib import Path
from typing import Any

from station.clock import RealClock, boot_seconds
from station.control.channel import places
from station.control.status import read_status
from station.errors import InputError, StationError
from station.files.locks import is_held
from station.record.layout import EVENTS, LOCK
from station.record.run_state import SENTENCES

LISTENS_WITHIN_S = 2.0
"""A run that has just got its folder needs a moment until it listens."""
LOOKS_EVERY_S = 0.05
ANSWERS_WITHIN_S = 5.0
"""Until it says anything at all; the last word may take a unit of work."""
BENCH_UNKNOWN = "nobody has read its bench back as safe: look at it, switch off by hand what is on"
LISTENS_TO_NOBODY = (
    "a process is at work on it but does not listen here: it is past its last step, or was "
    "started by another user or on another computer; use Ctrl-C in its own terminal"
)


class NotRunning(InputError):
    """A run that no process is at work on."""


class NoAnswer(StationError):
    """A run whose process does not answer: it is stopped, hangs, has died or is past its steps."""


def ask(
    folder: Path,
    request: str,
    timeout_s: float | None = ANSWERS_WITHIN_S,
    *,
    meanwhile: Callable[[dict[str, Any]], None] | None = None,
    waiting: Callable[[], None] | None = None,
    details: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Ask `pause`, `go-on`, `abort`, `status`, `live` or `answer` and return the last answer.

    `details` go with the request: the `id` of a prompt and the `text` of its answer.
    `meanwhile` gets what is said at once where that takes longer than `ANSWERS_WITHIN_S` allows,
    and `waiting` is then called now and again. Without `timeout_s` the last answer may take any
    time. Who leaves without it has taken the request back.

    Raises NotRunning, and NoAnswer where there is a process that does not answer.
    """
    connection, key = connected(folder)
    with connection:
        try:
            prove(folder, connection, key)
            connection.send_bytes(json.dumps({"ask": request, **(details or {})}).encode())
            answer = received(folder, connection, ANSWERS_WITHIN_S)
            if answer.get("final"):
                return answer
            if meanwhile is not None:
                meanwhile(answer)
            return received(folder, connection, timeout_s, waiting)
        except AuthenticationError as error:
            raise StationError(f"{folder}: the run's process refuses the key: {error}") from error
        except (EOFError, OSError) as error:
            raise NoAnswer(
                f"{folder}: the run's process ended before it answered; `station status {folder}` "
                "shows its state"
            ) from error


def go_on(folder: Path) -> bool:
    """Let a paused run go on; False where there is none: not running, or not paused."""
    try:
        return ask(folder, "go-on").get("outcome") == "goes-on"
    except NotRunning:
        return False


def connected(folder: Path) -> tuple[Connection, bytes]:
    """Return a connection to the run's process, not proven yet, and the key to prove it with."""
    if not (folder / EVENTS).is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    until_s = boot_seconds() + LISTENS_WITHIN_S
    while True:
        # A folder is there a moment before the run that has it locks it and writes its first event.
        begins = not (folder / EVENTS).stat().st_size and boot_seconds() < until_s
        if not begins and not is_held(folder / LOCK):
            raise NotRunning(not_running(folder))
        for place in places(folder):
            key = place.key()
            if key is None:
                continue
            try:
                return Client(place.address, place.family), key
            except OSError:  # left by a dead process, or about to be replaced
                continue
        if boot_seconds() > until_s:
            raise NoAnswer(f"{folder}: {LISTENS_TO_NOBODY}")
        RealClock().sleep(LOOKS_EVERY_S)


def not_running(folder: Path) -> str:
    """Say how a run stands that no process is at work on, and what to do."""
    status = read_status(folder)
    state = status.state
    if state == "finished":
        return f"{folder}: the run is not running: it is finished"
    state_text = SENTENCES[state].partition(":")[0]
    bench = "" if status.bench_safe else f"; {BENCH_UNKNOWN}"
    again = f"`station resume {folder}` resumes it"
    return f"{folder}: the run is not running ({state_text}){bench}; {again}"


def prove(folder: Path, connection: Connection, key: bytes) -> None:
    """Show the key, and ask the other side to show that it has it too."""
    if not connection.poll(ANSWERS_WITHIN_S):
        raise NoAnswer(silent(folder))
    answer_challenge(connection, key)
    deliver_challenge(connection, key)


def received(
    folder: Path,
    connection: Connection,
    timeout_s: float | None,
    waiting: Callable[[], None] | None = None,
) -> dict[str, Any]:
    """Return the next message; raises StationError when none comes in time."""
    until_s = None if timeout_s is None else boot_seconds() + timeout_s
    while not connection.poll(LOOKS_EVERY_S):
        if until_s is not None and boot_seconds() > until_s:
            raise NoAnswer(silent(folder))
        if waiting is not None:
            waiting()
    answer: dict[str, Any] = json.loads(connection.recv_bytes())
    return answer


def silent(folder: Path) -> str:
    """Say that the run's process does not answer, and what to do."""
    return (
        f"{folder}: the run's process does not answer: it is stopped, or hangs; "
        "go to the bench and look at it"
    )
