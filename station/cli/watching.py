"""`station status --watch`, `--follow`: how a run stands until it ends; they change nothing."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from station.clock import RealClock, boot_seconds, local_time, utc_now
from station.console import span, tell
from station.control.run_reader import RunReader, sentence_of_now
from station.control.status import is_active, newest_run, read_state, read_status
from station.errors import InputError
from station.record.layout import EVENTS
from station.record.run_names import RUNS
from station.record.run_state import GOES_ON
from station.record.verification import quick_look
from station.runner.progress import REPEAT_S
from station.speech import joined, said, show

LOOKS_EVERY_S = 0.5
"""Real time between two looks at the run folder."""


def pause_between_looks() -> None:
    """Wait until the next look is due."""
    RealClock().sleep(LOOKS_EVERY_S)


def watch_newest(run: Path | None, *, as_json: bool) -> None:
    """Watch a run, without one the newest below `runs`.

    Raises InputError with `as_json`: what is watched is no single document.
    """
    if as_json:
        raise InputError("`--watch` and `--json` do not go together; choose one of them")
    watch_status(newest_run(RUNS) if run is None else run)


def watch_status(folder: Path, wait: Callable[[], None] = pause_between_looks) -> None:
    """Show how a run stands until its process has ended, or Ctrl-C; the run is not touched.

    One screen that is drawn again on a terminal; elsewhere a line with the time of day when state,
    step or unit of work change, and one a minute. Raises InputError for what is no run folder.
    """
    if not (folder / EVENTS).is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    watch = watch_in_lines
    if sys.stdout.isatty():
        from station.view.screen import can_draw

        watch = watch_on_screen if can_draw(sys.stdout) else watch_in_lines
    try:
        watch(folder, wait)
        if (record := quick_look(folder)).unproven:
            show(f"record: {record.sentence()}")
    except KeyboardInterrupt:
        tell("\nstopped watching; the run is not affected")


def watch_on_screen(folder: Path, wait: Callable[[], None]) -> None:
    """Draw the run in place; the last picture stays."""
    from station.view.screen import Screen

    with Screen(folder, to_error=False, stays=True) as screen:
        while screen.look() in GOES_ON:
            wait()


def watch_in_lines(folder: Path, wait: Callable[[], None]) -> None:
    """Print a line when something changed, and at least one a minute."""
    reader = RunReader(folder)
    last: tuple[str, str, int] | None = None
    said_at = boot_seconds()
    while True:
        reader.read()
        state = reader.state()
        present = (state["state"], step_of(state), state["units_done"])
        if present != last or boot_seconds() - said_at >= REPEAT_S:
            left_s = reader.times(state["state"]).left_s
            line = line_of(state, left_s, sentence_of_now(state, reader.live()))
            print(f"{local_time():%H:%M:%S}  {line}", flush=True)
            last, said_at = present, boot_seconds()
        if state["state"] not in GOES_ON:
            return
        wait()


def follow_newest(run: Path | None, *, as_json: bool) -> None:
    """Follow a run, without one the newest below `runs`; raises InputError without `as_json`."""
    if not as_json:
        raise InputError("`--follow` goes with `--json` alone; `--watch` shows a run to a person")
    follow_status(newest_run(RUNS) if run is None else run)


def follow_status(folder: Path, wait: Callable[[], None] = pause_between_looks) -> None:
    """Print a JSON document in a line at each change, until no process is at work on the run.

    After a run that died that is its guardian, which makes the bench safe.
    """
    read_state(folder)  # which says where it is no run folder
    reader = RunReader(folder)
    last: tuple[Any, ...] | None = None
    try:
        while True:
            at_work = is_active(folder)  # first: what ends meanwhile has then logged that
            reader.read()
            state = reader.state()
            prompt = state["prompt"] and state["prompt"]["text"]
            present = (
                state["state"],
                step_of(state),
                state["units_done"],
                state["message"],
                prompt,
                state["safe"],
            )
            if present != last:
                now = utc_now().isoformat(timespec="milliseconds")
                data = {"utc": now, **read_status(folder).to_data(), "prompt": prompt}
                print(json.dumps(data, ensure_ascii=False), flush=True)
                last = present
            if not at_work and state["state"] not in GOES_ON:
                return
            wait()
    except KeyboardInterrupt:
        tell("\nstopped watching; the run is not affected")


def step_of(state: dict[str, Any]) -> str:
    """Return the number of the step that began last."""
    begun = [step["number"] for step in state["steps"] if step["state"] != "waits"]
    return str(begun[-1]) if begun else "no step yet"


def line_of(state: dict[str, Any], left_s: float | None, now: str) -> str:
    """Return how a run stands in one line."""
    of = "" if state["units_planned"] is None else f" of {state['units_planned']}"
    parts = [state["sentence"], step_of(state), f"{state['units_done']}{of} units of work finished"]
    if state["state"] in ("running", "paused") and left_s is not None:
        parts.append(f"bench time left about {span(left_s)}")
    return f"{joined(parts)}: {said(now)}"
