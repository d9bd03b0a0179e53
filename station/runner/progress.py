"""How far a run is: its picture on a terminal, elsewhere a line a unit of work and a minute."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from station.clock import Clock, boot_seconds, local_time
from station.console import span, tell
from station.record.run_state import FinishedUnit, time_left_s

if TYPE_CHECKING:
    from station.view.screen import Screen

LONGER = "not known, it takes longer than expected"
REPEAT_S = 60.0
"""Real time between two lines of progress of one unit of work where the output is no terminal."""


def time_of_day(moment: datetime) -> str:
    """Return a moment as a line of progress has it."""
    return f"{moment:%H:%M:%S}"


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
    """Write progress to standard error: the picture of the run on a terminal, lines elsewhere.

    `folder` is that of the run, which the picture is read from; without one there are lines.
    """

    def __init__(
        self,
        total_s: float,
        *,
        units: Mapping[str, float] | None = None,
        quiet: bool = False,
        folder: Path | None = None,
    ) -> None:
        self._later_s = total_s
        """What the steps after the present one should take."""
        self._step_s = 0.0
        self._before_s = 0.0
        """What the steps before it took."""
        self._elapsed_s = 0.0
        self._knows_units = bool(units)
        self._units = dict(units or {})
        """The units of work that are still to be done, and how long they should take."""
        self._finished: list[FinishedUnit] = []
        self._quiet = quiet
        self._said_at = 0.0
        self._another_unit = False
        self._screen = None if quiet or folder is None else screen_of(folder)

    def __enter__(self) -> Progress:
        if self._screen is not None:
            self._screen.__enter__().begin()
        return self

    def __exit__(self, *_: object) -> None:
        if self._screen is not None:
            self._screen.__exit__()

    @property
    def units_left(self) -> tuple[str, ...] | None:
        """The units of work that are still to be done, None where data decide which."""
        return tuple(self._units) if self._knows_units else None

    def step(self, number: str, title: str, expected_s: float, when: str = "") -> None:
        """Say that a step begins that is expected to take `expected_s` of bench time.

        `when` it began, where that was not just now.
        """
        self._before_s += self._elapsed_s
        self._elapsed_s = 0.0
        self._step_s = expected_s
        self._later_s -= expected_s
        self.say(f"{number}  {title}", when)
        self.at(0.0, when=when)

    def unit_finished(self, unit: str) -> None:
        """Take note that a unit of work is finished: the pace of the run shows in them."""
        self._another_unit = True
        if unit in self._units:
            at_s = self._before_s + self._elapsed_s
            self._finished.append(FinishedUnit(at_s, self._units.pop(unit)))

    def at(self, elapsed_s: float, detail: str = "", when: str = "") -> None:
        """Say how the run stands after `elapsed_s` of work on its step; `when` as in `step`."""
        self._elapsed_s = elapsed_s
        if self._quiet or self._screen is not None:
            return
        if (self._another_unit and detail) or boot_seconds() - self._said_at >= REPEAT_S:
            self._another_unit = False
            done_s = self._before_s + elapsed_s
            forecast_s = max(self._later_s, 0.0) + max(self._step_s - elapsed_s, 0.0)
            left_s = time_left_s(forecast_s, self._finished, sum(self._units.values()), done_s)
            percent = 100 * done_s / max(done_s + left_s, 1e-9)
            left = span(left_s) if left_s > 0.0 else LONGER
            self.say(f"    {percent:3.0f} %  bench time left {left}  {detail}".rstrip(), when)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Leave the terminal to somebody else for a while."""
        if self._screen is None:
            yield
            return
        with self._screen.paused():
            yield

    def say(self, text: str, when: str = "") -> None:
        """Write a line that stays, with the time of day, or with `when` it happened."""
        if self._quiet:
            return
        self._said_at = boot_seconds()
        line = f"{when or time_of_day(local_time())}  {text}"
        if self._screen is None:
            tell(line)
        else:
            self._screen.say(line)


def screen_of(folder: Path) -> Screen | None:
    """Return the picture of a run on standard error; None where that is no terminal."""
    if not sys.stderr.isatty():
        return None
    from station.view.screen import Screen, can_draw

    return Screen(folder) if can_draw(sys.stderr) else None
