"""`station status --watch`: how a run stands, shown again until it ends; it changes nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from station.cli.looking import rows
from station.clock import RealClock, boot_seconds
from station.console import span, tell
from station.control.status import SENTENCES, Status, newest_run, read_status
from station.errors import InputError
from station.record.run_names import RUNS
from station.runner.progress import REPEAT_S, local_time

if TYPE_CHECKING:
    from rich.table import Table

LOOKS_EVERY_S = 1.0
"""Real time between two looks at the run folder; each reads the whole log."""
GOES_ON = ("running", "paused", "evaluating")
COLOURS = {
    "running": "green",
    "paused": "yellow",
    "evaluating": "green",
    "finished": "bold",
    "failed": "red",
    "interrupted": "red",
}
"""They stand beside the word that says the same."""


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
    step or unit of work change, and one a minute. Raises InputError and RecordError as
    `read_status`.
    """
    show = watch_on_screen if sys.stdout.isatty() else watch_in_lines
    try:
        show(folder, wait)
    except KeyboardInterrupt:
        tell("\nnobody watches here any more; the run is not touched")


def watch_on_screen(folder: Path, wait: Callable[[], None]) -> None:
    """Draw the status in place, cut to the height of the terminal; the last one stays."""
    from rich.live import Live

    status = read_status(folder)
    with Live(table_of(status), auto_refresh=False) as screen:
        while status.state in GOES_ON:
            wait()
            status = read_status(folder)
            screen.update(table_of(status), refresh=True)


def table_of(status: Status) -> Table:
    """Return the rows of a status, with the time of day at which they were read."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, text in rows(status):
        table.add_row(name, Text(text, COLOURS[status.state] if name == "state" else ""))
    table.add_row("read at", f"{local_time():%H:%M:%S}")
    return table


def watch_in_lines(folder: Path, wait: Callable[[], None]) -> None:
    """Print a line when something changed, and at least one a minute."""
    last: tuple[str, str | None, int] | None = None
    said_at = boot_seconds()
    while True:
        status = read_status(folder)
        present = (status.state, status.step, len(status.units_finished))
        if present != last or boot_seconds() - said_at >= REPEAT_S:
            print(f"{local_time():%H:%M:%S}  {line_of(status)}", flush=True)
            last, said_at = present, boot_seconds()
        if status.state not in GOES_ON:
            return
        wait()


def line_of(status: Status) -> str:
    """Return how a run stands in one line."""
    of = "" if status.units_planned is None else f" of {status.units_planned}"
    parts = [SENTENCES[status.state], status.step or "no step yet"]
    parts.append(f"{len(status.units_finished)}{of} units of work finished")
    if status.state in ("running", "paused") and status.remaining_s is not None:
        parts.append(f"bench time left about {span(status.remaining_s)}")
    return f"{', '.join(parts)}: {status.message}"
