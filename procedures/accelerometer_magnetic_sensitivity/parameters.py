"""The parameters of an accelerometer magnetic-sensitivity plan, and the points that they make."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from procedures.common.thresholds import (
    FIELD_DIFFERS,
    GAP,
    MODEL_TOO_STIFF,
    NOT_SIGNIFICANT,
    OUTLIER,
)
from station.fields import StrictModel, Unit

Plane = Literal["io", "ip", "op", "level"]
AngleStep = Annotated[float, Unit("deg"), Field(gt=0, le=180)]

PUBLISHED_ANGLE_STEP_DEG = 15.0
EFFICIENT_ANGLE_STEP_DEG = 40.0
"""Nine angles: as efficient a reading as many, and enough to tell the third order apart."""
USUAL_SCALE_FACTOR_V_PER_G = 1.0
MAX_POINTS = 20000
"""Three days and nights, at twelve seconds a point."""
MAX_STEPS = 3600
_BEFORE_REPEATS = {"planes", "design", "largest_field_mT", "lowest_field_mT", "field_step_mT"} | {
    "fields_mT",
    "angle_step_deg",
    "angles_deg",
}


@dataclass(frozen=True)
class Point:
    """One unit of work: an angle and a field in a plane, in one pass over the plan."""

    plane: str
    angle_deg: float
    field_mT: float
    number: int

    @property
    def unit(self) -> str:
        """The name of the unit of work, unique in a plan."""
        return f"{self.plane} {self.angle_deg:g} deg {self.field_mT:g} mT {self.number}"


class Dwell(StrictModel):
    """When a point has settled: successive field readings agree, for `at_least` and longer."""

    field_change_mT: Annotated[float, Unit("mT"), Field(gt=0)] = 0.02
    at_least_s: Annotated[float, Unit("s"), Field(ge=0)] = 1.0
    at_most_s: Annotated[float, Unit("s"), Field(gt=0)] = 60.0

    @field_validator("at_most_s")
    @classmethod
    def longer_than_least(cls, at_most_s: float, info: ValidationInfo) -> float:
        """Refuse a time-out that ends before the least dwell."""
        at_least_s = info.data.get("at_least_s")
        if at_least_s is not None and at_most_s <= at_least_s:
            raise ValueError(f"must be longer than at_least, {at_least_s:g} s")
        return at_most_s


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    not_significant: Annotated[float, Field(gt=0)] = NOT_SIGNIFICANT
    field_differs_from_commanded: Annotated[float, Unit("1"), Field(gt=0)] = FIELD_DIFFERS
    gap: Annotated[float, Field(gt=1)] = GAP
    model_too_stiff: Annotated[float, Field(gt=0)] = MODEL_TOO_STIFF
    outlier: Annotated[float, Field(ge=3)] = OUTLIER


class AnalysisSettings(Thresholds):
    """With the choices of the estimator, which no plan states among its thresholds.

    `not_significant` is in standard uncertainties of a magnetic coefficient, `outlier` in robust
    standard deviations, `gap` in nominal intervals, `field_differs_from_commanded` relative.
    `window` is the number of rows of the finite-memory solution, chosen where it is None.
    `scale_factor_V_per_g` stands for Ki where no row tells that.
    """

    max_drift_order: int = 8
    window: int | None = None
    scale_factor_V_per_g: float = USUAL_SCALE_FACTOR_V_PER_G

    def too_stiff_beyond(self, rows: int) -> float:
        """Return the correlation of neighbouring residuals above which the model is too stiff.

        With few rows a correlation as large as the threshold is no rarity.
        """
        return max(self.model_too_stiff, 3.0 / math.sqrt(rows))


class AccelerometerParameters(StrictModel):
    """What the engineer chooses; the source document leaves every number open.

    `local_gravity` is 1 g where accelerations are to be in units of the local g; `ambient_field` is
    the field across the coil, of which a probe that leans reads a part.
    """

    planes: tuple[Plane, ...] = ("io", "ip")
    design: Literal["as_published", "efficient"] = "as_published"
    largest_field_mT: Annotated[float, Unit("mT"), Field(gt=0)]
    lowest_field_mT: Annotated[float, Unit("mT")] | None = None
    field_step_mT: Annotated[float, Unit("mT"), Field(gt=0)] | None = Field(
        default=None, validate_default=True
    )
    fields_mT: tuple[Annotated[float, Unit("mT")], ...] | None = None
    angle_step_deg: AngleStep | None = None
    angles_deg: tuple[Annotated[float, Unit("deg")], ...] | None = None
    order: Literal["as_published", "palindrome", "random"] = "as_published"
    seed: Annotated[int, Field(ge=0)] = 1
    repeats: Annotated[int, Field(ge=1, le=1000)] = Field(default=1, validate_default=True)
    readings: Annotated[int, Field(ge=1, le=10000)] = 5
    nplc: Annotated[float, Field(gt=0, le=100)] = 10.0
    reading_noise_V: Annotated[float, Unit("V"), Field(gt=0)] = 3e-6
    scale_factor_V_per_g: Annotated[float, Unit("V/g"), Field(gt=0)] = USUAL_SCALE_FACTOR_V_PER_G
    dwell: Dwell = Dwell()
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0)] = 1800.0
    degauss: bool = True
    temperature: bool = True
    window: Annotated[int, Field(ge=13)] | None = None
    # On the ground it is 0.9957 g to 1.0028 g.
    local_gravity_g: Annotated[float, Unit("g"), Field(ge=0.99, le=1.01)] = 1.0
    local_gravity_uncertainty_g: Annotated[float, Unit("g"), Field(ge=0, le=0.01)] = 0.0
    ambient_field_mT: Annotated[float, Unit("mT"), Field(ge=0)] | None = None
    thresholds: Thresholds = Thresholds()

    @field_validator("planes")
    @classmethod
    def each_plane_once(cls, planes: tuple[Plane, ...]) -> tuple[Plane, ...]:
        """Refuse an empty list and a plane named twice."""
        if not planes or len(set(planes)) != len(planes):
            raise ValueError("name at least one of io, ip, op, level, each once")
        return planes

    @field_validator("lowest_field_mT")
    @classmethod
    def below_the_largest(cls, lowest_mT: float | None, info: ValidationInfo) -> float | None:
        """Refuse a range that begins at or beyond its end, or beyond the largest magnitude."""
        largest_mT = info.data.get("largest_field_mT")
        if lowest_mT is not None and largest_mT is not None and not abs(lowest_mT) <= largest_mT:
            raise ValueError(f"its magnitude may be {largest_mT:g} mT at most (largest_field)")
        if lowest_mT is not None and lowest_mT == largest_mT:
            raise ValueError("the range of the field is empty")
        if lowest_mT is not None and info.data.get("design") == "efficient":
            raise ValueError("the efficient design has the fields -B, 0 and +B; leave it out")
        return lowest_mT

    @field_validator("field_step_mT")
    @classmethod
    def whole_steps(cls, step_mT: float | None, info: ValidationInfo) -> float | None:
        """Require a step that divides the range, in the published design only."""
        largest_mT, design = info.data.get("largest_field_mT"), info.data.get("design")
        if design == "efficient":
            if step_mT is not None:
                raise ValueError("the efficient design has the fields -B, 0 and +B; leave it out")
            return None
        if step_mT is None or largest_mT is None:
            return step_mT
        steps = (largest_mT - (info.data.get("lowest_field_mT") or 0.0)) / step_mT
        if steps > MAX_STEPS:
            raise ValueError(f"the range of the field holds more than {MAX_STEPS} of it")
        if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
            raise ValueError(f"the range of the field holds {steps:.4g} of it, not a whole number")
        return step_mT

    @field_validator("fields_mT")
    @classmethod
    def distinct_fields(
        cls, fields_mT: tuple[float, ...] | None, info: ValidationInfo
    ) -> tuple[float, ...] | None:
        """Require fields or a step, each field once and within the largest."""
        if fields_mT is None:
            return None
        largest_mT = info.data.get("largest_field_mT")
        if info.data.get("design") == "efficient" or info.data.get("field_step_mT") is not None:
            raise ValueError("give either fields or field_step, and neither in an efficient design")
        _refuse_duplicates(fields_mT, "mT")
        if largest_mT is not None and max(abs(field) for field in fields_mT) > largest_mT:
            raise ValueError(f"no magnitude may be above {largest_mT:g} mT (largest_field)")
        return fields_mT

    @field_validator("angle_step_deg")
    @classmethod
    def divides_the_circle(cls, step_deg: float | None) -> float | None:
        """Refuse a step that does not divide the circle: the angle is changed evenly to 360 deg."""
        if step_deg is not None and abs(360.0 / step_deg - round(360.0 / step_deg)) > 1e-6:
            raise ValueError("must divide 360 deg into equal parts")
        if step_deg is not None and 360.0 / step_deg > MAX_STEPS:
            raise ValueError(f"divides 360 deg into more than {MAX_STEPS} parts")
        return step_deg

    @field_validator("angles_deg")
    @classmethod
    def distinct_angles(
        cls, angles_deg: tuple[float, ...] | None, info: ValidationInfo
    ) -> tuple[float, ...] | None:
        """Refuse angles beside a step, and an angle named twice (360 deg is 0 deg)."""
        if angles_deg is None:
            return None
        if info.data.get("angle_step_deg") is not None:
            raise ValueError("give either angles or angle_step")
        _refuse_duplicates([angle % 360.0 for angle in angles_deg], "deg")
        return angles_deg

    @field_validator("repeats")
    @classmethod
    def there_and_back(cls, repeats: int, info: ValidationInfo) -> int:
        """Require an even number of passes of a palindrome."""
        if info.data.get("order") == "palindrome" and repeats % 2:
            raise ValueError("a palindrome goes there and back: the number must be even")
        if info.data.keys() >= _BEFORE_REPEATS:
            once = cls.model_construct(None, **info.data)
            points = len(once.planes) * len(once.angle_levels_deg) * len(once.field_levels_mT)
            if points * repeats > MAX_POINTS:
                raise ValueError(
                    f"{points * repeats} points in all are too many; {MAX_POINTS} are the most"
                )
        return repeats

    @property
    def field_levels_mT(self) -> tuple[float, ...]:
        """The commanded fields at each angle, in the published order; five steps without a step."""
        if self.fields_mT is not None:
            return self.fields_mT
        if self.design == "efficient":
            return (-self.largest_field_mT, 0.0, self.largest_field_mT)
        lowest_mT = self.lowest_field_mT or 0.0
        span_mT = self.largest_field_mT - lowest_mT
        steps = 5 if self.field_step_mT is None else round(span_mT / self.field_step_mT)
        return tuple(round(lowest_mT + span_mT * n / steps, 9) for n in range(steps + 1))

    @property
    def angle_levels_deg(self) -> tuple[float, ...]:
        """The commanded angles of each plane, rising."""
        if self.angles_deg is not None:
            return self.angles_deg
        usual = EFFICIENT_ANGLE_STEP_DEG if self.design == "efficient" else PUBLISHED_ANGLE_STEP_DEG
        count = round(360.0 / (self.angle_step_deg or usual))
        return tuple(round(360.0 * n / count, 9) for n in range(count))

    @property
    def points(self) -> tuple[Point, ...]:
        """All units of work in the order in which they are measured, plane by plane."""
        return tuple(point for plane in self.planes for point in self._points_of(plane))

    def _points_of(self, plane: str) -> list[Point]:
        pairs = [(a, f) for a in self.angle_levels_deg for f in self.field_levels_mT]
        points: list[Point] = []
        for number in range(1, self.repeats + 1):
            turn = list(pairs)
            if self.order == "palindrome" and number % 2 == 0:
                turn.reverse()
            if self.order == "random":
                random.Random(f"{self.seed} {plane} {number}").shuffle(turn)
            points += [Point(plane, angle, field, number) for angle, field in turn]
        return points

    @property
    def point_noise_V(self) -> float:
        """The expected standard uncertainty of a point's mean, from noise alone."""
        return self.reading_noise_V / math.sqrt(self.readings)


def _refuse_duplicates(values: Sequence[float], unit: str) -> None:
    seen: set[float] = set()
    for value in values:
        if round(value, 9) in seen:
            raise ValueError(f"{value:g} {unit} stands twice; use repeats to measure it again")
        seen.add(round(value, 9))
    if not values:
        raise ValueError("must not be empty")
