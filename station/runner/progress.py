"""How far a run is: a live bar on a terminal, elsewhere a line a unit of work and a minute."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime

from station.clock import Clock, boot_seconds
from station.clock.real import utc_now
from station.console import span, tell
from station.control.status import FinishedUnit, time_left_s

LONGER = "not known, it takes longer than expected"
LONGER_ON_A_BAR = "not known"
BAR_WIDTH = 16
LEFT_WIDTH = len("100 %  bench time left 26 h 15 min")
"""On a narrow terminal what the step does is shortened, never the time left."""
REPEAT_S = 60.0
"""Real time between two lines of progress of one unit of work where the output is no terminal."""


def local_time() -> datetime:
    """Return the time of day where the bench stands."""
    return utc_now().astimezone()


def how_long(expected_s: float, clock: Clock) -> str:
    """Return how long a run is expected to take, in bench time and as the operator waits."""
    speed: float | None = getattr(clock, "speed", None)
    if speed is None:
        return f"bench time about {span(expected_s)} (virtual: waiting is skipped)"
    if speed == 1.0:
        return f"about {span(expected_s)}"
    waited = span(expected_s / speed)
    return f"bench time about {span(expected_s)}, {speed:g} times as fast: about {waited}"


class Progress:
    """Write progress to standard error; a live bar on a terminal, a line now and then elsewhere."""

    def __init__(
        self, total_s: float, *, units: Mapping[str, float] | None = None, quiet: bool = False
    ) -> None:
        self._later_s = total_s
        """What the steps after the present one should take."""
        self._step_s = 0.0
        self._before_s = 0.0
        """What the steps before it took."""
        self._elapsed_s = 0.0
        self._units = dict(units or {})
        """The units of work that are still to be done, and how long they should take."""
        self._finished: list[FinishedUnit] = []
        self._number = self._title = ""
        self._quiet = quiet
        self._said_at = 0.0
        self._another_unit = False
        self._bar = None
        self._task = None
        if sys.stderr.isatty() and not quiet:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn
            from rich.table import Column

            self._bar = Progress(
                BarColumn(bar_width=BAR_WIDTH),
                TextColumn(
                    "{task.percentage:>3.0f} %  bench time left {task.fields[left]}",
                    table_column=Column(no_wrap=True, min_width=LEFT_WIDTH),
                ),
                TextColumn(
                    "{task.description}", table_column=Column(no_wrap=True, overflow="ellipsis")
                ),
                console=Console(stderr=True),
                transient=True,
            )
            self._task = self._bar.add_task("", total=max(total_s, 1e-9), left=span(total_s))

    def __enter__(self) -> Progress:
        if self._bar is not None:
            with suppress(OSError):  # a terminal that is gone ends no run
                self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            with suppress(OSError):
                self._bar.stop()

    def step(self, number: str, title: str, expected_s: float) -> None:
        """Say that a step begins that is expected to take `expected_s` of bench time."""
        self._before_s += self._elapsed_s
        self._elapsed_s = 0.0
        self._step_s = expected_s
        self._later_s -= expected_s
        self._number, self._title = number, f"{number}  {title}"
        self.say(self._title)
        self.at(0.0)

    def unit_finished(self, unit: str) -> None:
        """Take note that a unit of work is finished: the pace of the run shows in them."""
        self._another_unit = True
        if unit in self._units:
            at_s = self._before_s + self._elapsed_s
            self._finished.append(FinishedUnit(at_s, self._units.pop(unit)))

    def at(self, elapsed_s: float, detail: str = "") -> None:
        """Say how the run stands after `elapsed_s` of work on its step."""
        self._elapsed_s = elapsed_s
        if self._quiet:
            return
        done_s = self._before_s + elapsed_s
        forecast_s = max(self._later_s, 0.0) + max(self._step_s - elapsed_s, 0.0)
        left_s = time_left_s(forecast_s, self._finished, sum(self._units.values()), done_s)
        total_s = max(done_s + left_s, 1e-9)
        left = span(left_s) if left_s > 0.0 else LONGER
        if self._bar is not None and self._task is not None:
            room = self._bar.console.width - BAR_WIDTH - LEFT_WIDTH - 2  # a blank between columns
            text = doing(self._number, self._title, detail, room)
            left = left if left_s > 0.0 else LONGER_ON_A_BAR
            with suppress(OSError):
                self._bar.update(
                    self._task, completed=done_s, total=total_s, description=text, left=left
                )
        elif (self._another_unit and detail) or boot_seconds() - self._said_at >= REPEAT_S:
            self._another_unit = False
            percent = 100 * done_s / total_s
            self.say(f"    {percent:3.0f} %  bench time left {left}  {detail}".rstrip())

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Leave the terminal to somebody else for a while."""
        if self._bar is not None:
            self._bar.stop()
        yield
        if self._bar is not None:
            self._bar.start()

    def say(self, text: str) -> None:
        """Write a line that stays."""
        if self._quiet:
            return
        self._said_at = boot_seconds()
        if self._bar is None:
            tell(f"{local_time():%H:%M:%S}  {text}")
            return
        with suppress(OSError):  # a terminal that is gone ends no run
            self._bar.console.print(text, highlight=False)


def doing(number: str, title: str, detail: str, room: int) -> str:
    """Return what a step does in a line of `room` characters, in whole words.

    The title, which stands in a line of its own above, gives way to what goes on just now.
    """
    text = f"{title}  {detail}".rstrip()
    if len(text) > room and detail:
        text = f"{number}  {detail}"
    if len(text) <= room:
        return text
    kept = text[: max(room - 1, 0)]
    if not text[len(kept)].isspace():
        kept = kept.rpartition(" ")[0].rstrip() or kept
    return kept.rstrip(" ,;:") + "…"
