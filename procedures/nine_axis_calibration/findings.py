"""What the analysis of a nine-axis sensor says: solutions, estimates, and the published rules."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.common.constants import ARCSEC_PER_RAD
from procedures.estimation.allan import AllanDeviation, NoiseCoefficients
from procedures.estimation.direction import LATITUDE
from station.findings import Analysis, Estimate, Published, undetermined

from .attitude import PAIRS, BiasSolution
from .dataset import AXES, Array, Mask, NineAxisDataset, Prior, TurnRecord
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
    where unknown. `noise` is what the static records of each gyro show, `wander` (3,) how its bias
    wanders at rest and `rounding` (3,) what its steps add to a mean there, in deg/h. `wider` is by
    how much the means at rest contradict each other, 1 where they do not. `others` is what the
    other six axes come to, None where nothing of them was recorded.
    """

    static: tuple[StaticSummary, ...]
    bias: BiasSolution | None
    axes: Mapping[int, ScaleSolution | None]
    means: Mapping[int, AxisMeans]
    gain: Array
    gain_u: Array
    noise: tuple[NoiseCoefficients | None, ...]
    wander: Array
    rounding: Array
    wider: float
    others: OtherResults | None = None


def bias_estimates(bias: BiasSolution | None, freedom: Array, wider: float) -> list[Estimate]:
    """Return the biases; `wider` scales their uncertainties where the means contradict another.

    What each prior adds is a sensitivity in units of that prior's own standard uncertainty.
    """
    if bias is None:
        return [undetermined(BIAS, name, UNITS[BIAS], "weighted") for name in AXES]
    return [
        Estimate(
            BIAS,
            name,
            float(bias.bias[axis]),
            UNITS[BIAS],
            wider * float(bias.noise_u[axis]),
            float(freedom[axis]) if wider == 1.0 else float(bias.degrees_of_freedom),
            "weighted",
            {f"prior_{part}": wider * float(u[axis]) for part, u in bias.parts.items()}
            | {LATITUDE: float(bias.by_latitude[axis])},
        )
        for axis, name in enumerate(AXES)
    ]


def scale_estimates(
    axes: Mapping[int, ScaleSolution | None],
    means: Mapping[int, AxisMeans],
    prior: Prior,
    inertial: Inertial | None = None,
) -> list[Estimate]:
    """Return all results of the turned axes, name by name.

    Where the accelerometers say how each axis was turned, a scale factor is that about the gyro's
    own axis; else about the table's. A misalignment is the angle to the table's axis as the sensor
    was mounted on it: what mounting and table lean is whole in it, one for one, and no record can
    separate it from the sensor's own.
    """
    methods = {
        axis: "weighted" if solution is None or solution.agree else "mean"
        for axis, solution in axes.items()
    }
    estimates = []
    for axis, solution in axes.items():
        value, by = None, {}
        if solution is not None:
            share, share_u = inertial.seen_about(axis) if inertial else (1.0, 0.0)
            scale = solution.scale_factor.value / share
            noise = solution.scale_factor.standard_uncertainty / share
            value = Value(scale, float(np.hypot(noise, scale * share_u)))
            by = {"time_scale": scale, "encoder_angle_deg": _by_angle(solution, means[axis])}
        estimates.append(
            _estimate(SCALE_FACTOR, AXES[axis], value, solution, methods[axis], 1.0, by)
        )
    for axis, solution in axes.items():
        value = solution.asymmetry if solution is not None else None
        estimates.append(_estimate(ASYMMETRY, AXES[axis], value, solution, "least-squares", PPM))
    for axis, solution in axes.items():
        value = solution.nonlinearity if solution is not None else None
        extra = _rates(solution) if solution is not None and value is not None else {}
        estimates.append(
            _estimate(NONLINEARITY, AXES[axis], value, solution, methods[axis], PPM, {}, extra)
        )
    lean = {
        "prior_mounting": ARCSEC_PER_RAD * prior.mounting_rad,
        "prior_table_axes": ARCSEC_PER_RAD * prior.table_axes_rad,
    }
    for gyro, axis in PAIRS:
        if axis not in axes:
            continue
        solution, own = axes[axis], axes.get(gyro)
        value = solution.cross.get(gyro) if solution is not None else None
        size = ARCSEC_PER_RAD / (own.scale_factor.value if own is not None else 1.0)
        pair, frame = AXES[gyro] + AXES[axis], {"frame": FRAME}
        estimates.append(
            _estimate(MISALIGNMENT, pair, value, solution, "weighted", size, lean, frame)
        )
    return estimates


def _estimate(
    name: str,
    axis: str,
    value: Value | None,
    solution: ScaleSolution | None,
    method: str,
    size: float,
    sensitivities: Mapping[str, float] | None = None,
    extra: Mapping[str, object] | None = None,
) -> Estimate:
    """Return a value, times `size` in the unit of its name, as an estimate."""
    if value is None or solution is None:
        return undetermined(name, axis, UNITS[name], method, extra)
    return Estimate(
        name,
        axis,
        size * value.value,
        UNITS[name],
        abs(size) * value.standard_uncertainty,
        solution.degrees_of_freedom,
        method,
        sensitivities or {},
        extra or {},
    )


def _by_angle(solution: ScaleSolution, means: AxisMeans) -> float:
    """Return the derivative of K by an error of the encoder's angle at one end of each record.

    Over whole turns both ends are the same mark of the encoder, and its error drops out.
    """
    total = 0.0
    for rate, weight in zip(solution.commanded, solution.weights, strict=True):
        part = np.isclose(np.abs(means.commanded), rate) & (means.turns > 0.0) & means.part
        if bool(part.any()):
            shortest = 360.0 * float(means.turns[part].min())
            total += (float(weight) * solution.scale_factor.value / shortest) ** 2
    return float(np.sqrt(total))


def _rates(solution: ScaleSolution) -> dict[str, object]:
    """Return the deviation of each rate's K from K, for the result document."""
    names = ("rate_deg_per_s", "deviation_ppm", "standard_uncertainty_ppm")
    columns = solution.commanded, PPM * solution.deviation, PPM * solution.deviation_u
    return {
        "rates": [dict(zip(names, row, strict=True)) for row in np.column_stack(columns).tolist()]
    }


def published_values(dataset: NineAxisDataset, turned: Sequence[int]) -> tuple[Published, ...]:
    """Return bias and scale factor of each axis by the published rules, on the data as they are.

    b is the mean of the axis that faces east; K = (1/N) sum (w+ - w-)/(2 w) with the nominal rates
    w, over those that were turned in both senses. None where there is nothing to take a mean of.
    """
    biases = {
        axis: _mean_of_all(
            record.rate_deg_per_h[:, axis]
            for record in dataset.static
            if EAST_AXIS.get(record.position) == axis
        )
        for axis in range(len(AXES))
    }
    scales = {axis: _published_scale(dataset.turns, axis) for axis in turned}
    return tuple(
        Published(name, AXES[axis], value, UNITS[name], "mean")
        for name, values in ((BIAS, biases), (SCALE_FACTOR, scales))
        for axis, value in values.items()
    )


def _published_scale(records: Sequence[TurnRecord], axis: int) -> float | None:
    samples: dict[float, list[Array]] = {}
    for record in records:
        if record.axis == axis:
            own = samples.setdefault(record.commanded_deg_per_s, [])
            own.append(record.rate_deg_per_s[:, axis])
    factors = []
    for rate in sorted(rate for rate in samples if rate > 0.0):
        forth, back = _mean_of_all(samples[rate]), _mean_of_all(samples.get(-rate, ()))
        if forth is not None and back is not None:
            factors.append((forth - back) / (2.0 * rate))
    return float(np.mean(factors)) if factors else None


def _mean_of_all(samples: Iterable[Array]) -> float | None:
    together = np.concatenate([np.empty(0), *samples])
    together = together[np.isfinite(together)]
    return float(together.mean()) if len(together) else None
