"""Means of soaks, as the standard's formula takes them.

Bt = max |B(Ti) - B(Tref)| / |Ti - Tref| over the soaks; B(Tref) is the mean of the soak nearest to
the reference temperature.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from station.findings import Published

from .dataset import Array
from .soaks import Soak
from .units import UNITS

METHOD = "soak-means"
NEAR_DEGC = 10.0
APART_DEGC = 5.0


def published_values(
    axis: str, rate: Array, soaks: Sequence[Soak], reference_degC: float
) -> list[Published]:
    """Return the soak means' bias and sensitivity; `rate` (n,) in deg/h without the earth's."""
    values: dict[str, float | None] = {"bias": None, "bias_temperature_sensitivity": None}
    means = [(soak.temperature_degC, float(np.nanmean(rate[soak.rows]))) for soak in soaks]
    if means:
        at, bias = min(means, key=lambda mean: abs(mean[0] - reference_degC))
        if abs(at - reference_degC) <= NEAR_DEGC:
            values["bias"] = bias
            slopes = [
                abs(other - bias) / abs(there - at)
                for there, other in means
                if abs(there - at) >= APART_DEGC
            ]
            values["bias_temperature_sensitivity"] = max(slopes, default=None)
    return [Published(name, axis, value, UNITS[name], METHOD) for name, value in values.items()]
