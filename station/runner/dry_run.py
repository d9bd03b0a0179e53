"""Walk a plan without opening an instrument: when each step begins, what it sets, how far it goes.

What a procedure foresees comes from its `forecast`; the extremes are found here, the same way for
all procedures.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.clock import system_clock_synchronised, utc_now
from station.method.duration import NO_TIME, Duration
from station.method.set_points import (
    HEATING,
    QUANTITIES,
    BoundedQuantity,
    heating_W,
)
from station.procedure import procedure_of
from station.runner.preflight import (
    fault_of_output,
    warned_of_clock,
    warned_of_limits,
    warned_of_memory,
    warned_of_records,
)
from station.runner.resources import Disk, Memory, disk_of, memory_of
from station.runner.session import clock_for
from station.runner.static_limits import RESISTANCE, coil_resistance_ohm

if TYPE_CHECKING:
    from station.files.plan import Plan
    from station.instruments.bench import Bench
    from station.method.set_points import SetPoint


@dataclass(frozen=True)
class Extreme:
    """The largest (or lowest) value that a run sets; None with a note where it is not known."""

    which: str
    quantity: str
    value: float | None
    unit: str
    instrument: str
    note: str = ""


@dataclass(frozen=True)
class Walked:
    """One step of a dry run: when it is expected to begin, s of bench time, how long it takes."""

    step: str
    title: str
    starts_s: float
    duration: Duration
    set_points: tuple[SetPoint, ...]


@dataclass(frozen=True)
class DryRunReport:
    """A walk through a plan; `speed` is None where waiting is skipped: end time unknown."""

    steps: tuple[Walked, ...]
    extremes: tuple[Extreme, ...]
    duration: Duration
    speed: float | None
    ends_utc: datetime | None
    disk: Disk
    memory: Memory
    warnings: tuple[str, ...]

    def to_data(self) -> dict[str, Any]:
        """Return the walk as plain data; a set-point holds what concerns it only."""
        return {
            "steps": [
                {
                    "step": step.step,
                    "title": step.title,
                    "starts_s": round(step.starts_s, 6),
                    **step.duration.to_data(),
                    "set_points": [given(point) for point in step.set_points],
                }
                for step in self.steps
            ],
            "extremes": [vars(extreme) for extreme in self.extremes],
            **self.duration.to_data(),
            "speed": self.speed,
            "estimated_end_utc": self.ends_utc and self.ends_utc.isoformat(timespec="seconds"),
            "disk": {
                "output": str(self.disk.folder),
                "needed_bytes": self.disk.needed_bytes,
                "free_bytes": self.disk.free_bytes,
            },
            "memory": vars(self.memory),
            "warnings": list(self.warnings),
        }


def walk(
    plan: Plan, bench: Bench, output: Path, served: Mapping[str, Any] | None = None
) -> DryRunReport:
    """Walk the steps of a plan on a bench; nothing is opened and nothing is written.

    `served` is the first line of a `station sim` that the run would use.
    """
    procedure = procedure_of(plan.procedure)
    foreseen = procedure.forecast(plan.parameters, bench)
    clock = clock_for(bench, served)
    steps: list[Walked] = []
    whole = NO_TIME
    for step, duration in procedure.timed_steps(plan.parameters):
        points = tuple(point for point in foreseen.set_points if point.step == step.number)
        steps.append(Walked(step.number, step.title, whole.expected_s, duration, points))
        whole += duration
    disk, memory = disk_of(foreseen, bench, output, clock), memory_of(foreseen)
    speed: float | None = getattr(clock, "speed", None)
    return DryRunReport(
        steps=tuple(steps),
        extremes=tuple(extremes(foreseen.set_points, bench)),
        duration=whole,
        speed=speed,
        ends_utc=ends_utc(whole.expected_s, speed),
        disk=disk,
        memory=memory,
        warnings=(
            *(warning.sentence for warning in warned_of_memory(memory)),
            *(warning.sentence for warning in warned_of_limits(plan, procedure)),
            *(warning.sentence for warning in warned_of_records(plan, procedure, bench)),
            *warnings(disk, output, whole.expected_s, real=is_real(bench, served)),
        ),
    )


def is_real(bench: Bench, served: Mapping[str, Any] | None) -> bool:
    """Return whether a run would use real instruments."""
    return bench.simulation is None and served is None


def warnings(disk: Disk, output: Path, expected_s: float, *, real: bool) -> Iterator[str]:
    """Yield what would keep a run from beginning, or what it would warn of."""
    fault = fault_of_output(output)
    if fault is not None:
        yield fault
    if disk.too_small:
        yield disk.sentence()
    synchronised = system_clock_synchronised()
    for warning in warned_of_clock(expected_s, real=real, synchronised=synchronised):
        yield warning.sentence


def ends_utc(expected_s: float, speed: float | None) -> datetime | None:
    """Return when a run that begins now would end; None on virtual time or beyond all calendars."""
    if speed is None:
        return None
    try:
        return utc_now() + timedelta(seconds=expected_s / speed)
    except OverflowError:
        return None


def extremes(points: Sequence[SetPoint], bench: Bench) -> Iterator[Extreme]:
    """Yield the largest field, current, heating and rate, lowest and highest temperature."""
    for quantity in QUANTITIES:
        if quantity.word == HEATING:
            yield from heating(points, bench)
        elif quantity.shown:
            yield from ends(points, quantity)


def ends(points: Sequence[SetPoint], quantity: BoundedQuantity) -> Iterator[Extreme]:
    """Yield the set-point with the largest magnitude, or the lowest and highest of a signed one."""
    sized = [
        (value, point.instrument)
        for point in points
        if (value := quantity.value(point)) is not None
    ]
    if not sized:
        return
    word, unit = quantity.word, quantity.unit
    most, instrument = max(sized, key=itemgetter(0))
    if quantity.signed:
        least, of_least = min(sized, key=itemgetter(0))
        yield Extreme("lowest", word, least, unit, of_least)
    yield Extreme("highest" if quantity.signed else "largest", word, most, unit, instrument)


def heating(points: Sequence[SetPoint], bench: Bench) -> Iterator[Extreme]:
    """Yield the largest heating of a coil, W: I^2 R of the effective current.

    The resistance is the bench file's `coil_resistance`; a coil without one is named by itself.
    """
    known: list[tuple[float, str]] = []
    unknown: dict[str, None] = {}
    for point in points:
        if point.current_A is None:
            continue
        resistance_ohm = coil_resistance_ohm(bench, point.instrument)
        if resistance_ohm is None:
            unknown[point.instrument] = None
        else:
            known.append((heating_W(point, resistance_ohm) or 0.0, point.instrument))
    if known:
        value, instrument = max(known)
        yield Extreme("largest", HEATING, value, "W", instrument, "from the effective current")
    if unknown:
        note = f"not known: the bench file gives no {RESISTANCE}"
        yield Extreme("largest", HEATING, None, "W", ", ".join(unknown), note)


def given(point: SetPoint) -> dict[str, Any]:
    """Return a set-point as plain data, without its step, its key and what does not concern it."""
    data = asdict(point)
    return {
        name: value
        for name, value in data.items()
        if value is not None and name not in ("step", "decided_by")
    }
