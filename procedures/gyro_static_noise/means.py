"""Bias, its stability and its repeatability: what the means of records say.

Each switch-on begins cold, so that the tail A exp(-t/T) of the warm-up is the same in all of them
and does not show in their spread. The first, long record ends without it; short ones hold it whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from procedures.estimation.measured import Measured, root
from procedures.estimation.rate_spectrum import allan_terms, coefficients, noise_variances

from .dataset import Array, Record
from .noise import FEWEST, WALK_ALLOWED, NoiseFit, bridged, pieces

STABILITY_S = 10.0
TIME_CONSTANTS_S = (300.0, 600.0, 1200.0, 2400.0, 4800.0)
BY_CHANCE = 0.05
"""So seldom noise shows a tail that is taken for one."""


def bias_of(
    means: Array, length_s: float, fit: NoiseFit | None, tail: float = 0.0, walked: float = 0.0
) -> Measured | None:
    """Return the bias from the means (s,) of the switch-ons.

    Of one switch-on alone u is the model's Allan deviation at its length, its walk larger by part
    of its own u: one that the record does not show moves the mean all the same. `tail` of the
    warm-up and what the bias has `walked` from the first to all switch-ons, in deg/h, move all
    means alike, so that their spread does not show them.
    """
    if len(means) > 1:
        scattered = float(np.var(means, ddof=1)) / len(means)
        square = scattered + tail**2 + walked**2
        freedom = len(means) - 1.0
        if scattered > 0.0:
            freedom *= (square / scattered) ** 2
        return Measured(float(means.mean()), float(np.sqrt(square)), freedom)
    if fit is None:
        return None
    theta = fit.theta + np.array([0.0, 0.0, 0.0, WALK_ALLOWED * fit.u[3]])
    square = float(theta @ allan_terms(length_s)) + tail**2
    return Measured(float(means[0]), float(np.sqrt(square)))


def moving_all(
    records: Sequence[Record], grids: Sequence[Array], noise: NoiseFit
) -> tuple[float, float]:
    """Return how far the warm-up's tail, and how far the walk, moves the mean of all switch-ons.

    In deg/h. The walk of a record is extrapolated to the hours between them: its square may be
    larger by part of its own u. It is not known where nobody knows when they were switched on.
    """
    used = [pair for pair in zip(records, grids, strict=True) if np.isfinite(pair[1]).any()]
    earliest_s = min(float(record.time_s[0]) for record, _ in used)
    longest = [(record, max(pieces(rate), key=len)) for record, rate in used]
    begun_s = [float(record.time_s[0]) - earliest_s for record, _ in longest]
    tail = tail_in_mean([piece for _, piece in longest], begun_s, noise)
    middles_s = np.array([np.nan if r.on_s is None else r.on_s + r.time_s.mean() for r, _ in used])
    if len(used) < 2 or not bool(np.isfinite(middles_s).all()):
        return tail, 0.0
    since_s = middles_s - middles_s.min()
    shared = float(np.mean(np.minimum.outer(since_s, since_s)))
    return tail, float(np.sqrt((noise.theta[3] + WALK_ALLOWED * noise.u[3]) * shared))


def tail_in_mean(records: Sequence[Array], begun_s: Sequence[float], noise: NoiseFit) -> float:
    """Return by how much in deg/h a tail moves the mean of the records' means; 0 for none seen.

    The records (n,) begin at `begun_s` after the warm-up. Of several time constants the likeliest
    counts. A long record may have a ramp and lines of its own; a short one would be left nothing.
    """
    interval_s = noise.known.interval_s
    shortest = min(len(piece) for piece in noise.pieces)
    made_white = []
    for record, since_s in zip(records, begun_s, strict=True):
        count = len(record)
        if count < FEWEST:
            continue
        rate = bridged(record, interval_s, noise.theta, 0.0)
        sigma = np.sqrt(noise.theta @ noise_variances(count, interval_s))
        columns = noise.columns(count) if count >= shortest else np.empty((count, 0))
        beside = np.linalg.qr(coefficients(columns) / sigma[:, None])[0]
        time_s = since_s + (np.arange(count) + 0.5) * interval_s
        made_white.append((time_s, sigma, coefficients(rate) / sigma, beside))
    best_gain, moved = float(chdtri(1, BY_CHANCE / len(TIME_CONSTANTS_S))), 0.0
    for constant_s in TIME_CONSTANTS_S:
        normal, right, means = 0.0, 0.0, []
        for time_s, sigma, data, beside in made_white:
            tail = np.exp(-time_s / constant_s)
            means.append(float(tail.mean()))
            own = coefficients(tail) / sigma
            own = own - beside @ (beside.T @ own)
            normal += float(own @ own)
            right += float(own @ data)
        gain = right**2 / normal if normal > 0.0 else 0.0
        if gain > best_gain:
            best_gain, moved = gain, right / normal * float(np.mean(means))
    return abs(moved)


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


def stability_of(noise: NoiseFit) -> Measured | None:
    """Return the standard deviation of the 10 s means of the records that give the noise.

    Its square adds the squares of noise and of ramp and lines, and twice their product: with noise
    variances v and drift d of the cosine coefficients, u² is the sum of 2 v² + 4 v d². The longest
    waves decide it, and the walk that they rest on may be larger by part of its own u. Its degrees
    of freedom are those of a sum of squares of that u.
    """
    total, variance, freedom = 0.0, 0.0, 0
    theta = noise.theta.copy()
    theta[3] += WALK_ALLOWED * noise.u[3]
    interval_s = noise.known.interval_s
    step_s = round(STABILITY_S / interval_s) * interval_s
    for piece, solved in zip(noise.pieces, noise.solved, strict=True):
        means = ten_second_means(piece, interval_s)
        columns = ten_second_means(noise.columns(len(piece)), interval_s)
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


def allan_minimum(noise: NoiseFit) -> Minimum | None:
    """Return the minimum of the fitted noise up to a ninth of the longest record."""
    interval_s = noise.known.interval_s
    last_s = max(len(piece) for piece in noise.pieces) * interval_s / 9.0
    if last_s <= interval_s:
        return None
    tau_s = np.geomspace(interval_s, last_s, 400)
    terms = allan_terms(tau_s)
    variance = noise.theta @ terms
    place = int(np.argmin(variance))
    slope = terms[:, place]
    u = float(np.sqrt(slope @ noise.covariance @ slope))
    at_end = place == len(tau_s) - 1
    return Minimum(root(float(variance[place]), u), float(tau_s[place]), at_end)
