"""Platinum thermometers: the temperature of a resistance, and a resistance that none has.

By the Callendar-Van Dusen equation with the coefficients of IEC 60751:2008 (5.1), -200 degC to
850 degC.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from station.fields import Unit

A, B, C = 3.9083e-3, -5.775e-7, -4.183e-12
COLDEST_DEGC, HOTTEST_DEGC = -200.0, 850.0
NEWTON_STEPS = 6
HIGHEST_R0_OHM = 1e4
WIRES = "check the four wires of the Pt100 and its plug"
R0 = Annotated[
    float,
    Unit("ohm"),
    Field(gt=0, le=HIGHEST_R0_OHM, description="resistance of the sensor at 0 degC"),
]


def resistance_ohm(at_degC: float, r0_ohm: float) -> float:
    """Return the resistance of a platinum thermometer in ohm (IEC 60751, equations 1 and 2)."""
    cold = C * (at_degC - 100.0) * at_degC**3 if at_degC < 0 else 0.0
    return r0_ohm * (1.0 + A * at_degC + B * at_degC**2 + cold)


def temperature_degC(ohms: NDArray[np.float64], r0_ohm: float) -> NDArray[np.float64]:
    """Return temperatures in degC, shape as `ohms`.

    From 0 degC up the quadratic is solved; below, Newton's method starts from its solution there
    and is exact to rounding after a few steps.
    """
    ratio = np.asarray(ohms, dtype=np.float64) / r0_ohm
    root = np.sqrt(np.maximum(A**2 - 4.0 * B * (1.0 - ratio), 0.0))
    result = 2.0 * (ratio - 1.0) / (A + root)  # this form loses no digits near 0 degC
    cold = ratio < 1.0
    t = result[cold]
    for _ in range(NEWTON_STEPS):
        off = 1.0 + A * t + B * t**2 + C * (t - 100.0) * t**3 - ratio[cold]
        t = t - off / (A + 2.0 * B * t + C * (4.0 * t**3 - 300.0 * t**2))
    result[cold] = t
    return result


def impossible(ohms: NDArray[np.float64], r0_ohm: float) -> str | None:
    """Return what is wrong with the first resistance that no platinum thermometer has."""
    coldest, hottest = (resistance_ohm(end, r0_ohm) for end in (COLDEST_DEGC, HOTTEST_DEGC))
    beyond = ohms[(ohms < coldest) | (ohms > hottest)]
    if not len(beyond):
        return None
    return (
        f"{beyond[0]:.6g} ohm came back, which with r0 = {r0_ohm:g} ohm is outside "
        f"{COLDEST_DEGC:g} degC to {HOTTEST_DEGC:g} degC"
    )
