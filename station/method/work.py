"""What a procedure declares of its work: commands, rows and time, by step and unit of work."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from station.method.dry_run import Act, Rows, Walk, reading_period_s
from station.method.duration import NO_TIME, Duration, exactly, on_the_way
from station.method.set_points import Command
from station.method.verbs import POLL_S

__all__ = ["NO_TIME", "POLL_S", "Duration", "Rows", "Work", "on_the_way", "reading_period_s"]


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


def walk_of(work: Iterable[Work], instruments: tuple[str, ...], prompts: Any) -> Walk:
    """Return declared work as what a dry run finds."""
    work = tuple(work)
    units = dict.fromkeys(part.unit for part in work if part.unit is not None)
    return Walk(
        tuple(act for part in work for act in acts_of(part)), prompts, instruments, (*units,)
    )


def acts_of(part: Work) -> Iterator[Act]:
    """Yield what stands in a piece of work."""
    act = Act(part.step, part.unit, None, (), NO_TIME, part.repeats)
    for command in part.commands:
        yield replace(act, command=command)
    yield replace(act, rows=part.rows, duration=exactly(part.duration_s) + part.decided)
