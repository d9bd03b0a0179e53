"""The parameters of a nine-axis calibration plan, and the units of work that they make."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from procedures.common.constants import FULL_TURN_DEG
from station.fields import StrictModel, Unit
from station.findings import FlagThresholds

from .directions import AXES, PoseLimits, up_of

PUBLISHED_POSITIONS = (1, 2, 3)
FLIPPED = {1: 4, 2: 5, 3: 6}
"""Each position turned by 180 deg about the vertical: the axis that faced east faces west."""
FEWEST_RATES = 5
WHOLE = 1e-6
DEFAULT_DWELL_S = 360.0
MAX_WHOLE_S = 3600

Angle = Annotated[float, Unit("arcmin"), Field(gt=0, le=600)]
Gravity = Annotated[float, Unit("g"), Field(ge=0.9, le=1.1)]
Down = Literal["-X", "-Y", "-Z"]
COILS = ("x", "y", "z")


MAX_READING_S, SHORTEST_READING_S, READINGS = 0.9, 0.05, 50
"""Time between readings of the table's angle: less than a second, so that an interlock on the rate
needs no reading of its own, and about fifty in a short record."""


@dataclass(frozen=True)
class Turn:
    """One unit of work on the table: an axis, a signed rate, and how many whole turns of it."""

    axis: str
    rate_deg_per_s: float
    turns: int

    @property
    def gyro(self) -> str:
        """The axis along the table's, whichever way it points."""
        return self.axis[-1]

    @property
    def unit(self) -> str:
        """The name of the unit of work, unique in a plan."""
        return f"{self.axis} {self.rate_deg_per_s:+g} deg/s"

    @property
    def dwell_s(self) -> float:
        """The time of the whole turns at the nominal rate."""
        return self.turns * FULL_TURN_DEG / abs(self.rate_deg_per_s)

    @property
    def reading_interval_s(self) -> float:
        """The time between two readings of the table's angle."""
        return min(max(self.dwell_s / READINGS, SHORTEST_READING_S), MAX_READING_S)


TABLE_AXES_ARCSEC = 10.0
"""What the axes of a good table lean, and what they stop beside their angle, unless given."""


class Prior(StrictModel):
    """Standard uncertainties of the set-up, known beforehand.

    `heading` is common to all positions; `relative_heading` and `tilt` are each position's own.
    `mounting` is how far the sensor, as it was mounted, leans from the table's axes, about each of
    two axes, like `tilt` unless given; `table_axes` is what the table's axes lean themselves.
    """

    heading_arcmin: Angle
    relative_heading_arcmin: Angle
    tilt_arcmin: Angle
    accelerometer_bias_g: Annotated[float, Unit("g"), Field(gt=0, le=0.1)]
    misalignment_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0, le=600)] = 0.0
    mounting_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0, le=600)] | None = None
    table_axes_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0, le=3600)] = TABLE_AXES_ARCSEC


class EarthField(StrictModel):
    """The earth's field where the sensor is; inclination positive down."""

    magnitude_nT: Annotated[float, Unit("nT"), Field(gt=0, le=1e6)]
    inclination_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)] | None = None


class AllAxesPrior(Prior):
    """The prior with what the other six axes need of it.

    `edge` is how well a direction between axes is known; the others are those of gravity, of the
    earth's field, of the accelerometers' second order and of a gaussmeter beside the sensor.
    """

    edge_deg: Annotated[float, Unit("deg"), Field(gt=0, le=90)] = 1.0
    local_gravity_g: Annotated[float, Unit("g"), Field(ge=0, le=0.1)] = 0.0
    earth_field_magnitude_nT: Annotated[float, Unit("nT"), Field(ge=0)] = 0.0
    earth_field_inclination_deg: Annotated[float, Unit("deg"), Field(ge=0, le=90)] = 0.0
    accelerometer_second_order_ug_per_g2: Annotated[float, Unit("ug/g^2"), Field(ge=0, le=1e6)] = (
        0.0
    )
    gaussmeter_gain: Annotated[float, Unit("1"), Field(ge=0, le=1)] = 0.0
    gaussmeter_zero_nT: Annotated[float, Unit("nT"), Field(ge=0)] = 0.0
    coil_alignment_deg: Annotated[float, Unit("deg"), Field(ge=0, le=90)] = 0.0


class PlanPrior(AllAxesPrior):
    """The prior of a plan, with what a marble plate and a nine-axis sensor of this class have.

    What is not given of a gaussmeter is what its calibration record states.
    """

    coil_alignment_deg: Annotated[float, Unit("deg"), Field(ge=0, le=90)] = 0.3

    heading_arcmin: Angle = 10.0
    relative_heading_arcmin: Angle = 0.5
    tilt_arcmin: Angle = 0.5
    accelerometer_bias_g: Annotated[float, Unit("g"), Field(gt=0, le=0.1)] = 0.001
    clock_ppm: Annotated[float, Unit("ppm"), Field(ge=0, le=1000)] = 1.0


class InCoil(StrictModel):
    """Steady fields of a three-axis coil, one coil after the other: both signs of `levels`, zero.

    Below 5 uT the gaussmeter's noise would be in the scale factor. `settle` is what a field has
    before its `record`, in which sensor and gaussmeter are read.
    """

    levels_mT: tuple[Annotated[float, Unit("mT"), Field(ge=0.005)], ...] = Field(min_length=1)
    record_s: Annotated[float, Unit("s"), Field(ge=2, le=3600)] = 20.0
    settle_s: Annotated[float, Unit("s"), Field(ge=0)] = 2.0

    @field_validator("levels_mT")
    @classmethod
    def each_once(cls, levels: tuple[float, ...]) -> tuple[float, ...]:
        """Refuse a level that stands twice."""
        return _each_once(levels, "mT")

    @property
    def fields(self) -> tuple[Level, ...]:
        """Each coil's fields: zero first, then both signs of each level."""
        return tuple(
            Level(coil, field_mT)
            for coil in COILS
            for field_mT in (0.0, *(s * level for level in self.levels_mT for s in (1.0, -1.0)))
        )


@dataclass(frozen=True)
class Level:
    """One unit of work in the coil: which coil, and its field."""

    coil: str
    field_mT: float

    @property
    def unit(self) -> str:
        """The name of the unit of work, unique in a plan."""
        return f"coil {self.coil} {1000.0 * self.field_mT:+g} uT"


class PoseCheck(StrictModel):
    """How far a position's means may lie from what it should show before it is refused."""

    acceleration_g: Annotated[float, Unit("g"), Field(gt=0, le=0.5)] = PoseLimits.acceleration_g
    rate_deg_per_h: Annotated[float, Unit("deg/h"), Field(gt=0)] = PoseLimits.rate_deg_per_h
    largest_bias_deg_per_h: Annotated[float, Unit("deg/h"), Field(gt=0)] = PoseLimits.bias_deg_per_h
    attempts: Annotated[int, Field(ge=1, le=10)] = 2


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    not_significant: Annotated[float, Field(gt=0)] = FlagThresholds.not_significant
    gap: Annotated[float, Field(gt=1)] = FlagThresholds.gap
    outlier: Annotated[float, Field(ge=3)] = FlagThresholds.outlier


class NineAxisParameters(StrictModel):
    """What the engineer chooses; positions and rates as published unless given otherwise."""

    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-89, le=89)]
    latitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0
    positions: tuple[Annotated[int, Field(ge=1, le=3)], ...] = PUBLISHED_POSITIONS
    positioning: Literal["plate", "table"] = "plate"
    flip: bool = False
    static_time_s: Annotated[float, Unit("s"), Field(ge=10, le=86400)] = 600.0
    rates_deg_per_s: tuple[Annotated[float, Unit("deg/s"), Field(gt=0)], ...] = (
        *(1.0, 5.0, 10.0, 50.0),
        100.0,
    )
    range_deg_per_s: Annotated[float, Unit("deg/s"), Field(gt=0)] | None = None
    dwell: Literal["equal", "efficient"] = "equal"
    dwell_time_s: Annotated[float, Unit("s"), Field(gt=0)] | None = Field(
        default=None, validate_default=True
    )
    turns: Annotated[int, Field(ge=1, le=1000)] | None = None
    settle_s: Annotated[float, Unit("s"), Field(ge=0)] = 5.0
    static_settle_s: Annotated[float, Unit("s"), Field(ge=0)] = 10.0
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0)] = 1800.0
    poses: tuple[str, ...] = ()
    pose_time_s: Annotated[float, Unit("s"), Field(ge=10, le=86400)] = 60.0
    turned_down: tuple[Down, ...] = ()
    turned_down_rates_deg_per_s: tuple[Annotated[float, Unit("deg/s"), Field(gt=0)], ...] = (10.0,)
    local_gravity_g: Gravity = 1.0
    earth_field: EarthField | None = None
    magnetometer_in_coil: InCoil | None = None
    sample_rate_Hz: Annotated[float, Unit("Hz"), Field(ge=1, le=5000)] = 100.0
    table_axis: Annotated[int, Field(ge=1, le=3)] = 1
    angle_random_walk_deg_per_sqrt_h: Annotated[float, Unit("deg/sqrt(h)"), Field(gt=0)] = 0.012
    prior: PlanPrior = PlanPrior()
    pose: PoseCheck = PoseCheck()
    thresholds: Thresholds = Thresholds()

    @field_validator("positions")
    @classmethod
    def none_skipped(cls, positions: tuple[int, ...]) -> tuple[int, ...]:
        """Require each published position once, in any order."""
        missing = [position for position in PUBLISHED_POSITIONS if position not in positions]
        if missing:
            listed = " and ".join(str(position) for position in missing)
            raise ValueError(f"position {listed} is skipped; the method needs 1, 2 and 3")
        return _each_once(positions)

    @field_validator("rates_deg_per_s")
    @classmethod
    def enough_rates(cls, rates: tuple[float, ...]) -> tuple[float, ...]:
        """Require five rates or more, each once."""
        if len(rates) < FEWEST_RATES:
            raise ValueError(f"there are {len(rates)}; the method needs N > 4, five rates or more")
        return _each_once(rates)

    @field_validator("poses")
    @classmethod
    def directions(cls, poses: tuple[str, ...]) -> tuple[str, ...]:
        """Require directions, each once."""
        for word in poses:
            if up_of(word) is None:
                raise ValueError(
                    f"'{word}' is no direction; write what points up: X, -X, X+Y, -X-Y-Z"
                )
        return _each_once(poses)

    @field_validator("turned_down", "turned_down_rates_deg_per_s")
    @classmethod
    def each_once(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        """Refuse a direction or a rate that stands twice."""
        return _each_once(values)

    @field_validator("range_deg_per_s")
    @classmethod
    def above_every_rate(cls, largest: float | None, info: ValidationInfo) -> float | None:
        """Refuse a rate at which the gyro saturates."""
        for rate in info.data.get("rates_deg_per_s") or ():
            if largest is not None and rate >= largest:
                raise ValueError(
                    f"{rate:g} deg/s of rates is not below the gyro's range, {largest:g} deg/s"
                )
        return largest

    @field_validator("dwell_time_s")
    @classmethod
    def whole_turns(cls, dwell_s: float | None, info: ValidationInfo) -> float | None:
        """Require a time in which every rate makes whole turns; equal dwell only."""
        if info.data.get("dwell") == "efficient":
            if dwell_s is not None:
                raise ValueError("an efficient dwell has as many turns at each rate; give turns")
            return None
        rates = info.data.get("rates_deg_per_s")
        if rates is None:
            return dwell_s
        time_s = DEFAULT_DWELL_S if dwell_s is None else dwell_s
        for rate in rates:
            turns = rate * time_s / FULL_TURN_DEG
            if abs(turns - round(turns)) > WHOLE * max(1.0, turns) or round(turns) < 1:
                raise ValueError(
                    f"{time_s:g} s at {rate:g} deg/s are {turns:.4g} turns, not a whole number; "
                    f"{_hint(rates)}"
                )
        return dwell_s

    @field_validator("turns")
    @classmethod
    def efficient_only(cls, turns: int | None, info: ValidationInfo) -> int | None:
        """Refuse a number of turns beside an equal dwell."""
        if turns is not None and info.data.get("dwell") == "equal":
            raise ValueError("an equal dwell has a time for each rate; give dwell_time")
        return turns

    @property
    def all_positions(self) -> tuple[int, ...]:
        """The positions in the order in which they are taken, flipped ones after their own."""
        if not self.flip:
            return self.positions
        return tuple(position for p in self.positions for position in (p, FLIPPED[p]))

    @property
    def all_turns(self) -> tuple[Turn, ...]:
        """Each direction's rates in the plan's order, forth and back at each."""
        return tuple(
            Turn(word, sense * rate, self.turns_at(rate))
            for word in self.all_turned
            for rate in (self.rates_deg_per_s if word in AXES else self.turned_down_rates_deg_per_s)
            for sense in (1.0, -1.0)
        )

    @property
    def all_turned(self) -> tuple[str, ...]:
        """What points up on the turning table, one after the other."""
        return (*AXES, *self.turned_down)

    def turns_at(self, rate_deg_per_s: float) -> int:
        """Return the whole turns of one record at a rate."""
        if self.dwell == "efficient":
            return self.turns or 1
        time_s = DEFAULT_DWELL_S if self.dwell_time_s is None else self.dwell_time_s
        return max(round(rate_deg_per_s * time_s / FULL_TURN_DEG), 1)

    @property
    def units(self) -> tuple[str, ...]:
        """All units of work in the order in which they are measured."""
        return (
            *(f"position {position}" for position in self.all_positions),
            *(pose_unit(word) for word in self.poses),
            *(turn.unit for turn in self.all_turns),
            *(level.unit for level in self.coil_fields),
        )

    @property
    def coil_fields(self) -> tuple[Level, ...]:
        """The fields in the coil in their order; none where the plan has no coil."""
        return self.magnetometer_in_coil.fields if self.magnetometer_in_coil else ()


def pose_unit(word: str) -> str:
    """Return the name of a further pose's unit of work."""
    return f"pose {word}"


def _hint(rates: Sequence[float]) -> str:
    """Return the shortest time in whole seconds in which every rate makes whole turns."""
    for time_s in range(1, MAX_WHOLE_S + 1):
        turns = [rate * time_s / FULL_TURN_DEG for rate in rates]
        if all(round(n) >= 1 and abs(n - round(n)) <= WHOLE * max(1.0, n) for n in turns):
            return f"{time_s} s would be whole at every rate"
    return "choose dwell: efficient, which has whole turns at each rate"


def _each_once(values: tuple[Any, ...], unit: str = "deg/s") -> tuple[Any, ...]:
    for n, value in enumerate(values):
        number = isinstance(value, float)
        if any(math.isclose(value, v, rel_tol=1e-9) if number else v == value for v in values[:n]):
            raise ValueError(
                f"{value:g} {unit} stands twice" if number else f"{value} stands twice"
            )
    return values
