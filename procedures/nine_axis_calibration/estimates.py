"""From solutions to results: one entry for every name and axis that the dataset concerns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from procedures.nine_axis_calibration.attitude import PAIRS, BiasSolution
from procedures.nine_axis_calibration.dataset import AXES, Prior
from procedures.nine_axis_calibration.findings import (
    ASYMMETRY,
    BIAS,
    FRAME,
    MISALIGNMENT,
    NONLINEARITY,
    SCALE_FACTOR,
    UNITS,
)
from procedures.nine_axis_calibration.scale import ScaleSolution, Value
from procedures.nine_axis_calibration.turning import AxisMeans
from station.findings import Estimate, undetermined

Array = NDArray[np.float64]

PPM = 1e6
ARCSEC_PER_RAD = 180.0 * 3600.0 / np.pi


def bias_estimates(bias: BiasSolution | None, freedom: Array, wider: float) -> list[Estimate]:
    """Return the biases; `wider` scales their uncertainties where the means contradict another.

    What each prior adds is a sensitivity in units of that prior's own standard uncertainty.
    """
    found = []
    for axis, name in enumerate(AXES):
        if bias is None:
            found.append(undetermined(BIAS, name, UNITS[BIAS], "weighted"))
            continue
        degrees = float(freedom[axis]) if wider == 1.0 else float(bias.degrees_of_freedom)
        found.append(
            Estimate(
                BIAS,
                name,
                float(bias.bias[axis]),
                UNITS[BIAS],
                wider * float(bias.noise_u[axis]),
                degrees,
                "weighted",
                {f"prior_{part}": wider * float(u[axis]) for part, u in bias.parts.items()},
            )
        )
    return found


def scale_estimates(
    axes: Mapping[int, ScaleSolution | None], means: Mapping[int, AxisMeans], prior: Prior
) -> list[Estimate]:
    """Return all results of the turned axes, name by name."""
    found = [_scale(axis, one, means[axis]) for axis, one in axes.items()]
    for name in (ASYMMETRY, NONLINEARITY):
        for axis, one in axes.items():
            value = None if one is None else getattr(one, name)
            extra = _rates(one) if name == NONLINEARITY and one is not None else {}
            method = "least-squares" if name == ASYMMETRY else _method(one)
            found.append(_relative(name, axis, value, one, method, extra))
    found += [_misalignment(axes, *pair, prior) for pair in PAIRS if pair[1] in axes]
    return found


def _scale(axis: int, one: ScaleSolution | None, means: AxisMeans) -> Estimate:
    if one is None:
        return undetermined(SCALE_FACTOR, AXES[axis], UNITS[SCALE_FACTOR], "weighted")
    scale = one.scale_factor
    return Estimate(
        SCALE_FACTOR,
        AXES[axis],
        scale.value,
        UNITS[SCALE_FACTOR],
        scale.standard_uncertainty,
        one.degrees_of_freedom,
        _method(one),
        {"time_scale": scale.value, "encoder_angle_deg": _by_angle(one, means)},
    )


def _by_angle(one: ScaleSolution, means: AxisMeans) -> float:
    """Return the derivative of K by an error of the encoder's angle at one end of each record.

    Over whole turns both ends are the same mark of the encoder, and its error drops out.
    """
    total = 0.0
    for rate, weight in zip(one.commanded, one.weights, strict=True):
        own = np.isclose(np.abs(means.commanded), rate) & (means.turns > 0.0)
        part = own & means.part
        if bool(part.any()):
            shortest = 360.0 * float(means.turns[part].min())
            total += (float(weight) * one.scale_factor.value / shortest) ** 2
    return float(np.sqrt(total))


def _method(one: ScaleSolution | None) -> str:
    return "weighted" if one is None or one.agree else "mean"


def _relative(
    name: str,
    axis: int,
    value: Value | None,
    one: ScaleSolution | None,
    method: str,
    extra: Mapping[str, object],
) -> Estimate:
    if value is None or one is None:
        return undetermined(name, AXES[axis], UNITS[name], method)
    return Estimate(
        name,
        AXES[axis],
        PPM * value.value,
        UNITS[name],
        PPM * value.standard_uncertainty,
        one.degrees_of_freedom,
        method,
        extra=extra,
    )


def _rates(one: ScaleSolution) -> dict[str, object]:
    """Return the deviation of each rate's K from K, for the result document."""
    table = zip(one.commanded, one.deviation, one.deviation_u, strict=True)
    return {
        "rates": [
            {
                "rate_deg_per_s": float(rate),
                "deviation_ppm": PPM * float(value),
                "standard_uncertainty_ppm": PPM * float(u),
            }
            for rate, value, u in table
        ]
    }


def _misalignment(
    axes: Mapping[int, ScaleSolution | None], gyro: int, axis: int, prior: Prior
) -> Estimate:
    """Return what a gyro reads of another axis' rate, over its own scale factor, as an angle.

    It is the angle to the table's axis as the sensor was mounted on it: what mounting and table
    lean is whole in it, one for one, and no record can tell it from the sensor's own.
    """
    frame = {"frame": FRAME}
    name = AXES[gyro] + AXES[axis]
    one, own = axes[axis], axes.get(gyro)
    if one is None or gyro not in one.cross:
        return undetermined(MISALIGNMENT, name, UNITS[MISALIGNMENT], "weighted", frame)
    scale = own.scale_factor.value if own is not None else 1.0
    value = one.cross[gyro]
    return Estimate(
        MISALIGNMENT,
        name,
        ARCSEC_PER_RAD * value.value / scale,
        UNITS[MISALIGNMENT],
        ARCSEC_PER_RAD * value.standard_uncertainty / abs(scale),
        one.degrees_of_freedom,
        "weighted",
        {
            "prior_mounting": ARCSEC_PER_RAD * prior.mounting_rad,
            "prior_table_axes": ARCSEC_PER_RAD * prior.table_axes_rad,
        },
        frame,
    )
