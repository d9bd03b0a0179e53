"""What the analysis of a nine-axis sensor says: solutions, estimates, and the published rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.estimation.allan import AllanDeviation, NoiseCoefficients
from procedures.estimation.direction import LATITUDE
from station.findings import Analysis, Estimate, Published, undetermined

from .attitude import PAIRS, BiasSolution
from .dataset import AXES, Array, Mask, NineAxisDataset, Prior, StaticRecord, TurnRecord
from .pose import EAST_AXIS, Pose
from .scale import ScaleSolution, Value
from .turning import AxisMeans

if TYPE_CHECKING:
    from .all_axes.inertial import Inertial
    from .all_axes.results import OtherResults

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
    where unknown. `noise` is what the static records of each gyro show. `others` is what the other
    six axes come to, None where nothing of them was recorded.
    """

    static: tuple[StaticSummary, ...]
    bias: BiasSolution | None
    axes: Mapping[int, ScaleSolution | None]
    means: Mapping[int, AxisMeans]
    gain: Array
    gain_u: Array
    noise: tuple[NoiseCoefficients | None, ...]
    others: OtherResults | None = None


def bias_estimates(bias: BiasSolution | None, freedom: Array, wider: float) -> list[Estimate]:
    """Return the biases; `wider` scales their uncertainties where the means contradict another.

    What each prior adds is a sensitivity in units of that prior's own standard uncertainty.
    """
    estimates = []
    for axis, name in enumerate(AXES):
        if bias is None:
            estimates.append(undetermined(BIAS, name, UNITS[BIAS], "weighted"))
            continue
        degrees = float(freedom[axis]) if wider == 1.0 else float(bias.degrees_of_freedom)
        estimates.append(
            Estimate(
                BIAS,
                name,
                float(bias.bias[axis]),
                UNITS[BIAS],
                wider * float(bias.noise_u[axis]),
                degrees,
                "weighted",
                {f"prior_{part}": wider * float(u[axis]) for part, u in bias.parts.items()}
                | {LATITUDE: float(bias.by_latitude[axis])},
            )
        )
    return estimates


def scale_estimates(
    axes: Mapping[int, ScaleSolution | None],
    means: Mapping[int, AxisMeans],
    prior: Prior,
    inertial: Inertial | None = None,
) -> list[Estimate]:
    """Return all results of the turned axes, name by name.

    Where the accelerometers say how each axis was turned, a scale factor is that about the gyro's
    own axis; else about the table's.
    """
    estimates = [
        _scale(axis, solution, means[axis], inertial.seen_about(axis) if inertial else (1.0, 0.0))
        for axis, solution in axes.items()
    ]
    for name in (ASYMMETRY, NONLINEARITY):
        for axis, solution in axes.items():
            value = None if solution is None else getattr(solution, name)
            extra = _rates(solution) if name == NONLINEARITY and solution is not None else {}
            method = "least-squares" if name == ASYMMETRY else _method(solution)
            estimates.append(_relative(name, axis, value, solution, method, extra))
    estimates += [_misalignment(axes, *pair, prior) for pair in PAIRS if pair[1] in axes]
    return estimates


def _scale(
    axis: int,
    solution: ScaleSolution | None,
    means: AxisMeans,
    seen: tuple[float, float],
) -> Estimate:
    if solution is None:
        return undetermined(SCALE_FACTOR, AXES[axis], UNITS[SCALE_FACTOR], "weighted")
    scale = solution.scale_factor
    share, share_u = seen
    value = scale.value / share
    return Estimate(
        SCALE_FACTOR,
        AXES[axis],
        value,
        UNITS[SCALE_FACTOR],
        float(np.hypot(scale.standard_uncertainty / share, value * share_u)),
        solution.degrees_of_freedom,
        _method(solution),
        {"time_scale": value, "encoder_angle_deg": _by_angle(solution, means)},
    )


def _by_angle(solution: ScaleSolution, means: AxisMeans) -> float:
    """Return the derivative of K by an error of the encoder's angle at one end of each record.

    Over whole turns both ends are the same mark of the encoder, and its error drops out.
    """
    total = 0.0
    for rate, weight in zip(solution.commanded, solution.weights, strict=True):
        own = np.isclose(np.abs(means.commanded), rate) & (means.turns > 0.0)
        part = own & means.part
        if bool(part.any()):
            shortest = 360.0 * float(means.turns[part].min())
            total += (float(weight) * solution.scale_factor.value / shortest) ** 2
    return float(np.sqrt(total))


def _method(solution: ScaleSolution | None) -> str:
    return "weighted" if solution is None or solution.agree else "mean"


def _relative(
    name: str,
    axis: int,
    value: Value | None,
    solution: ScaleSolution | None,
    method: str,
    extra: Mapping[str, object],
) -> Estimate:
    if value is None or solution is None:
        return undetermined(name, AXES[axis], UNITS[name], method)
    return Estimate(
        name,
        AXES[axis],
        PPM * value.value,
        UNITS[name],
        PPM * value.standard_uncertainty,
        solution.degrees_of_freedom,
        method,
        extra=extra,
    )


def _rates(solution: ScaleSolution) -> dict[str, object]:
    """Return the deviation of each rate's K from K, for the result document."""
    table = zip(solution.commanded, solution.deviation, solution.deviation_u, strict=True)
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
    solution, own = axes[axis], axes.get(gyro)
    if solution is None or gyro not in solution.cross:
        return undetermined(MISALIGNMENT, name, UNITS[MISALIGNMENT], "weighted", frame)
    scale = own.scale_factor.value if own is not None else 1.0
    value = solution.cross[gyro]
    return Estimate(
        MISALIGNMENT,
        name,
        ARCSEC_PER_RAD * value.value / scale,
        UNITS[MISALIGNMENT],
        ARCSEC_PER_RAD * value.standard_uncertainty / abs(scale),
        solution.degrees_of_freedom,
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
    values = [
        *((BIAS, axis, _published_bias(dataset.static, axis)) for axis in range(len(AXES))),
        *((SCALE_FACTOR, axis, _published_scale(dataset.turns, axis)) for axis in turned),
    ]
    return tuple(
        Published(name, AXES[axis], value, UNITS[name], "mean") for name, axis, value in values
    )


def _published_bias(records: Sequence[StaticRecord], axis: int) -> float | None:
    samples = [
        record.rate_deg_per_h[:, axis]
        for record in records
        if EAST_AXIS.get(record.position) == axis
    ]
    return _mean_of_all(samples)


def _published_scale(records: Sequence[TurnRecord], axis: int) -> float | None:
    own = [record for record in records if record.axis == axis]
    factors = []
    for rate in sorted({abs(record.commanded_deg_per_s) for record in own}):
        senses = [
            _mean_of_all(
                [r.rate_deg_per_s[:, axis] for r in own if r.commanded_deg_per_s == sense * rate]
            )
            for sense in (1.0, -1.0)
        ]
        if senses[0] is not None and senses[1] is not None:
            factors.append((senses[0] - senses[1]) / (2.0 * rate))
    return float(np.mean(factors)) if factors else None


def _mean_of_all(samples: Sequence[np.ndarray]) -> float | None:
    together = np.concatenate(samples) if samples else np.empty(0)
    together = together[np.isfinite(together)]
    return float(together.mean()) if len(together) else None
