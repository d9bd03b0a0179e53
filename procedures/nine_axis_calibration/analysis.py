"""The analysis of a nine-axis sensor's gyros: a pure function of the dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from procedures.estimation.allan import (
    AllanDeviation,
    NoiseCoefficients,
    allan_deviation,
    noise_coefficients,
    pooled_deviation,
)
from procedures.estimation.noise import grid_index
from station.findings import FlagThresholds

from .all_axes.inertial import Inertial
from .attitude import PAIRS, BiasSolution, GyroGain, StaticMeans, solve_biases
from .checks import denied_rotation, flags_of, plausible
from .dataset import Array, Mask, NineAxisDataset, Prior, StaticRecord, screened
from .directions import PoseLimits
from .findings import (
    NineAxisAnalysis,
    StaticSummary,
    bias_estimates,
    published_values,
    scale_estimates,
)
from .means import interval_of, means_of
from .pose import check_together, earth_rate
from .scale import ScaleSolution, solve_axis
from .turning import axis_means

CONTRADICT = 0.999
STANDS_STILL, SMALLEST_G = 1e-6, 1e-9
UNFILTERED_S = 0.5
"""At shorter averaging times a sensor's own filter hides some of its white noise."""
USUAL_THRESHOLDS, USUAL_LIMITS = FlagThresholds(), PoseLimits()


def analyse(
    dataset: NineAxisDataset,
    thresholds: FlagThresholds = USUAL_THRESHOLDS,
    limits: PoseLimits = USUAL_LIMITS,
    *,
    allan: bool = True,
    inertial: Inertial | None = None,
) -> NineAxisAnalysis:
    """Estimate bias, scale factor, asymmetry, nonlinearity and misalignment of the three gyros.

    Scale factors come from the encoder's angles; then the biases from all nine static means at
    once, with latitude known, tilts and headings known by their priors. Beside them stand the
    published rules. Deterministic; raises nothing for poor data: what they do not determine is
    None and flagged. `allan` false leaves out the Allan deviations, which only the report needs.
    Where the accelerometers are calibrated, `inertial`, they are read so: how each position leans
    is then known better than by its prior.
    """
    if inertial is not None:
        known = replace(dataset.prior, accelerometer_bias_g=inertial.bias_u_g)
        dataset = replace(dataset, prior=known)
    sound = screened(dataset)
    clean, outlier = sound.dataset, thresholds.outlier
    horizontal = float(np.linalg.norm(earth_rate(dataset.latitude_deg)[:2]))
    turned = sorted({turn.axis for turn in dataset.turns})
    means = {
        axis: axis_means([turn for turn in clean.turns if turn.axis == axis], outlier, horizontal)
        for axis in turned
    }
    axes = {axis: solve_axis(means[axis], axis) for axis in turned}
    gain, gain_u = gain_matrix(axes)
    static, freedom, wander, rounding = _static(
        clean, dataset.static, outlier, limits, allan=allan, inertial=inertial
    )
    rotation = denied_rotation(
        static, dataset.latitude_deg, dataset.prior, np.diag(gain), limits.acceleration_g
    )
    # Where the statement makes right positions look wrong no bias can be had from it.
    lost = rotation is not None and not all(summary.pose.right for summary in static)
    bias = None if lost else _biases(static, dataset.latitude_deg, dataset.prior, gain, gain_u)
    wider = _wider(bias)
    analysis = NineAxisAnalysis(
        estimates=(
            *bias_estimates(bias, freedom, wider),
            *scale_estimates(axes, means, dataset.prior, inertial),
        ),
        published=published_values(dataset, turned),
        flags=(),
        static=static,
        bias=bias,
        axes=axes,
        means=means,
        gain=gain,
        gain_u=gain_u,
        noise=_noise(static, dataset) if allan else (None, None, None),
        wander=wander,
        rounding=rounding,
        wider=wider,
    )
    flags = flags_of(analysis, sound, rotation, lost=lost, thresholds=thresholds)
    return replace(analysis, flags=flags)


def gain_matrix(axes: Mapping[int, ScaleSolution | None]) -> tuple[Array, Array]:
    """Return gyro j's output per rate about axis i in [j, i] with its u, NaN where unknown."""
    gain, u = np.full((3, 3), np.nan), np.full((3, 3), np.nan)
    for axis, solution in axes.items():
        if solution is None:
            continue
        for gyro, value in {axis: solution.scale_factor, **solution.cross}.items():
            gain[gyro, axis], u[gyro, axis] = value.value, value.standard_uncertainty
    return gain, u


def _static(
    dataset: NineAxisDataset,
    as_recorded: Sequence[StaticRecord],
    outlier: float,
    limits: PoseLimits,
    *,
    allan: bool,
    inertial: Inertial | None,
) -> tuple[tuple[StaticSummary, ...], Array, Array, Array]:
    """Return each static record's means and pose; each gyro's freedom, wander, rounding, (3,).

    A gyro that only repeats itself has no mean, but what it repeats can still show a wrong pose.
    """
    records = dataset.static
    if not records:
        return (), np.zeros(3), np.zeros(3), np.zeros(3)
    times = [record.time_s for record in records]
    interval_s = interval_of(times)
    gyros, accelerometers = [], []
    for axis in range(3):
        rates = [record.rate_deg_per_h[:, axis] for record in records]
        gyros.append(means_of(rates, times, interval_s, outlier))
        accelerations = [record.acceleration_g[:, axis] for record in records]
        means = means_of(accelerations, times, interval_s, outlier)
        u, bias_g = means.standard_uncertainty, dataset.prior.accelerometer_bias_g
        # Output that stands still in its steps is no surer than the bias.
        sure = np.where(u > STANDS_STILL * bias_g, u, np.maximum(bias_g, SMALLEST_G))
        accelerometers.append(replace(means, standard_uncertainty=sure))
    gyro = np.array([gyro.value for gyro in gyros]).T
    gyro_u = np.array([gyro.standard_uncertainty for gyro in gyros]).T
    acceleration = np.array([accelerometer.value for accelerometer in accelerometers]).T
    if inertial is not None:
        acceleration = inertial.force_in_base(acceleration)
    repeated = np.array([np.nanmedian(record.rate_deg_per_h, axis=0) for record in as_recorded])
    poses = check_together(
        [record.position for record in records],
        np.where(np.isfinite(gyro), gyro, repeated),
        np.nan_to_num(gyro_u),
        acceleration,
        dataset.latitude_deg,
        limits,
    )
    summaries = []
    for n, record in enumerate(records):
        kept = np.column_stack([gyro.kept[n] for gyro in gyros])
        deviations = _allan(record, kept, interval_s) if allan else ()
        summaries.append(
            StaticSummary(
                record.position,
                gyro[n],
                gyro_u[n],
                acceleration[n],
                np.array(
                    [accelerometer.standard_uncertainty[n] for accelerometer in accelerometers]
                ),
                poses[n],
                kept,
                deviations,
            )
        )
    freedom = np.array([gyro.degrees_of_freedom for gyro in gyros])
    wander, rounding = np.array([(gyro.wander, gyro.rounding) for gyro in gyros]).T
    return tuple(summaries), freedom, wander, rounding


def _allan(record: StaticRecord, kept: Mask, interval_s: float) -> tuple[AllanDeviation, ...]:
    deviations = []
    for axis in range(3):
        good = kept[:, axis]
        index = grid_index(record.time_s[good], interval_s) if good.any() else None
        deviations.append(allan_deviation(record.rate_deg_per_h[good, axis], interval_s, index))
    return tuple(deviations)


def _noise(
    static: Sequence[StaticSummary], dataset: NineAxisDataset
) -> tuple[NoiseCoefficients | None, ...]:
    """Return each gyro's noise coefficients from its longest static records together."""
    if not static:
        return (None, None, None)
    longest = static[int(np.argmax([len(record.time_s) for record in dataset.static]))]
    coefficients = []
    for axis, first in enumerate(longest.allan):
        own = [summary.allan[axis] for summary in static]
        alike = [deviation for deviation in own if np.array_equal(deviation.tau_s, first.tau_s)]
        coefficients.append(noise_coefficients(pooled_deviation(alike).beyond(UNFILTERED_S)))
    return tuple(coefficients)


def _biases(
    static: Sequence[StaticSummary],
    latitude_deg: float,
    prior: Prior,
    gain: Array,
    gain_u: Array,
) -> BiasSolution | None:
    """Return the biases from the positions that were right; None without any."""
    right = [
        summary
        for summary in static
        if summary.pose.right
        and np.all(summary.gyro_u > 0.0)
        and np.isfinite(summary.accelerometer).all()
    ]
    if not right:
        return None
    means = StaticMeans(
        tuple(summary.position for summary in right),
        np.array([summary.gyro for summary in right]),
        np.array([summary.gyro_u for summary in right]),
        np.array([summary.accelerometer for summary in right]),
        np.array([summary.accelerometer_u for summary in right]),
    )
    return solve_biases(means, latitude_deg, prior, _gyro_gain(gain, gain_u, prior))


def _gyro_gain(gain: Array, gain_u: Array, prior: Prior) -> GyroGain:
    """Return the measured gains; an ideal gyro's, with the prior of its misalignment, where not.

    Towards the axes of a position a measured misalignment is as sure as mounting and table are.
    """
    gain = np.where(plausible(np.diag(gain)), gain, np.nan)  # else another unit, or inverted
    scale = np.where(np.isfinite(np.diag(gain)), np.diag(gain), 1.0)
    cross = np.array([gain[pair] / scale[pair[0]] for pair in PAIRS])
    noise = np.array([gain_u[pair] / abs(scale[pair[0]]) for pair in PAIRS])
    size = np.sqrt(noise**2 + prior.mounting_rad**2 + prior.table_axes_rad**2)
    known = np.isfinite(cross)
    return GyroGain(
        scale,
        np.where(known, cross, 0.0),
        np.where(known, size, prior.misalignment_rad),
    )


def _wider(bias: BiasSolution | None) -> float:
    """Return by how much the means contradict each other beyond their uncertainties; 1 if not."""
    if bias is None or bias.degrees_of_freedom < 1:
        return 1.0
    if bias.chi_square <= float(chdtri(bias.degrees_of_freedom, 1.0 - CONTRADICT)):
        return 1.0
    return float(np.sqrt(bias.chi_square / bias.degrees_of_freedom))
