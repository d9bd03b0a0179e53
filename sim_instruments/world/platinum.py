"""Platinum thermometers (IEC 60751): the resistance of each temperature, and back."""

from __future__ import annotations

from functools import cache

import numpy as np

from sim_instruments.world.piecewise import Array

COEFFICIENTS = (3.9083e-3, -5.775e-7, -4.183e-12)
TABLE_DEGC = (-200.0, 850.0, 21001)


def platinum_ohm(r0_ohm: float, temperature_degC: Array) -> Array:
    """Return the resistance of a thermometer that has `r0_ohm` at 0 degC, at each temperature."""
    a, b, c = COEFFICIENTS
    t = temperature_degC
    below = np.where(t < 0.0, c * (t - 100.0) * t**3, 0.0)
    return np.asarray(r0_ohm * (1.0 + a * t + b * t**2 + below))


def platinum_degC(r0_ohm: float, resistance_ohm: Array) -> Array:
    """Return the temperature of each resistance, to within 0.1 uK."""
    degC, of_one = _table()
    return np.interp(resistance_ohm / r0_ohm, of_one, degC)


@cache
def _table() -> tuple[Array, Array]:
    degC = np.linspace(*TABLE_DEGC)
    return degC, platinum_ohm(1.0, degC)
