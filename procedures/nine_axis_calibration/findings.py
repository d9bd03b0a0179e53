"""What the analysis of a nine-axis sensor says: solutions, estimates, and the published rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procedures.estimation.allan import AllanDeviation, NoiseCoefficients
from station.findings import Analysis, Estimate, Published, undetermined

from .attitude import PAIRS, BiasSolution
from .dataset import AXES, Array, Mask, NineAxisDataset, Prior, StaticRecord, TurnRecord
from .pose import EAST_AXIS, Pose
from .scale import ScaleSolution, Value
from .turning import AxisMeans

BIAS, SCALE_FACTOR, ASYMMETRY = "bias", "scale_factor", "asymmetry"
NONLINEARITY, MISALIGNMENT = "nonlinearity", "misalignment"
FRAME = "mounting"
"""What misalignments are angles to: the table's axes, as the sensor was mounted between them."""
UNITS = {
    BIAS: "deg/h",
    SCALE_FACTOR: "1",
    ASYMMETRY: "ppm",
    NONLINEARITY: "ppm",
    MISALIGNMENT: "arcsec",
}
PPM = 1e6
ARCSEC_PER_RAD = 180.0 * 3600.0 / np.pi


@dataclass(frozen=True)
class StaticSummary:
    """One static record: means in deg/h and g with their u, (3,) each, and how it was judged.

    `kept` (n, 3) are the gyro samples in the means; `allan` and `noise` are those of each gyro.
    """

    position: int
    gyro: Array
    gyro_u: Array
    accelerometer: Array
    accelerometer_u: Array
    pose: Pose
    kept: Mask
    allan: tuple[AllanDeviation, ...]


@dataclass(frozen=True)
class NineAxisAnalysis(Analysis):
    """The whole outcome.

    Sensitivities of the estimates are derivatives by the inputs of type B, the priors among them.
    `axes` are the solutions of the turned axes by number, None where a turned axis could not be
    solved; `gain` (3, 3) is the output of gyro j per rate about axis i in [j, i] with its u, NaN
    where unknown. `noise` is what the static records of each gyro show.
    """

    static: tuple[StaticSummary, ...]
    bias: BiasSolution | None
    axes: Mapping[int, ScaleSolution | None]
    means: Mapping[int, AxisMeans]
    gain: Array
    gain_u: Array
    noise: tuple[NoiseCoefficients | None, ...]


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
    lean is whole in it, one for one, and no record can separate it from the sensor's own.
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


def published_values(dataset: NineAxisDataset, turned: Sequence[int]) -> tuple[Published, ...]:
    """Return bias and scale factor of each axis by the published rules, on the data as they are.

    b is the mean of the axis that faces east; K = (1/N) sum (w+ - w-)/(2 w) with the nominal rates
    w, over those that were turned in both senses. None where there is nothing to take a mean of.
    """
    found = [
        *((BIAS, axis, _published_bias(dataset.static, axis)) for axis in range(len(AXES))),
        *((SCALE_FACTOR, axis, _published_scale(dataset.turns, axis)) for axis in turned),
    ]
    return tuple(Published(name, AXES[axis], one, UNITS[name], "mean") for name, axis, one in found)


def _published_bias(records: Sequence[StaticRecord], axis: int) -> float | None:
    samples = [
        one.rate_deg_per_h[:, axis] for one in records if EAST_AXIS.get(one.position) == axis
    ]
    return _mean_of_all(samples)


def _published_scale(records: Sequence[TurnRecord], axis: int) -> float | None:
    own = [one for one in records if one.axis == axis]
    found = []
    for rate in sorted({abs(one.commanded_deg_per_s) for one in own}):
        senses = [
            _mean_of_all(
                [r.rate_deg_per_s[:, axis] for r in own if r.commanded_deg_per_s == sense * rate]
            )
            for sense in (1.0, -1.0)
        ]
        if senses[0] is not None and senses[1] is not None:
            found.append((senses[0] - senses[1]) / (2.0 * rate))
    return float(np.mean(found)) if found else None


def _mean_of_all(samples: Sequence[np.ndarray]) -> float | None:
    together = np.concatenate(samples) if samples else np.empty(0)
    together = together[np.isfinite(together)]
    return float(together.mean()) if len(together) else None
