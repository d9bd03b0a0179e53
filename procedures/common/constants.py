"""Constants of nature and of units that procedures share; each stands here only."""

from __future__ import annotations

import math

EARTH_RATE_DEG_PER_H = 15.041
"""Against the stars, 15.041067 deg/h: what is left off is 5 ppm, 0.00007 deg/h at most."""
SECONDS_PER_HOUR = 3600.0
FULL_TURN_DEG = 360.0
ARCMIN_PER_RAD = 60.0 * 180.0 / math.pi
ARCSEC_PER_RAD = 3600.0 * 180.0 / math.pi


def along_earths_axis(latitude_rad: float, azimuth_rad: float, elevation_rad: float) -> float:
    """Return the cosine between an axis and that of the earth; azimuth is clockwise from north."""
    level = math.cos(latitude_rad) * math.cos(elevation_rad) * math.cos(azimuth_rad)
    return level + math.sin(latitude_rad) * math.sin(elevation_rad)
