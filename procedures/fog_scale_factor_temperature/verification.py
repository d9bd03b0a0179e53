"""Step 4, first half: turn errors of another ramp, before and after compensation.

Compensation divides: a true rate is the measured one over 1 + delta(T). Multiplied instead, an
error of 500 ppm becomes one of 1000.
"""

from __future__ import annotations

import numpy as np

from .axis_turns import AxisTurns, is_paired
from .curve import Curve
from .dataset import Array
from .findings import AxisFit, Verified
from .sets import sets_that_tell_the_bias
from .turning import PPM

OUTSIDE_DEGC = 1.0
FEWEST = 6
CALM = 0.95
DISAGREES = 2.0
"""Rms over its uncertainty. Ramps in other directions differ by the lag of a thermometer, too."""


def verify_axis(
    turns: AxisTurns, fit: AxisFit, gyro_bias_deg_per_h: float = 0.0
) -> Verified | None:
    """Return the errors of an axis' verification turns; None without turns or without a model.

    In a set with turns of both senses, or with a wait, the bias is taken off; among such sets a
    turn that stands alone, with its bias, proves nothing and is left out. Outside the calibrated
    range the model is held at its ends, as the compensation does.
    """
    curve = fit.curve
    if curve is None:
        return None
    told = _set_by_set(turns, curve, fit.noise_ppm)
    sensing = turns.usable & turns.sensing
    if is_paired(turns):
        sensing &= told[-1] == 0.0
    if not bool(sensing.any()):
        return None
    left, own_u, own_bias = (one[sensing] for one in told)
    heat = turns.temperature_degC[sensing]
    before = left + curve.error_ppm(heat)
    after = compensated_ppm(curve, heat, before)
    low, high = curve.domain_degC
    outside = (heat < low - OUTSIDE_DEGC) | (heat > high + OUTSIDE_DEGC)
    u = np.hypot(own_u, curve.standard_uncertainty_ppm(heat))
    by_bias = own_bias - curve.error_by_bias_ppm(heat)
    explained = np.hypot(np.hypot(u, curve.check_ppm(heat)), by_bias * gyro_bias_deg_per_h)
    return Verified(
        turns.axis,
        heat,
        before,
        after,
        u,
        by_bias,
        int(np.argmax(np.abs(after))),
        int(outside.sum()),
        _beyond_ppm(after[~outside], explained[~outside]),
    )


def _beyond_ppm(after: Array, explained: Array) -> float:
    """Return the rms that the uncertainties do not explain; zero where it may be chance.

    The wild turns of a ramp are none of the curve's: the largest twentieth does not count.
    """
    if len(after) < FEWEST or not bool(np.all(explained > 0.0)):
        return 0.0
    calm = np.argsort(np.abs(after / explained))[: int(np.ceil(CALM * len(after)))]
    square, usual = float(np.mean(after[calm] ** 2)), float(np.mean(explained[calm] ** 2))
    if square <= (DISAGREES**2) * usual:
        return 0.0
    return float(np.sqrt(square - usual))


def compensated_ppm(curve: Curve, temperature_degC: Array, error_ppm: Array) -> Array:
    """Return what compensation leaves of scale-factor errors, in ppm."""
    model = 1.0 + curve.error_ppm(temperature_degC) / PPM
    return np.asarray(((1.0 + error_ppm / PPM) / model - 1.0) * PPM)


def _set_by_set(
    turns: AxisTurns, curve: Curve, noise_ppm: float | None
) -> tuple[Array, Array, Array]:
    """Return what the curve leaves of each turn's scale-factor error, and what that depends on.

    That is its uncertainty, and what 1 deg/h of bias adds. The curve is taken off first: the turns
    of a set have not quite the same temperature.
    """
    left, u, by_bias = (np.full(len(turns.rows), np.nan) for _ in range(3))
    noise = noise_ppm or 0.0
    data = turns.data_ppm - turns.turns * curve.error_ppm(turns.temperature_degC)
    alone = turns.usable & turns.sensing
    scale = turns.turns[alone]
    left[alone] = data[alone] / scale
    u[alone], by_bias[alone] = noise / np.abs(scale), turns.by_bias_ppm[alone] / scale
    for one in sets_that_tell_the_bias(turns, turns.usable, data):
        left[one.rows], u[one.rows], by_bias[one.rows] = one.error_ppm, noise * one.u, 0.0
    return left, u, by_bias
