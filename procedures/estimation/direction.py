"""Where an input axis points, and what of the earth's rate it feels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from procedures.common.constants import ARCMIN_PER_RAD, EARTH_RATE_DEG_PER_H, along_earths_axis
from station.findings import Estimate, Findings, Flag, InputQuantity, contradiction

from .readings import DEG_PER_H, Reading, Remainder, Suit, named, suiting

MIN_EARTH_DEG_PER_H = 1.0
"""An axis that is to feel less shows none of it, nor does one whose bias is as large."""
ZERO, REVERSED = 0.005, 0.04
"""Parts of the earth's rate within which a mean is none of it, or its opposite."""
SMALLER = {"mdeg/h": 1e-3, "arcsec/h": 1.0 / 3600.0, "udeg/h": 1e-6}
"""Units that a rate stated in deg/h may be in and that make it far too large."""


@dataclass(frozen=True)
class Direction:
    """Where a positive input axis points: clockwise from north, and above level."""

    azimuth_rad: float
    elevation_rad: float

    def earth_deg_per_h(self, latitude_rad: float) -> float:
        """Return the earth's rate along it."""
        return EARTH_RATE_DEG_PER_H * along_earths_axis(
            latitude_rad, self.azimuth_rad, self.elevation_rad
        )

    def sensitivities(self, latitude_rad: float) -> tuple[float, float]:
        """Return what the earth's rate gains, deg/h per rad of azimuth and of elevation."""
        a, e, north = self.azimuth_rad, self.elevation_rad, np.cos(latitude_rad)
        azimuth = -north * np.cos(e) * np.sin(a)
        elevation = -north * np.sin(e) * np.cos(a) + np.sin(latitude_rad) * np.cos(e)
        return float(EARTH_RATE_DEG_PER_H * azimuth), float(EARTH_RATE_DEG_PER_H * elevation)

    def by_latitude(self, latitude_rad: float) -> float:
        """Return what the earth's rate gains, deg/h per rad of latitude."""
        level = np.cos(self.elevation_rad) * np.cos(self.azimuth_rad)
        lost = -np.sin(latitude_rad) * level
        return float(
            EARTH_RATE_DEG_PER_H * (lost + np.cos(latitude_rad) * np.sin(self.elevation_rad))
        )


def earth_flags(
    axis: str,
    direction: Direction,
    latitude_rad: float,
    mean_deg_per_h: float,
    zero: float = ZERO,
    reverse: float = REVERSED,
) -> list[Flag]:
    """Return the flag of an output at rest that reads nothing of the earth, its opposite, or a
    multiple of it that another unit makes.

    `zero` and `reverse` are parts of the earth's rate within which the mean is one of these; NaN is
    no mean.
    """
    earth = direction.earth_deg_per_h(latitude_rad)
    if abs(earth) <= MIN_EARTH_DEG_PER_H or not np.isfinite(mean_deg_per_h):
        return []
    ratio = mean_deg_per_h / earth
    should = (
        f"{axis} reads {mean_deg_per_h:.4g} deg/h where it should feel {earth:.4g} deg/h of the "
        "earth"
    )

    def suits_in(factors: Mapping[str, float], noise: float) -> list[Suit[float]]:
        units = [
            Reading[float](f"the output is in {unit}", factor.__mul__, "unit")
            for unit, factor in factors.items()
        ]
        return suiting(
            mean_deg_per_h, [units], lambda rate: Remainder((rate - earth) ** 2, 1.0, noise)
        )

    if abs(ratio) < zero:
        suits = suits_in(DEG_PER_H, 0.0)
        likely = f"{should}: it fits if {named(suits)}." if suits else f"{should}."
        sentence = likely + (
            " Look at the unit of the output, whether the earth's rate was taken off before, and "
            "whether the gyro works; every result goes with the unit."
        )
    elif abs(ratio) > 1.0 and (suits := suits_in(SMALLER, (reverse * earth) ** 2)):
        sentence = (
            f"{should}: it fits if {named(suits)}. Look at the unit of the output; every result "
            "goes with it."
        )
    elif abs(ratio + 1.0) < reverse:
        sentence = (
            f"{should}: its sign is the other one. Look whether the input axis points as stated, "
            "and at the sign of the output; the bias goes with it."
        )
    else:
        return []
    return [contradiction("input_axis", sentence, axis, ratio=ratio)]


def attitude_inputs(
    directions: Mapping[str, Direction], u_arcmin: float, source: str
) -> Iterator[InputQuantity]:
    """Yield how well azimuth and elevation of each input axis are known, by its name."""
    for axis, direction in directions.items():
        for angle, value in (
            ("azimuth", direction.azimuth_rad),
            ("elevation", direction.elevation_rad),
        ):
            about = f"{angle} of {axis}"
            u_rad = u_arcmin / ARCMIN_PER_RAD
            name = f"{angle}_{axis}"
            yield InputQuantity.if_stated(name, about, u_rad, "rad", source, value=value)


LATITUDE = "latitude"


def latitude_input(latitude_rad: float, u_arcmin: float, source: str) -> InputQuantity:
    """Return the latitude, by which the earth's rate is taken off; `u_arcmin` is how well `source`
    says that it is known, 0 where it does not.
    """
    u_rad = u_arcmin / ARCMIN_PER_RAD
    return InputQuantity.if_stated(LATITUDE, LATITUDE, u_rad, "rad", source, value=latitude_rad)


def with_latitude(
    findings: Findings,
    directions: Mapping[str, Direction],
    latitude_rad: float,
    u_arcmin: float,
    source: str,
) -> Findings:
    """Return findings with the latitude as an input of the biases, which the earth's rate was taken
    off, as `latitude_input` has it.
    """
    given = latitude_input(latitude_rad, u_arcmin, source)

    def on_earth(estimate: Estimate) -> Estimate:
        direction = directions.get(estimate.axis or "")
        if estimate.name != "bias" or direction is None:
            return estimate
        taken = {LATITUDE: -direction.by_latitude(latitude_rad)}
        return replace(estimate, sensitivities={**estimate.sensitivities, **taken})

    estimates = [*map(on_earth, findings.estimates)]
    return replace(findings, estimates=estimates, inputs=[*findings.inputs, given])
