"""The parameters of a plan for a gyro on a rate table."""

from __future__ import annotations

UNITS = {
    "scale_factor": "1",
    "nonlinearity": "ppm",
    "nonlinearity_of_full_scale": "ppm",
    "asymmetry": "ppm",
    "scale_factor_repeatability": "ppm",
    "bias": "deg/h",
}
