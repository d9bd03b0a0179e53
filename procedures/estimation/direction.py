"""Where an input axis points, and what of the earth's rate it feels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from procedures.common.constants import ARCMIN_PER_RAD, EARTH_RATE_DEG_PER_H
from station.findings import InputQuantity


@dataclass(frozen=True)
class Direction:
    """Where a positive input axis points: clockwise from north, and above level."""

    azimuth_rad: float
    elevation_rad: float

    def earth_deg_per_h(self, latitude_rad: float) -> float:
        """Return the earth's rate along it."""
        level = np.cos(latitude_rad) * np.cos(self.elevation_rad) * np.cos(self.azimuth_rad)
        return float(
            EARTH_RATE_DEG_PER_H * (level + np.sin(latitude_rad) * np.sin(self.elevation_rad))
        )

    def sensitivities(self, latitude_rad: float) -> tuple[float, float]:
        """Return what the earth's rate gains, deg/h per rad of azimuth and of elevation."""
        a, e, north = self.azimuth_rad, self.elevation_rad, np.cos(latitude_rad)
        azimuth = -north * np.cos(e) * np.sin(a)
        elevation = -north * np.sin(e) * np.cos(a) + np.sin(latitude_rad) * np.cos(e)
        return float(EARTH_RATE_DEG_PER_H * azimuth), float(EARTH_RATE_DEG_PER_H * elevation)


def attitude_inputs(
    directions: Iterable[str], u_arcmin: float, source: str
) -> Iterator[InputQuantity]:
    """Yield how well azimuth and elevation of each input axis are known, by its name."""
    if u_arcmin <= 0.0:
        return
    for axis in directions:
        for angle in ("azimuth", "elevation"):
            about = f"{angle} of {axis}, {u_arcmin:g} arcmin"
            u_rad = u_arcmin / ARCMIN_PER_RAD
            yield InputQuantity(f"{angle}_{axis}", about, u_rad, "rad", source)
