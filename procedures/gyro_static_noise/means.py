"""Bias, its stability and its repeatability: what the means of records say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.estimation.measured import Measured, root
from procedures.estimation.rate_spectrum import allan_terms, noise_variances

from .dataset import Array

STABILITY_S = 10.0


def bias_of(means: Array, length_s: float, theta: Array | None) -> Measured | None:
    """Return the bias from the means (s,) of the switch-ons.

    Of one switch-on alone u is the model's Allan deviation at its length.
    """
    if len(means) > 1:
        spread = float(np.std(means, ddof=1))
        return Measured(float(means.mean()), spread / np.sqrt(len(means)), len(means) - 1.0)
    if theta is None:
        return None
    return Measured(float(means[0]), float(np.sqrt(theta @ allan_terms(length_s))))


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
    """Return the means over 10 s of a record; None where an interval is longer."""
    group = round(STABILITY_S / interval_s)
    if group < 1 or len(rate) // group < 2:
        return None
    whole = len(rate) // group * group
    return np.asarray(rate[:whole].reshape(-1, group).mean(axis=1))


def stability_of(pieces: Sequence[Array], interval_s: float, theta: Array) -> Measured | None:
    """Return the standard deviation of the 10 s means of the records that give the noise."""
    averaged = [ten_second_means(piece, interval_s) for piece in pieces]
    good = [means for means in averaged if means is not None]
    if not good:
        return None
    step_s = round(STABILITY_S / interval_s) * interval_s
    freedom = sum(len(means) - 1 for means in good)
    square = sum(float(np.sum((means - means.mean()) ** 2)) for means in good) / freedom
    spread = [theta @ noise_variances(len(means), step_s) for means in good]
    u = np.sqrt(2.0 * sum(float(values @ values) for values in spread)) / freedom
    return root(square, u)


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
