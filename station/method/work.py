"""What a procedure declares of its work: commands, rows and time, by step and unit of work.

Forecast, dry run, static limits, durations, resuming and panel all read this declaration; the steps
apply the commands that stand in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

from station import registry
from station.method.set_points import Command, SetPoint
from station.units import UnitError, parse_as

if TYPE_CHECKING:
    from station.instruments.bench import Bench

POLL_S = 1.037
"""Run time between two looks at a source. It is no multiple of any reading period, so that over a
minute some reading is fetched just after it was made: the alignment of clocks lives on those."""
USUAL_AVERAGING_S = 0.1


@dataclass(frozen=True)
class Duration:
    """Bench time in s that something is expected to take, and between which bounds it does."""

    expected_s: float = 0.0
    shortest_s: float = 0.0
    longest_s: float = 0.0

    def __add__(self, other: Duration) -> Duration:
        """Return what one after the other takes."""
        return Duration(
            self.expected_s + other.expected_s,
            self.shortest_s + other.shortest_s,
            self.longest_s + other.longest_s,
        )

    @property
    def is_certain(self) -> bool:
        """Whether it takes what is expected, whatever data and instruments say."""
        return self.longest_s - self.shortest_s < 1e-6

    def to_data(self) -> dict[str, float]:
        """Return it as plain data."""
        return {name: round(value, 6) for name, value in vars(self).items()}


NO_TIME = Duration()


def on_the_way(expected_s: float) -> Duration:
    """Return how long an instrument takes to where it is sent: nothing at all, or twice as long."""
    return Duration(expected_s, 0.0, 2.0 * expected_s)


@dataclass(frozen=True)
class Rows:
    """The rows that a source gives over `duration_s` of bench time.

    `count` of None: as many as a gaussmeter's own averaging gives, in all that time or, where its
    readings are kept in a part of it only, in `read_s`.
    """

    instrument: str
    duration_s: float
    count: float | None = None
    read_s: float | None = None


@dataclass(frozen=True)
class Work:
    """What a step does for a unit of work, or, without a unit, beside them.

    It takes `duration_s` of bench time, and beside it what data or instruments have `decided`. A
    unit may spread over steps: each gives its own part. What `repeats` is done again as often as
    the data decide, under names that nobody knows before; its rows and its time are those of all
    repetitions.
    """

    step: str
    unit: str | None = None
    commands: tuple[Command[Any], ...] = ()
    rows: tuple[Rows, ...] = ()
    duration_s: float = 0.0
    repeats: bool = False
    decided: Duration = NO_TIME

    @property
    def duration(self) -> Duration:
        """How long it takes."""
        return Duration(self.duration_s, self.duration_s, self.duration_s) + self.decided


@dataclass(frozen=True)
class Recording:
    """The rows that a source is expected to give, and the bench time in s over which they come."""

    instrument: str
    rows: int
    duration_s: float


@dataclass(frozen=True)
class Forecast:
    """What a run of a plan on a bench will command and record, in the order of its steps.

    `held_bytes` is the most that the evaluation holds of the record at once; where it is None, that
    is all rows.
    """

    set_points: tuple[SetPoint, ...] = ()
    recordings: tuple[Recording, ...] = ()
    held_bytes: int | None = None


def units_of(work: Iterable[Work]) -> tuple[str, ...]:
    """Return the units of work in their order."""
    return tuple(unit_durations_s(work))


def unit_durations_s(work: Iterable[Work]) -> dict[str, float]:
    """Return the expected bench time in s of each unit of work, in their order."""
    durations_s: dict[str, float] = {}
    for part in work:
        if part.unit is not None:
            durations_s[part.unit] = durations_s.get(part.unit, 0.0) + part.duration.expected_s
    return durations_s


def set_points_of(work: Sequence[Work], bench: Bench) -> tuple[SetPoint, ...]:
    """Return what is commanded on a bench, in order."""
    sent = [(part.step, command) for part in work for command in part.commands]
    set_points: list[SetPoint] = []
    alike = groupby(sent, key=lambda pair: (pair[0], type(pair[1]), pair[1].instrument))
    for (step, kind, _), group in alike:
        set_points += kind.declare(step, [command for _, command in group], bench)
    return tuple(set_points)


def recordings_of(work: Sequence[Work], bench: Bench) -> tuple[Recording, ...]:
    """Return the rows of each source over a whole run."""
    by_source: dict[str, list[Rows]] = {}
    for rows in (rows for part in work for rows in part.rows):
        by_source.setdefault(rows.instrument, []).append(rows)
    return tuple(recording_of(source, rows, bench) for source, rows in by_source.items())


def recording_of(source: str, rows: Sequence[Rows], bench: Bench) -> Recording:
    """Return all rows of one source."""
    count = sum(row.count for row in rows if row.count is not None)
    uncounted = [row for row in rows if row.count is None]
    if uncounted:
        read_s = sum(row.duration_s if row.read_s is None else row.read_s for row in uncounted)
        count += read_s / reading_period_s(bench, source)
    return Recording(source, math.ceil(count - 1e-6), sum(row.duration_s for row in rows))


def reading_period_s(bench: Bench, gaussmeter: str) -> float:
    """Return the seconds between two readings of a gaussmeter: its averaging time.

    Of one that keeps no readings each look brings one.
    """
    instrument = bench.instruments[gaussmeter]
    if not registry.load(registry.DRIVERS, instrument.driver).keeps_readings:
        return POLL_S
    try:
        averaging_s = parse_as(instrument.settings.get("averaging"), "s")
    except UnitError:
        return USUAL_AVERAGING_S
    return averaging_s if averaging_s > 0 else USUAL_AVERAGING_S
