"""Allan deviation of a rate record, and the noise coefficients that it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from procedures.common.constants import SECONDS_PER_HOUR

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FLICKER = 2.0 * np.log(2.0) / np.pi
"""Allan variance of flicker noise over the square of the bias instability B; its root is 0.664."""
FEWEST_CLUSTERS = 3
SEEN = 2.0
"""Standard uncertainties beyond which flicker is seen: in white noise so once in 25 records."""


@dataclass(frozen=True)
class AllanDeviation:
    """The overlapping Allan deviation, in the unit of the rate, at each averaging time.

    All arrays (m,), averaging times rising. `degrees_of_freedom` are those of the Allan variance in
    white noise; the relative standard uncertainty of the deviation is 1/sqrt(2 of them).
    """

    tau_s: Array
    deviation: Array
    degrees_of_freedom: Array

    @property
    def standard_uncertainty(self) -> Array:
        """The standard uncertainty of each deviation, shape (m,)."""
        return np.asarray(self.deviation / np.sqrt(2.0 * self.degrees_of_freedom))

    def beyond(self, shortest_s: float) -> AllanDeviation:
        """Return the part with averaging times of `shortest_s` and more."""
        long = self.tau_s >= shortest_s
        return AllanDeviation(self.tau_s[long], self.deviation[long], self.degrees_of_freedom[long])


@dataclass(frozen=True)
class NoiseCoefficients:
    """What an Allan deviation in deg/h is made of (IEEE Std 952, annex C): N, B, K and Q.

    sigma^2(tau) = 3 Q^2/tau^2 + N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3. A coefficient is zero where
    the record shows nothing of it. `bias_instability_seen` says whether B is more than what white
    noise alone lets appear in a record.
    """

    angle_random_walk_deg_per_sqrt_h: float
    bias_instability_deg_per_h: float
    rate_random_walk_deg_per_h_sqrt_h: float
    quantisation_arcsec: float
    bias_instability_seen: bool

    def deviation_deg_per_h(self, tau_s: Array) -> Array:
        """Return the Allan deviation that the coefficients give at averaging times (m,)."""
        tau_h = tau_s / SECONDS_PER_HOUR
        return np.asarray(
            np.sqrt(
                self.angle_random_walk_deg_per_sqrt_h**2 / tau_h
                + FLICKER * self.bias_instability_deg_per_h**2
                + self.rate_random_walk_deg_per_h_sqrt_h**2 * tau_h / 3.0
                + 3.0 * (self.quantisation_arcsec / tau_s) ** 2
            )
        )


def allan_deviation(
    rate: Array, interval_s: float, index: Index | None = None, per_decade: int = 8
) -> AllanDeviation:
    """Return the overlapping Allan deviation of a rate record (n,).

    `index` numbers the samples on the nominal grid where some are missing: a cluster that lacks a
    sample is left out. Averaging times are about even on a logarithmic scale, up to a third of the
    record. Empty for fewer than six samples. Source: NIST SP 1065, 5.2.5 and, for the degrees of
    freedom, 5.4.1.
    """
    places = np.arange(len(rate)) if index is None else index
    total = int(places[-1]) + 1 if len(rate) else 0
    if total < 2 * FEWEST_CLUSTERS:
        return AllanDeviation(*(np.empty(0) for _ in range(3)))
    values, there = np.zeros(total), np.zeros(total)
    values[places], there[places] = rate - rate.mean(), 1.0
    sums = np.concatenate(([0.0], np.cumsum(values)))
    counts = np.concatenate(([0.0], np.cumsum(there)))
    largest = total // FEWEST_CLUSTERS
    steps = max(2, int(np.ceil(per_decade * np.log10(largest))) + 1)
    sizes = np.unique(np.rint(np.geomspace(1, largest, steps)).astype(np.int64))
    points = []
    for m in sizes:
        mean = (sums[m:] - sums[:-m]) / m
        whole = (counts[m:] - counts[:-m]) == m
        pairs = whole[m:] & whole[:-m]
        if int(pairs.sum()) < FEWEST_CLUSTERS:
            continue
        step = mean[m:] - mean[:-m]
        variance = float(np.mean(step[pairs] ** 2)) / 2.0
        freedom = _freedom_in_white_noise(int(counts[-1]), int(m))
        points.append((m * interval_s, np.sqrt(variance), freedom))
    table = np.array(points).reshape(-1, 3)
    return AllanDeviation(table[:, 0], table[:, 1], table[:, 2])


def pooled_deviation(records: Sequence[AllanDeviation]) -> AllanDeviation:
    """Return the Allan deviation of several records (one at least) with the same averaging times.

    Variances are weighted by their degrees of freedom, which add up.
    """
    freedom = np.sum([record.degrees_of_freedom for record in records], axis=0)
    total = np.sum([record.degrees_of_freedom * record.deviation**2 for record in records], axis=0)
    return AllanDeviation(records[0].tau_s, np.sqrt(total / freedom), freedom)


def _freedom_in_white_noise(samples: int, m: int) -> float:
    points = samples + 1
    spread = 3.0 * (points - 1) / (2.0 * m) - 2.0 * (points - 2) / points
    return max(spread * 4.0 * m**2 / (4.0 * m**2 + 5.0), 1.0)


def noise_coefficients(allan: AllanDeviation) -> NoiseCoefficients | None:
    """Return the noise coefficients of an Allan deviation in deg/h; None for too short a record.

    Fits the Allan variance by white rate noise, flicker, rate random walk and rounded angles, none
    of them below zero, each averaging time weighted by what it is worth.
    """
    if len(allan.tau_s) < FEWEST_CLUSTERS or not bool(np.all(allan.deviation > 0.0)):
        return None
    tau_h = allan.tau_s / SECONDS_PER_HOUR
    variance = allan.deviation**2
    flat = np.full(len(tau_h), FLICKER)
    columns = np.column_stack((1.0 / tau_h, flat, tau_h / 3.0, 3.0 / allan.tau_s**2))
    weight = np.sqrt(allan.degrees_of_freedom / 2.0) / variance
    scale = np.linalg.norm(columns * weight[:, None], axis=0)
    solved, _ = nnls(columns * weight[:, None] / scale, variance * weight)
    squares = solved / scale
    parts = columns[:, squares > 0.0] / (columns @ squares)[:, None]
    spread = np.zeros(len(squares))
    worth = parts * allan.degrees_of_freedom[:, None] / 2.0
    spread[squares > 0.0] = np.sqrt(np.diag(np.linalg.pinv(parts.T @ worth)))
    seen = bool(squares[1] > SEEN * spread[1])
    white, flicker, walk, rounded = (float(np.sqrt(square)) for square in squares)
    return NoiseCoefficients(white, flicker, walk, rounded, seen)
