"""What a step sends to an instrument: declared before a run, and applied from the same object.

A `Command` is one act of one instrument, such as a sine of a field at a coil. Its words stand in
the dry run, its bounds are held against the limits of the bench, and `run.apply(command)` sends it.
What the roles can be commanded is in `station.method.commands`.

What a command sets within limits is one table, `QUANTITIES`: the bounds of a command, what a dry
run shows as largest, and what is held against the limits of a bench file are read from it. `slew`
and `zero_current` are no quantities of a command: they bind drivers.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypedDict, TypeVar

from station.errors import InputError
from station.roles.role import Limit, limits, role, role_of

if TYPE_CHECKING:
    from station.instruments.bench import Bench

Result = TypeVar("Result")
Role = TypeVar("Role")
Where = tuple[str, ...]
SLACK = 1e-9
"""Relative; what rounding may add to a value on its way from the declaration to the command."""


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


Value = Callable[[SetPoint, float], float | None]
"""What a set-point has of a quantity, given the coil's resistance in ohm; None for nothing."""


@dataclass(frozen=True)
class Check:
    """A limit of the bench file, what a set-point has of it, and the sentence beyond it.

    `sentence` is filled with what is commanded, the value, the instrument and what is allowed.
    `lowest`: the limit is a lower one.
    """

    limit: str
    value: Value
    sentence: str
    lowest: bool = False
    needs_resistance: bool = False

    def says(self, what: str, value: float, name: str, allowed: float) -> str:
        """Return the sentence."""
        return self.sentence.format(what=what, value=value, name=name, allowed=allowed)


@dataclass(frozen=True)
class BoundedQuantity:
    """One quantity: what it is called, its unit, what a set-point has of it, and its limits.

    `name` is that of the bound of a command, with its unit, empty where the quantity follows from
    other bounds. `limit` is the key in the bench file; of a `signed` quantity there are two, its
    `_low` and its `_high`. `sentence` is said beyond it, another one than the common where given.
    `shown`: a dry run names the set-point with the most of it.
    """

    word: str
    unit: str
    limit: str
    name: str = ""
    follows: Value | None = None
    signed: bool = False
    shown: bool = False
    needs_resistance: bool = False
    sentence: str = ""

    def value(self, point: SetPoint, resistance_ohm: float = 0.0) -> float | None:
        """Return what a set-point has of it, the magnitude where the sign does not count."""
        if self.follows is not None:
            return self.follows(point, resistance_ohm)
        given = getattr(point, self.name)
        return None if given is None else float(given) if self.signed else abs(float(given))

    def checks(self) -> Iterator[Check]:
        """Yield the limits that a set-point is held against."""
        if not self.signed:
            sentence = self.sentence or too_much(self.unit)
            yield Check(self.limit, self.value, sentence, needs_resistance=self.needs_resistance)
            return
        yield Check(f"{self.limit}_high", self.value, too_much(self.unit))
        yield Check(f"{self.limit}_low", self.value, too_little(self.unit), lowest=True)


def too_much(unit: str) -> str:
    """Return the sentence of a set-point whose words hold no field."""
    return (
        f"{{what}}: {{value:.4g}} {unit} is more than the {{allowed:g}} {unit} that the bench "
        "allows for {name}"
    )


def too_little(unit: str) -> str:
    """Return the sentence of a set-point below a lower limit."""
    return too_much(unit).replace("more than", "less than")


def rms_current_A(point: SetPoint, resistance_ohm: float = 0.0) -> float | None:
    """Return the effective current of a set-point over its duty, in A; None without a current."""
    given = point.current_A if point.rms_current_A is None else point.rms_current_A
    return (
        None if given is None else abs(given) * (1.0 if point.duty is None else point.duty) ** 0.5
    )


def heating_W(point: SetPoint, resistance_ohm: float) -> float | None:
    """Return the power that a set-point turns into heat in a coil, in W: I²R times its duty."""
    current_A = rms_current_A(point)
    return None if current_A is None else current_A**2 * resistance_ohm


def coil_voltage_V(point: SetPoint, resistance_ohm: float) -> float | None:
    """Return the voltage in V that a set-point's current needs at a coil, inductance aside."""
    return None if point.current_A is None else abs(point.current_A) * resistance_ohm


HEATING = "coil heating"
QUANTITIES = (
    BoundedQuantity(
        "field",
        "mT",
        "field",
        "field_mT",
        shown=True,
        sentence="{value:g} mT is more than the {allowed:g} mT that the bench allows for {name}",
    ),
    BoundedQuantity(
        "current",
        "A",
        "current",
        "current_A",
        shown=True,
        sentence="{what} needs {value:.3g} A from {name}, the bench allows {allowed:g} A",
    ),
    BoundedQuantity(
        "effective current",
        "A",
        "rms_current",
        follows=rms_current_A,
        sentence="{what} needs an effective current of {value:.3g} A from {name}, the bench allows "
        "{allowed:g} A",
    ),
    BoundedQuantity(
        "coil voltage",
        "V",
        "voltage",
        follows=coil_voltage_V,
        needs_resistance=True,
        sentence="{what} needs {value:.3g} V at {name}'s coil, the bench allows {allowed:g} V",
    ),
    BoundedQuantity(
        HEATING,
        "W",
        "heating",
        follows=heating_W,
        shown=True,
        needs_resistance=True,
        sentence="{what} heats {name}'s coil with {value:.3g} W, the bench allows {allowed:g} W",
    ),
    BoundedQuantity("voltage", "V", "voltage", "voltage_V"),
    BoundedQuantity("rate", "deg/s", "rate", "rate_deg_per_s", shown=True),
    BoundedQuantity("acceleration", "deg/s^2", "acceleration", "acceleration_deg_per_s2"),
    BoundedQuantity("angle", "deg", "angle", "angle_deg", signed=True),
    BoundedQuantity(
        "temperature", "degC", "temperature", "temperature_degC", signed=True, shown=True
    ),
    BoundedQuantity(
        "temperature slew", "degC/min", "temperature_slew", "temperature_slew_degC_per_min"
    ),
)
BOUNDS = {quantity.name: quantity for quantity in QUANTITIES if quantity.name}
"""By the bound of a command: what a run may never send more of than it declared; heating counts
over a whole plan."""


def checks_of(instrument: str) -> Iterator[Check]:
    """Yield the checks of an instrument's limits, those of a laboratory's own role last."""
    known = [check for quantity in QUANTITIES for check in quantity.checks()]
    yield from known
    declared, names = role(role_of(instrument)), {check.limit for check in known}
    for name, limit in declared.limits.items() if declared else ():
        if name not in names:
            lowest = name.endswith("_low")
            sentence = (too_little if lowest else too_much)(limit.unit)
            yield Check(name, limited(name, limit), sentence, lowest)


def limited(name: str, limit: Limit) -> Value:
    """Return what reads the value of a set-point that a role's limit bounds."""

    def value(point: SetPoint, resistance_ohm: float) -> float | None:
        given = (point.limited or {}).get(name)
        return given if given is None or limit.signed else abs(given)

    return value


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

    @property
    def assumed(self) -> Any:
        """What a dry run takes for that which applying it returns."""
        return None

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
        signed = {name for name, quantity in BOUNDS.items() if quantity.signed}
        signed |= {name for name, limit in limits().items() if limit.signed}
        ranges: dict[str, dict[str, tuple[float, float]]] = {}
        for point in points:
            known = ranges.setdefault(point.instrument, {})
            of_roles = {name: getattr(point, name) for name in BOUNDS}
            for name, value in {**of_roles, **(point.limited or {})}.items():
                if value is not None:
                    low, high = (value, value) if name in signed else (0.0, abs(value))
                    least, most = known.get(name, (low, high))
                    known[name] = (min(least, low), max(most, high))
        return cls(ranges)

    def require(self, command: Command[Any], bench: Bench) -> None:
        """Raise InputError for a command beyond what was declared, and so held against no limit.

        Of an instrument that was to be commanded nothing, that is any command.
        """
        asked = Envelope.of([command.set_point("", bench)]).ranges[command.instrument]
        if command.instrument not in self.ranges:
            raise InputError(
                f"{command.instrument}: a step commands {command.words(bench)}, and its "
                "dry run saw no command of this instrument; it is not sent"
            )
        declared = self.ranges[command.instrument]
        for name, (low, high) in asked.items():
            least, most = declared.get(name, (math.inf, -math.inf))
            slack = SLACK * max(abs(low), abs(high))
            if not (low >= least - slack and high <= most + slack):  # nor one that is no number
                raise InputError(
                    f"{command.instrument}: a step commands {command.words(bench)}, which is "
                    "beyond what its dry run saw, and was held against no limit; it is not sent"
                )
