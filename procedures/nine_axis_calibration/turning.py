"""From samples and encoder readings of one rate to a mean output at a mean true rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from procedures.estimation.linear import robust_sigma
from procedures.estimation.noise import grid_index
from procedures.estimation.turn_encoder import Encoder, unwrap

from .dataset import Array, Mask, TurnRecord
from .encoder import without_graduation
from .means import (
    BLOCKS,
    COARSE,
    QUANTUM_PART,
    colour_factor,
    good_samples,
    interval_of,
    pooled_sigma,
    rounding_u,
    slow_excess,
    smallest_step,
    without_thirds,
)

PART_TURN = 0.02
"""Of a turn: a rest below it leaves a hundredth of the tilt's earth rate and less."""
NOISE_DIFFERS = 0.999
FEWEST_FOR_OWN_NOISE = 20
MAX_ROUNDS = 2
ALWAYS_LEVEL = 0.02
"""Sine of the largest tilt of a turned axis that is expected, about one degree."""

__all__ = ["AxisMeans", "axis_means"]


@dataclass(frozen=True)
class AxisMeans:
    """All records of one turned axis, r of them, in their order.

    `output` (r, 3) holds the gyros' means less the modulation by a tilted turn, NaN where a gyro
    was not recorded; `covariance` (3, r, r) is that of each gyro's means; `rate` (r,) the mean true
    rate, signed, and `commanded` (r,) its nominal value. `turns` (r,) is how far the record went
    round, `part` whether that is no whole number; `kept` the turned axis' samples that were used.
    `restless` (r,) is the standard deviation in deg/s by which the turned gyro changes within a
    record beyond its noise, slowly or at once; it is in `covariance` whole.
    `wild_readings` is how many of the encoder's readings did not fit the turns, `unsteady` (r,) in
    how many samples the table was not at its rate; neither is used. `graduation_deg` is what the
    encoder was found to be off within a turn, and corrected for; `rounding` is what coarse output
    adds to the turned gyro's means, in deg/s; `lean_rad` is how far that gyro leans from the
    table's axis by the earth's rotation that it feels round the turn, and its u.
    """

    output: Array
    covariance: Array
    rate: Array
    commanded: Array
    turns: Array
    part: Mask
    kept: tuple[Mask, ...]
    noise: Array
    degrees_of_freedom: float
    wild_readings: int = 0
    unsteady: tuple[int, ...] = ()
    restless: tuple[float, ...] = ()
    graduation_deg: float = 0.0
    rounding: float = 0.0
    lean_rad: tuple[float, float] = (0.0, 0.0)


def axis_means(
    records: Sequence[TurnRecord], threshold: float, horizontal_deg_per_h: float
) -> AxisMeans:
    """Return the means of all records of one axis, with the true rates from the encoder.

    The earth's rotation modulates what a gyro reads over a turn: by its horizontal part times the
    sine of the tilt on the turned axis, whole on the others. The modulation is one cosine and one
    sine of the encoder's angle for all records together; over whole turns it takes nothing away.
    """
    interval_s = interval_of([record.time_s for record in records])
    encoders = [
        unwrap(record.time_s, record.encoder_deg, record.commanded_deg_per_s, interval_s)
        for record in records
    ]
    records = [_steady(*pair) for pair in zip(records, encoders, strict=True)]
    axis = records[0].axis
    outputs = [record.rate_deg_per_s[:, axis] for record in records]
    encoders, graduation_deg = without_graduation(records, outputs, encoders, interval_s)
    recorded = [g for g in range(3) if any(_is_there(record, g) for record in records)]
    count = len(records)
    output = np.full((count, 3), np.nan)
    covariance = np.full((3, count, count), np.nan)
    noise = np.full(3, np.nan)
    rate = np.array([encoder.mean_rate_deg_per_s for encoder in encoders])
    kept: list[Mask] = [np.zeros(len(record.time_s), dtype=bool) for record in records]
    freedom, rounding, restless, lean_rad = 0.0, 0.0, np.zeros(count), (0.0, 0.0)
    for gyro in recorded:
        tilt = ALWAYS_LEVEL if gyro == axis else 1.0
        size = tilt * horizontal_deg_per_h / 3600.0
        done = _gyro(records, encoders, gyro, threshold, interval_s, size)
        output[:, gyro], covariance[gyro], noise[gyro] = done.mean, done.covariance, done.noise
        if gyro == axis:
            kept, rate, freedom = list(done.kept), done.rate, done.freedom
            restless, rounding = np.sqrt(done.excess), done.rounding
            level = max(horizontal_deg_per_h, 1e-9) / 3600.0
            lean_rad = (done.swing[0] / level, done.swing[1] / level)
    turns = np.array(
        [
            abs(encoder.mean_rate_deg_per_s) * (t.time_s[-1] - t.time_s[0] + interval_s) / 360.0
            if len(t.time_s)
            else 0.0
            for encoder, t in zip(encoders, records, strict=True)
        ]
    )
    rest = np.abs(turns - np.rint(turns))
    part = (rest > PART_TURN) | (np.rint(turns) < 1.0)
    commanded = np.array([record.commanded_deg_per_s for record in records])
    return AxisMeans(
        output,
        covariance,
        rate,
        commanded,
        turns,
        part,
        tuple(kept),
        noise,
        freedom,
        sum(encoder.wild for encoder in encoders),
        tuple(int(encoder.unsteady.sum()) for encoder in encoders),
        tuple(restless.tolist()),
        graduation_deg,
        rounding,
        lean_rad,
    )


def _steady(record: TurnRecord, encoder: Encoder) -> TurnRecord:
    """Return a record without the outputs from while the table was not at its rate."""
    if not bool(encoder.unsteady.any()):
        return record
    outputs = np.where(encoder.unsteady[:, None], np.nan, record.rate_deg_per_s)
    return replace(record, rate_deg_per_s=outputs)


def _is_there(record: TurnRecord, gyro: int) -> bool:
    return bool(np.isfinite(record.rate_deg_per_s[:, gyro]).any())


@dataclass(frozen=True)
class _Gyro:
    mean: Array
    covariance: Array
    rate: Array
    kept: tuple[Mask, ...]
    noise: float
    freedom: float
    excess: Array
    rounding: float
    swing: tuple[float, float]


def _gyro(
    records: Sequence[TurnRecord],
    encoders: Sequence[Encoder],
    gyro: int,
    threshold: float,
    interval_s: float,
    modulation: float,
) -> _Gyro:
    """Return one gyro's means over all records of a turned axis."""
    own = gyro == records[0].axis
    following = [
        _follow(r.rate_deg_per_s[:, gyro], e, own=own)
        for r, e in zip(records, encoders, strict=True)
    ]
    rounds = [round_the_turn(encoder, interval_s) for encoder in encoders]
    # Coarse output less a turn's small wave is no longer coarse, but honest all the same.
    least = QUANTUM_PART * smallest_step([record.rate_deg_per_s[:, gyro] for record in records])
    amplitude, normal = np.zeros(2), np.eye(2)
    kept: tuple[Mask, ...] = ()
    for _ in range(MAX_ROUNDS):
        # What a turn modulates must not hide wild samples: judge again without it.
        level = [v - c @ amplitude for (v, _), c in zip(following, rounds, strict=True)]
        usual = max(pooled_sigma(level), least)
        fresh = tuple(good_samples(values, threshold, usual) for values in level)
        if all(bool(np.array_equal(*pair)) for pair in zip(fresh, kept, strict=False)) and kept:
            break
        kept = fresh
        residuals, angles = _centred(following, rounds, kept)
        counts = np.array([max(len(residual), 1) for residual in residuals], dtype=np.float64)
        freedom = max(float(np.sum(counts - 1.0)) - 2.0, 1.0)
        amplitude, normal = _amplitude(np.vstack(residuals), freedom, modulation)
    mean, rate = [], []
    for record, encoder, good, (_, wanders) in zip(records, encoders, kept, following, strict=True):
        mean.append(float(record.rate_deg_per_s[good, gyro].mean()) if good.any() else np.nan)
        rate.append(_mean_rate(encoder, good, wanders=wanders))
    places = [
        grid_index(record.time_s[good], interval_s)
        for record, good in zip(records, kept, strict=True)
    ]
    cleaned = [residual[:, 0] - residual[:, 1:] @ amplitude for residual in residuals]
    squares = np.array([float(left @ left) for left in cleaned])
    pooled = float(squares.sum()) / freedom
    long = [n for n, left in enumerate(cleaned) if len(left) > 1]
    factor = colour_factor([without_thirds(cleaned[n]) for n in long], [places[n] for n in long])
    sample = _sample_variances(squares, counts, pooled) * factor
    span_s = np.array(
        [
            max(float(r.time_s[-1] - r.time_s[0]), interval_s) if len(r.time_s) else interval_s
            for r in records
        ]
    )
    ends_deg = np.array(
        [
            e.noise_deg if np.isnan(r.encoder_u_deg) else r.encoder_u_deg
            for r, e in zip(records, encoders, strict=True)
        ]
    )
    reading = ends_deg * np.sqrt(2.0) / span_s
    unfollowed = [
        _unfollowed(v, e, good, own=own and not done and np.isnan(r.encoder_u_deg))
        for (v, done), e, good, r in zip(following, encoders, kept, records, strict=True)
    ]
    rounding = rounding_u([v[k] for (v, _), k in zip(following, kept, strict=True)], pooled)
    excess = np.array(
        [
            slow_excess(left - moved, float(s), (float(e) * BLOCKS) ** 2 + rounding**2)
            for left, moved, s, e in zip(cleaned, unfollowed, sample, reading, strict=True)
        ]
    )
    variance = sample / counts + excess + rounding**2
    coarse = rounding > COARSE * float(np.sqrt(np.median(sample / counts)))
    if own:
        variance = variance + reading**2
    middle = np.array(angles)
    inverse = np.linalg.inv(normal) * max(pooled * factor, 1e-300)
    covariance = np.diag(variance) + middle @ inverse @ middle.T
    return _Gyro(
        np.array(mean) - middle @ amplitude,
        covariance,
        np.array(rate),
        kept,
        float(np.sqrt(pooled)),
        freedom,
        excess,
        coarse * rounding,
        (float(np.linalg.norm(amplitude)), float(np.sqrt(np.max(np.diag(inverse))))),
    )


def _follow(values: Array, encoder: Encoder, *, own: bool) -> tuple[Array, bool]:
    """Return what is judged for wild samples, and whether each sample's own rate counts.

    The table's wander is taken off where that makes the samples quieter: where the table wanders
    more than its encoder scatters.
    """
    finite = np.isfinite(values)
    if not own or not np.isfinite(encoder.mean_rate_deg_per_s) or not bool(finite.any()):
        return values, False
    gain = float(np.median(values[finite])) / encoder.mean_rate_deg_per_s
    without = values - gain * (encoder.rate_deg_per_s - encoder.mean_rate_deg_per_s)
    wanders = robust_sigma(without[finite]) < robust_sigma(values[finite])
    return (np.asarray(without), True) if wanders else (values, bool(encoder.unsteady.any()))


def _unfollowed(values: Array, encoder: Encoder, good: Mask, *, own: bool) -> Array:
    """Return what the table moved by its encoder that the used samples were not cleared of."""
    rates = encoder.rate_deg_per_s[good]
    if not own or not len(rates) or not bool(np.isfinite(rates).all()):
        return np.zeros(int(good.sum()))
    gain = float(np.median(values[good])) / encoder.mean_rate_deg_per_s
    return np.asarray(gain * (rates - rates.mean()))


def _mean_rate(encoder: Encoder, good: Mask, *, wanders: bool) -> float:
    """Return the true rate over the used samples.

    Where the table wanders, or was not always at its rate, it is the mean of the used samples' own
    rates; else that of the whole record, which needs two readings of the encoder only.
    """
    if not wanders or bool(good.all()) or not bool(good.any()):
        return encoder.mean_rate_deg_per_s
    return float(encoder.rate_deg_per_s[good].mean())


def round_the_turn(encoder: Encoder, interval_s: float) -> Array:
    """Return the mean cosine and sine of the table's angle over each sample, (n, 2)."""
    if not np.isfinite(encoder.mean_rate_deg_per_s):
        return np.zeros((len(encoder.angle_deg), 2))
    end = np.radians(encoder.angle_deg)
    width = np.radians(encoder.mean_rate_deg_per_s * interval_s)
    middle, shrunk = end - 0.5 * width, np.sinc(width / (2.0 * np.pi))
    return np.asarray(np.column_stack((np.cos(middle), np.sin(middle))) * shrunk)


def _centred(
    following: Sequence[tuple[Array, bool]], rounds: Sequence[Array], kept: Sequence[Mask]
) -> tuple[list[Array], list[Array]]:
    """Return output, cosine and sine of each record's used samples less their means, and those."""
    residuals, middles = [], []
    for (values, _), columns, good in zip(following, rounds, kept, strict=True):
        used = np.column_stack((values[good], columns[good]))
        middle = used.mean(axis=0) if len(used) else np.zeros(3)
        residuals.append(used - middle)
        middles.append(middle[1:])
    return residuals, middles


def _amplitude(stacked: Array, freedom: float, modulation: float) -> tuple[Array, Array]:
    """Return cosine and sine amplitude (2,) with their normal matrix, prior `modulation`.

    The noise that weighs the prior is what the amplitudes themselves leave.
    """
    columns, data = stacked[:, 1:], stacked[:, 0]
    amplitude, normal = np.zeros(2), np.eye(2)
    for _ in range(2):
        left = data - columns @ amplitude
        ridge = float(left @ left) / freedom / max(modulation, 1e-12) ** 2
        normal = columns.T @ columns + max(ridge, 1e-12) * np.eye(2)
        amplitude = np.asarray(np.linalg.solve(normal, columns.T @ data), dtype=np.float64)
    return amplitude, normal


def _sample_variances(squares: Array, counts: Array, pooled: float) -> Array:
    """Return each record's variance of a sample: one for all unless they clearly differ.

    Bartlett's test at 99.9 %; records of fewer than 20 samples have no variance of their own.
    """
    freedom = counts - 1.0
    long = (freedom >= FEWEST_FOR_OWN_NOISE) & (squares > 0.0)
    same = np.full(len(counts), pooled)
    if int(long.sum()) < 2:
        return same
    own = squares[long] / freedom[long]
    total = float(freedom[long].sum())
    together = float(squares[long].sum()) / total
    statistic = total * np.log(together) - float(freedom[long] @ np.log(own))
    groups = int(long.sum())
    shrink = 1.0 + (float(np.sum(1.0 / freedom[long])) - 1.0 / total) / (3.0 * (groups - 1))
    if statistic / shrink <= float(chdtri(groups - 1, 1.0 - NOISE_DIFFERS)):
        return same
    same[long] = own
    return same
