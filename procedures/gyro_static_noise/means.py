"""Bias, its stability and its repeatability: what the means of records say."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation.measured import Measured, root
from procedures.estimation.rate_spectrum import allan_terms, coefficients, noise_variances

from .dataset import Array
from .noise_fit import WALK_ALLOWED, NoiseFit

STABILITY_S = 10.0


def bias_of(
    means: Array, length_s: float, theta: Array | None, tail: float = 0.0, walked: float = 0.0
) -> Measured | None:
    """Return the bias from the means (s,) of the switch-ons.

    Of one switch-on alone u is the model's Allan deviation at its length. `tail` of the warm-up
    and what the bias has `walked` from the first to all switch-ons, in deg/h, move all means alike,
    so that their spread does not show them.
    """
    if len(means) > 1:
        scattered = float(np.var(means, ddof=1)) / len(means)
        square = scattered + tail**2 + walked**2
        freedom = len(means) - 1.0
        if scattered > 0.0:
            freedom *= (square / scattered) ** 2
        return Measured(float(means.mean()), float(np.sqrt(square)), freedom)
    if theta is None:
        return None
    square = float(theta @ allan_terms(length_s)) + tail**2
    return Measured(float(means[0]), float(np.sqrt(square)))


def walked_by_the_mean(middles_s: Array, theta: Array, walk_u: float) -> float:
    """Return how far the bias walks, in deg/h, from the first middle (s,) to the mean of all.

    The walk of a record is extrapolated to the hours between them: its square may be larger by
    part of its own u `walk_u`.
    """
    since_s = middles_s - middles_s.min()
    shared = float(np.mean(np.minimum.outer(since_s, since_s)))
    return float(np.sqrt((theta[3] + WALK_ALLOWED * walk_u) * shared))


def repeatability_of(means: Array, lengths_s: Array, theta: Array | None) -> Measured | None:
    """Return the spread of these switch-ons' means, white noise and rounding taken off."""
    count = len(means)
    if count < 2 or theta is None:
        return None
    own = theta[1] / lengths_s + 2.0 * theta[0] / lengths_s**2
    square = float(np.var(means, ddof=1))
    away = 2.0 * (means - means.mean()) / (count - 1)
    u = np.sqrt(float(away**2 @ own) + 2.0 * float(own @ own) / count**2)
    return root(square - float(own.mean()), u)


def ten_second_means(rate: Array, interval_s: float) -> Array | None:
    """Return the means over 10 s of a record or of columns (n, ...); None for longer intervals."""
    group = round(STABILITY_S / interval_s)
    if group < 1 or len(rate) // group < 2:
        return None
    whole = len(rate) // group * group
    return np.asarray(rate[:whole].reshape(-1, group, *rate.shape[1:]).mean(axis=1))


def stability_of(noise: NoiseFit, interval_s: float) -> Measured | None:
    """Return the standard deviation of the 10 s means of the records that give the noise.

    Its square adds the squares of noise and of ramp and lines, and twice their product: with noise
    variances v and drift d of the cosine coefficients, u² is the sum of 2 v² + 4 v d². The longest
    waves decide it, and the walk that they rest on may be larger by part of its own u. Its degrees
    of freedom are those of a sum of squares of that u.
    """
    total, variance, freedom = 0.0, 0.0, 0
    theta = noise.theta.copy()
    theta[3] += WALK_ALLOWED * noise.u[3]
    step_s = round(STABILITY_S / interval_s) * interval_s
    for piece, solved in zip(noise.pieces, noise.solved, strict=True):
        means = ten_second_means(piece, interval_s)
        columns = ten_second_means(noise.columns(len(piece), interval_s), interval_s)
        if means is None or columns is None:
            continue
        spread = theta @ noise_variances(len(means), step_s)
        design = coefficients(columns)
        own = np.einsum("kp,pq,kq->k", design, solved.covariance, design)
        # What noise makes of sizes that are fitted to it is no drift.
        drift = np.maximum((design @ solved.sizes) ** 2 - own, 0.0)
        total += float(np.sum((means - means.mean()) ** 2))
        variance += float(np.sum(2.0 * spread**2 + 4.0 * spread * drift))
        freedom += len(means) - 1
    if not freedom:
        return None
    measured = root(total / freedom, float(np.sqrt(variance)) / freedom)
    return replace(measured, degrees_of_freedom=max(2.0 * total**2 / variance, 1.0))


@dataclass(frozen=True)
class Minimum:
    """The lowest Allan deviation of the fitted noise, where it lies, and whether at the end."""

    measured: Measured
    tau_s: float
    at_end: bool


def allan_minimum(
    theta: Array, covariance: Array, interval_s: float, longest_s: float
) -> Minimum | None:
    """Return the minimum of the fitted noise up to a ninth of the longest record."""
    last_s = longest_s / 9.0
    if last_s <= interval_s:
        return None
    tau_s = np.geomspace(interval_s, last_s, 400)
    terms = allan_terms(tau_s)
    variance = theta @ terms
    place = int(np.argmin(variance))
    slope = terms[:, place]
    u = float(np.sqrt(slope @ covariance @ slope))
    at_end = place == len(tau_s) - 1
    return Minimum(root(float(variance[place]), u), float(tau_s[place]), at_end)
