"""Means that survive wild samples, and uncertainties that hold for noise of any colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, fdtri

from procedures.estimation.linear import robust_sigma
from procedures.estimation.noise import Index, fit_autoregression, grid_index

from .dataset import Array, Mask

FEWEST_TO_JUDGE = 8
MAX_MEMORY = 6
APART = MAX_MEMORY + 2
BLOCKS = 8
FEWEST_FOR_BLOCKS = 64
WANDERS = 0.9999
QUANTUM_PART = 0.6
COARSE = 0.5
FEW_LEVELS = 64
RESTLESS = 1e-6
"""How seldom noise alone makes a record look as if it changed slowly."""


@dataclass(frozen=True)
class Means:
    """Means of the same channel over several records, shape (records,) each.

    `noise` is the standard deviation of a sample; `wander` that of the bias from record to record
    beyond the noise, zero where there is none to be seen. `rounding` is what the output's own steps
    add to a mean's uncertainty, zero where that is little beside the noise.
    """

    value: Array
    standard_uncertainty: Array
    degrees_of_freedom: float
    noise: float
    wander: float
    kept: tuple[Mask, ...]
    rounding: float = 0.0


def interval_of(records: Sequence[Array]) -> float:
    """Return the nominal interval in s of several records' times."""
    steps = [np.diff(time_s) for time_s in records if len(time_s) > 1]
    return float(np.median(np.concatenate(steps))) if steps else 1.0


def good_samples(values: Array, threshold: float, sigma: float | None = None) -> Mask:
    """Return which samples (n,) are finite and within `threshold` robust sigmas of the median.

    `sigma` is a standard deviation known from other records; the larger of the two counts. Fewer
    than eight samples are judged by it alone.
    """
    finite = np.isfinite(values)
    if not bool(finite.any()):
        return finite
    inside = values[finite]
    own = robust_sigma(inside) if len(inside) >= FEWEST_TO_JUDGE else 0.0
    spread = max(own, sigma or 0.0)
    if spread <= 0.0:
        steps = np.diff(np.unique(inside))
        if len(inside) < FEWEST_TO_JUDGE or len(steps) == 0:
            return finite
        spread = QUANTUM_PART * float(steps.min())
    near = np.abs(values - np.median(inside)) <= threshold * spread
    return np.asarray(finite & near)


def pooled_sigma(records: Sequence[Array]) -> float:
    """Return the median of the records' robust sigmas, 0 where none is long enough."""
    sigmas = []
    for values in records:
        inside = values[np.isfinite(values)]
        if len(inside) >= FEWEST_TO_JUDGE:
            sigmas.append(robust_sigma(inside))
    return float(np.median(sigmas)) if sigmas else 0.0


def colour_factor(residuals: Sequence[Array], places: Sequence[Index]) -> float:
    """Return the variance of long means over that of white noise of the same variance.

    An autoregression of all records together, its order by BIC, gives the density at frequency
    zero; 1 for white noise. `places` number each record's samples on the nominal grid.
    """
    if not residuals or sum(len(residual) for residual in residuals) < FEWEST_FOR_BLOCKS:
        return 1.0
    shifted, start = [], 0
    for index in places:
        shifted.append(index - index[0] + start)
        start = int(shifted[-1][-1]) + APART
    model = fit_autoregression(
        np.concatenate(residuals), np.concatenate(shifted).astype(np.int64), MAX_MEMORY
    )
    if model.order == 0:
        return 1.0
    return float(model.variances[-1] / (1.0 - model.coefficients[-1].sum()) ** 2)


def without_thirds(residuals: Array) -> Array:
    """Return a record's residuals (n,) less the means of its thirds: what is fast of them.

    The colour of the noise is judged by it, so that a drift or a step is no colour. Finer parts
    would give white noise a colour of their own.
    """
    if len(residuals) < FEWEST_FOR_BLOCKS:
        return residuals
    place = np.arange(len(residuals)) * 3 // len(residuals)
    means = np.bincount(place, residuals) / np.bincount(place)
    return np.asarray(residuals - means[place])


def rounding_u(records: Sequence[Array], variance: float) -> float:
    """Return what steps of the output leave in a mean, as a standard uncertainty.

    Noise of a standard deviation s blurs steps of q: exp(-2 pi^2 (s/q)^2) of the error is left.
    """
    step = smallest_step(records)
    if step == 0.0:
        return 0.0
    blurred = max(variance - step**2 / 12.0, 0.0) / step**2
    return step / float(np.sqrt(12.0)) * float(np.exp(-min(2.0 * np.pi**2 * blurred, 700.0)))


def smallest_step(records: Sequence[Array]) -> float:
    """Return the smallest step between the values of records (n,), 0 where there is none.

    Of few values, which may all be apart by many steps, the largest that they are multiples of.
    """
    levels = np.unique(np.concatenate(records)) if records else np.zeros(0)
    levels = levels[np.isfinite(levels)]
    least = 1e-9 * max(float(np.max(np.abs(levels), initial=0.0)), 1e-300)
    steps = np.diff(levels)
    steps = steps[steps > least]
    if not len(steps):
        return 0.0
    step = float(steps.min())
    for other in steps.tolist() if len(steps) < FEW_LEVELS else ():
        while other > 1e3 * least:
            step, other = other, abs(step - other * round(step / other))
    return step


def slow_excess(residuals: Array, variance: float, extra: float = 0.0) -> float:
    """Return the variance of a record's block means (8) beyond that of its noise, 0 if that is all.

    `variance` is that of a sample, `extra` that of a block beside it. A step, a drift or a tail
    shows so; it moves the mean by as much, so the variance belongs to the mean whole.
    """
    if len(residuals) < 2 * BLOCKS or variance <= 0.0:
        return 0.0
    place = np.arange(len(residuals)) * BLOCKS // len(residuals)
    means = np.bincount(place, residuals) / np.bincount(place)
    expected = variance * BLOCKS / len(residuals) + extra
    scatter = float(np.sum((means - means.mean()) ** 2))
    if scatter <= expected * float(chdtri(BLOCKS - 1, RESTLESS)):
        return 0.0
    return scatter / (BLOCKS - 1) - expected


def means_of(
    records: Sequence[Array], times_s: Sequence[Array], interval_s: float, threshold: float
) -> Means:
    """Return the mean of each record (n,) with its uncertainty, noise pooled over the records.

    A record's noise is its own where it has 64 samples or more. Where the means of eight blocks
    of each record scatter more than its noise explains (F test, 99.99 %), the bias wanders, and
    that part of the scatter goes into each uncertainty whole: it does not average out.
    """
    usual = pooled_sigma(records)
    kept = tuple(good_samples(values, threshold, usual) for values in records)
    good = [values[mask] for values, mask in zip(records, kept, strict=True)]
    value = np.array([samples.mean() if len(samples) else np.nan for samples in good])
    used = [n for n, samples in enumerate(good) if len(samples) > 1]
    count = np.array([max(len(samples), 1) for samples in good], dtype=np.float64)
    if not used:
        return Means(value, np.full(len(value), np.nan), 0.0, np.nan, 0.0, kept)
    residuals = [good[n] - value[n] for n in used]
    places = [grid_index(times_s[n][kept[n]], interval_s) for n in used]
    squares = np.array([float(residual @ residual) for residual in residuals])
    freedom = float(sum(len(residual) - 1 for residual in residuals))
    pooled = float(squares.sum()) / freedom
    factor = colour_factor([without_thirds(residual) for residual in residuals], places)
    variance = np.full(len(value), pooled)
    for n, square in zip(used, squares, strict=True):
        if count[n] >= FEWEST_FOR_BLOCKS:
            variance[n] = square / (count[n] - 1.0)
    excess, blocks = _wander(residuals, pooled * factor)
    rounding = rounding_u(good, pooled)
    u = np.sqrt(variance * factor / count + excess + rounding**2)
    coarse = rounding > COARSE * float(np.sqrt(np.median(variance * factor / count)))
    u[count < 1.0] = np.nan
    degrees = blocks if excess > 0.0 else freedom
    return Means(
        value, u, degrees, float(np.sqrt(pooled)), float(np.sqrt(excess)), kept, coarse * rounding
    )


def _wander(residuals: Sequence[Array], long_variance: float) -> tuple[float, float]:
    """Return the variance of slow wandering, 0 where noise explains it, and its freedom."""
    total, expected, freedom = 0.0, 0.0, 0.0
    for residual in residuals:
        if len(residual) < FEWEST_FOR_BLOCKS:
            continue
        size = len(residual) // BLOCKS
        means = residual[: size * BLOCKS].reshape(BLOCKS, size).mean(axis=1)
        total += float(np.sum((means - means.mean()) ** 2))
        expected += (BLOCKS - 1) * long_variance / size
        freedom += BLOCKS - 1
    if freedom == 0.0 or expected <= 0.0:
        return 0.0, 1.0
    if total / expected <= float(fdtri(freedom, 1e6, WANDERS)):
        return 0.0, freedom
    return (total - expected) / freedom, freedom
