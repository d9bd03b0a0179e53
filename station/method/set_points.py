"""What a step sends to an instrument: declared before a run, and applied from the same object.

A `Command` is one act of one instrument, such as a sine of a field at a coil. Its words stand in
the dry run, its bounds are held against the limits of the bench, and `run.apply(command)` sends it.
What the roles can be commanded is in `station.method.commands`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypedDict, TypeVar

from station.errors import InputError

if TYPE_CHECKING:
    from station.instruments.bench import Bench

Result = TypeVar("Result")
Role = TypeVar("Role")
Where = tuple[str, ...]
SLACK = 1e-9
"""Relative; what rounding may add to a value on its way from the declaration to the command."""
SIGNED = ("angle_deg", "temperature_degC")
"""Quantities whose bounds have two ends, as signed limits have; all others count in magnitude."""
BOUNDED = (
    "field_mT",
    "current_A",
    "voltage_V",
    "rate_deg_per_s",
    "acceleration_deg_per_s2",
    *SIGNED,
    "temperature_slew_degC_per_min",
)
"""What a run may never send more of than it declared; heating counts over a whole plan."""


class Bounds(TypedDict, total=False):
    """The largest values that a command sets. What it does not concern is left out.

    `rms_current_A` is what heats a coil, the effective current of a current that changes; where it
    is left out, `current_A` itself. `duty` is the part of the time in which the current flows.
    `temperature_slew_degC_per_min` is how fast a temperature is approached. `limited` has, by limit
    of a laboratory's own role, the largest value in that limit's unit.
    """

    field_mT: float
    current_A: float
    rms_current_A: float
    duty: float
    voltage_V: float
    rate_deg_per_s: float
    acceleration_deg_per_s2: float
    angle_deg: float
    temperature_degC: float
    temperature_slew_degC_per_min: float
    limited: Mapping[str, float]


@dataclass(frozen=True)
class SetPoint:
    """What a step commands of an instrument, on one bench: in words, with its bounds (`Bounds`).

    `decided_by` is the key of the plan that decides it: faults point there. What a set-point does
    not concern is None.
    """

    step: str
    instrument: str
    text: str
    field_mT: float | None = None
    current_A: float | None = None
    rms_current_A: float | None = None
    rate_deg_per_s: float | None = None
    temperature_degC: float | None = None
    duty: float | None = None
    acceleration_deg_per_s2: float | None = None
    angle_deg: float | None = None
    temperature_slew_degC_per_min: float | None = None
    voltage_V: float | None = None
    limited: Mapping[str, float] | None = field(default=None, hash=False)
    decided_by: Where | None = None


class Station(Protocol):
    """What a command is applied with: a run, or whatever has opened instruments."""

    @property
    def bench(self) -> Bench:
        """The bench whose instruments they are."""
        ...

    def role(self, name: str, kind: type[Role]) -> Role:
        """Return an opened instrument that has the verbs of a role."""
        ...


@dataclass(frozen=True)
class Command(ABC, Generic[Result]):
    """One act of one instrument; `decided_by` is the key of the plan that decides it.

    A laboratory's own command is a subclass of this: words, bounds where there are limits, and
    what is sent.
    """

    instrument: str
    decided_by: Where | None = field(default=None, kw_only=True)

    @abstractmethod
    def words(self, bench: Bench) -> str:
        """Return what is commanded, for dry run and panel."""

    def bounds(self, bench: Bench) -> Bounds:
        """Return the largest values that are set; nothing where no limit can concern them."""
        return {}

    def prepare(self, station: Station) -> Result | None:
        """Load what is to start together with others; nothing is energised by it."""
        return None

    @abstractmethod
    def apply(self, station: Station, prepared: Result | None) -> Result:
        """Send it; `prepared` is what `prepare` returned."""

    @classmethod
    def declare(cls, step: str, commands: Sequence[Self], bench: Bench) -> Iterator[SetPoint]:
        """Yield the set-points of successive commands of an instrument; some read better as one."""
        for command in commands:
            yield command.set_point(step, bench)

    def set_point(self, step: str, bench: Bench) -> SetPoint:
        """Return it as a set-point of a step."""
        words, bounds = self.words(bench), self.bounds(bench)
        return SetPoint(step, self.instrument, words, decided_by=self.decided_by, **bounds)


@dataclass(frozen=True)
class Bounded(Command[None]):
    """What a step decides by data: before the run only its words are known, and how far it goes."""

    text: str
    within: Bounds = field(default_factory=Bounds, kw_only=True)

    def words(self, bench: Bench) -> str:
        """Return the words given."""
        return self.text

    def bounds(self, bench: Bench) -> Bounds:
        """Return the bounds given."""
        return self.within

    def apply(self, station: Station, prepared: None) -> None:
        """Raise InputError: what the data decide is a command of its own."""
        raise InputError(
            f"{self.instrument}: `{self.text}` declares how far a step may go; apply the command "
            "that its data decide"
        )


@dataclass(frozen=True)
class Envelope:
    """What a run has declared of each instrument and was held against the limits of the bench.

    `ranges` has, by instrument and quantity, the lowest and the highest value; an instrument
    without any quantity is there with none.
    """

    ranges: Mapping[str, Mapping[str, tuple[float, float]]]

    @classmethod
    def of(cls, points: Sequence[SetPoint]) -> Envelope:
        """Return the envelope of set-points."""
        from station.roles.role import limits

        signed = {*SIGNED, *(name for name, limit in limits().items() if limit.signed)}
        ranges: dict[str, dict[str, tuple[float, float]]] = {}
        for point in points:
            known = ranges.setdefault(point.instrument, {})
            of_roles = {name: getattr(point, name) for name in BOUNDED}
            for name, value in {**of_roles, **(point.limited or {})}.items():
                if value is not None:
                    low, high = (value, value) if name in signed else (0.0, abs(value))
                    least, most = known.get(name, (low, high))
                    known[name] = (min(least, low), max(most, high))
        return cls(ranges)

    def require(self, command: Command[Any], bench: Bench) -> None:
        """Raise InputError for a command beyond what was declared, and so held against no limit."""
        asked = Envelope.of([command.set_point("", bench)]).ranges[command.instrument]
        declared = self.ranges.get(command.instrument, {})
        for name, (low, high) in asked.items():
            least, most = declared.get(name, (math.inf, -math.inf))
            slack = SLACK * max(abs(low), abs(high))
            if not (low >= least - slack and high <= most + slack):  # nor one that is no number
                raise InputError(
                    f"{command.instrument}: a step commands {command.words(bench)}, which is "
                    "beyond what the procedure declares of its work; it is not sent"
                )
