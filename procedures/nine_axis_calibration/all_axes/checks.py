"""What the reader must know of the other six axes: what the data contradict, and what cannot be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from procedures.estimation.flags import not_identifiable
from procedures.estimation.plausibility import Bounds
from procedures.estimation.plausibility import implausible as beyond
from station.findings import Estimate, Flag, contradiction

from .inertial import Inertial
from .magnetic import Magnetic
from .stands import OtherAxes

PLATFORM_AXES = ("north", "west", "up")
"""Of a field fixed to what turns, at the encoder's zero."""
MAX_FROM_ONE = {"accelerometer": 0.05, "magnetometer": 0.2}
"""Soft iron takes a magnetometer by 5 %; no sensor leaves its maker with more than these."""
ONE_SIGN_DEG = 25.0
"""Farther from the equator the earth's field points down in the north, up in the south."""


def not_determined(estimates: Sequence[Estimate]) -> Iterator[Flag]:
    """Yield the flag of the results without a value, if there are any."""
    names = list(dict.fromkeys(estimate.name for estimate in estimates if estimate.value is None))
    if names:
        listed = ", ".join(name.replace("_", " ") for name in names)
        message = (
            f"Not determined by the directions in which the sensor stood: {listed}. Accelerometers "
            "need directions that face down, their second order more than the six faces."
        )
        yield not_identifiable(message, names)


def doubts(
    inertial: Inertial | None, magnetic: Magnetic | None, *, in_coil: bool
) -> Iterator[Flag]:
    """Yield what the data contradict of each other."""
    if inertial is not None and inertial.wider > 1.0:
        message = (
            "The accelerometers' means disagree by more than their noise and the priors of the "
            f"set-up explain; their uncertainties are {inertial.wider:.2g} times as large for it. "
            "Look for a stand that leans, or that was moved."
        )
        yield Flag("poses-disagree", message, None, {"ratio": inertial.wider})
    if magnetic is None:
        return
    if magnetic.relative and not in_coil:
        message = (
            "The earth's field is not stated: the magnetometer's scale factors have mean one by "
            "convention, and are relative to each other only. Give `earth_field`."
        )
        yield Flag("scale-by-convention", message)
    if magnetic.disturbed:
        size_nT = float(np.linalg.norm(magnetic.platform_nT))
        stands = " The stands at rest deny it and are left out." if magnetic.stands_left_out else ""
        message = (
            f"A field of {size_nT:.3g} nT is fixed to what turns, and no part of the earth's: it "
            f"is solved for, and in the uncertainties.{stands} Look for iron on the table and in "
            "the fixture, and mount the sensor on something that is not magnetic."
        )
        parts = zip(PLATFORM_AXES, magnetic.platform_nT, strict=True)
        details: dict[str, object] = {"field_nT": size_nT}
        details |= {f"{axis}_nT": float(value) for axis, value in parts}
        yield Flag("field-disturbed", message, None, details)
    if magnetic.wander_nT > 0.0:
        message = (
            f"The field differs from record to record by {magnetic.wander_nT:.2g} nT, more than "
            "the magnetometer's noise; each record counts as that uncertain. Look for iron or "
            "currents near the bench, and for a field that goes with the table's motor."
        )
        yield Flag("field-wanders", message, None, {"wander_nT": magnetic.wander_nT})


def implausible(estimates: Sequence[Estimate]) -> Iterator[Flag]:
    """Yield a flag for each sensor whose scale factors deny the unit, sign or axis of an output."""
    for sensor, most in MAX_FROM_ONE.items():
        values = ", ".join(
            f"{estimate.axis} {estimate.value:.4g}"
            for estimate in estimates
            if estimate.name == f"{sensor}_scale_factor"
            and estimate.value is not None
            and abs(estimate.value - 1.0) > most
        )
        if values:
            message = (
                f"The {sensor} answers {values} times what is there: its unit, its sign or the "
                "order of its axes is not as stated. Look at the columns and at how the sensor "
                "stood."
            )
            yield contradiction("unit", message, sensor=sensor)


def other_hemisphere(data: OtherAxes, magnetic: Magnetic | None) -> Iterator[Flag]:
    """Yield a flag where the field points up in the north, or down in the south."""
    if magnetic is None or magnetic.disturbed or not magnetic.knows_offset:
        return
    if abs(data.latitude_deg) > ONE_SIGN_DEG:
        low, high = (0.0, 90.0) if data.latitude_deg > 0.0 else (-90.0, 0.0)
        name = f"The field's inclination at {data.latitude_deg:.3g} deg of latitude"
        look = "Look at the signs of the magnetometer's columns, and at that of the latitude."
        bounds = Bounds("unit", name, low, high, "deg", look)
        yield from beyond(magnetic.inclination_deg, bounds)
