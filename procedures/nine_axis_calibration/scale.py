"""Scale factor, asymmetry, nonlinearity and misalignment of one turned axis from its means."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from .dataset import Array
from .turning import AxisMeans

AGREE = 0.999
EVEN = 1.0 - 1e-5
"""What both senses have in common grows evenly with the rate, by chi-square at this level."""
SAME_RATE = 1e-6
HALVINGS = 60


@dataclass(frozen=True)
class Value:
    """A number with its standard uncertainty, in the unit that the field says."""

    value: float
    standard_uncertainty: float


@dataclass(frozen=True)
class ScaleSolution:
    """What one turned axis gives; rates in deg/s, relative quantities as ratios.

    `commanded` (n,), `factors` K_i (n,) are those rates that were
    turned in both senses. `agree` is whether the K_i differ by noise alone (chi-square at 99.9 %):
    K is then their weighted mean (`weights`), else their plain mean. `deviation` (n,) is K_i/K - 1.
    `cross` holds, for each other gyro that was recorded, its output over the true rate. Where what
    both senses have in common does not grow evenly with the rate, records were disturbed: by
    `uneven_deg_per_s`, which every record's variance then holds, most of all at `worst_rate`.
    """

    commanded: Array
    factors: Array
    weights: Array
    agree: bool
    chi_square: float
    scale_factor: Value
    deviation: Array
    deviation_u: Array
    nonlinearity: Value | None
    asymmetry: Value | None
    cross: dict[int, Value]
    degrees_of_freedom: float
    one_sense: tuple[float, ...]
    uneven_deg_per_s: float = 0.0
    worst_rate: float = 0.0


def solve_axis(means: AxisMeans, axis: int) -> ScaleSolution | None:
    """Return scale factor and the rest of one axis; None where no rate has both senses."""
    rates, forth, back, single = _pairs(means, axis)
    if not len(rates):
        return None
    up, down = forth @ np.nan_to_num(means.rate), back @ np.nan_to_num(means.rate)
    span = up - down
    output = np.nan_to_num(means.output[:, axis])
    pick = (forth - back) / span[:, None]
    factors = pick @ output
    count = len(rates)
    even, extra, worst_rate = _even(means, axis, forth, back)
    noise = np.nan_to_num(means.covariance[axis]) + extra * np.eye(len(means.rate))
    covariance = pick @ noise @ pick.T
    weights, square = _weighted(factors, covariance)
    agree = count < 2 or square < float(chdtri(count - 1, 1.0 - AGREE))
    if not agree:
        weights = np.full(count, 1.0 / count)
    scale = float(weights @ factors)
    apart = np.eye(count) - np.outer(np.ones(count), weights)
    deviation = (factors - scale) / scale
    deviation_u = np.sqrt(np.maximum(np.diag(apart @ covariance @ apart.T), 0.0)) / abs(scale)
    worst = int(np.argmax(np.abs(deviation)))
    nonlinearity = None
    if count > 1:
        nonlinearity = Value(abs(float(deviation[worst])), float(deviation_u[worst]))
    cross = {}
    for gyro in range(3):
        there = np.isfinite(means.output[:, gyro])
        if gyro != axis and bool(there[(forth + back).any(axis=0)].all()):
            cross[gyro] = _cross(pick, means, gyro, scale)
    return ScaleSolution(
        commanded=rates,
        factors=factors,
        weights=weights,
        agree=agree,
        chi_square=square,
        scale_factor=Value(scale, float(np.sqrt(weights @ covariance @ weights))),
        deviation=deviation,
        deviation_u=deviation_u,
        nonlinearity=nonlinearity,
        asymmetry=even and Value(even.value / scale, even.standard_uncertainty / abs(scale)),
        cross=cross,
        degrees_of_freedom=means.degrees_of_freedom,
        one_sense=single,
        uneven_deg_per_s=float(np.sqrt(extra)),
        worst_rate=float(rates[worst_rate]),
    )


def _pairs(means: AxisMeans, axis: int) -> tuple[Array, Array, Array, tuple[float, ...]]:
    """Return the rates turned in both senses, and the rows that average each sense, (n, r)."""
    usable = np.isfinite(means.output[:, axis]) & np.isfinite(means.rate)
    size = np.round(np.abs(means.commanded) / SAME_RATE) * SAME_RATE
    rates, forth, back, single = [], [], [], []
    for magnitude in np.unique(size):
        up = usable & (size == magnitude) & (means.commanded > 0.0)
        down = usable & (size == magnitude) & (means.commanded < 0.0)
        if not (bool(up.any()) and bool(down.any())):
            single.append(float(magnitude))
            continue
        rates.append(float(magnitude))
        forth.append(up / up.sum())
        back.append(down / down.sum())
    width = len(means.rate)
    return (
        np.array(rates),
        np.array(forth).reshape(-1, width),
        np.array(back).reshape(-1, width),
        tuple(single),
    )


def _weighted(values: Array, covariance: Array) -> tuple[Array, float]:
    """Return the weights (n,) of the best mean, and the chi-square of the values about it."""
    ones = np.ones(len(values))
    solved = np.linalg.solve(covariance, np.column_stack((ones, values)))
    weights = np.asarray(solved[:, 0] / float(ones @ solved[:, 0]), dtype=np.float64)
    mean = float(weights @ values)
    square = float((values - mean) @ np.linalg.solve(covariance, values - mean))
    return weights, square


def _even(
    means: AxisMeans, axis: int, forth: Array, back: Array
) -> tuple[Value | None, float, int]:
    """Return K+ - K- from how the mean of both senses grows with the rate.

    What does not grow, bias and earth rate, is free: it may have changed since the static records.
    Where a line does not fit, every record gets the variance beside its noise, in (deg/s)^2, with
    which it does: returned second; third is the rate that is furthest off.
    """
    count = len(forth)
    if count < 2:
        return None, 0.0, 0
    up, down = forth @ np.nan_to_num(means.rate), back @ np.nan_to_num(means.rate)
    width = up - down
    mix = (forth * -down[:, None] + back * up[:, None]) / width[:, None]
    half = mix @ np.nan_to_num(means.output[:, axis])
    noise, single = mix @ np.nan_to_num(means.covariance[axis]) @ mix.T, mix @ mix.T
    design = np.column_stack((np.ones(count), 0.5 * width))

    def fitted(extra: float) -> tuple[Array, Array, Array, float]:
        weighted = np.linalg.solve(noise + extra * single, design)
        inverse = np.asarray(np.linalg.inv(design.T @ weighted), dtype=np.float64)
        solved = inverse @ (weighted.T @ half)
        left = half - design @ solved
        return solved, inverse, left, float(left @ np.linalg.solve(noise + extra * single, left))

    extra, freedom = 0.0, count - 2
    solved, inverse, left, square = fitted(0.0)
    worst = int(np.argmax(np.abs(left) / np.sqrt(np.diag(noise))))
    if freedom > 0 and square > float(chdtri(freedom, 1.0 - EVEN)):
        low, high = 0.0, square * float(np.max(np.diag(noise) / np.diag(single)))
        for _ in range(HALVINGS):
            extra = 0.5 * (low + high)
            low, high = (extra, high) if fitted(extra)[3] > freedom else (low, extra)
        solved, inverse, left, _ = fitted(extra)
    return Value(2.0 * float(solved[1]), 2.0 * float(np.sqrt(inverse[1, 1]))), extra, worst


def _cross(pick: Array, means: AxisMeans, gyro: int, scale: float) -> Value:
    """Return what another gyro reads of the turned axis' rate, over that rate."""
    factors = pick @ np.nan_to_num(means.output[:, gyro])
    covariance = pick @ np.nan_to_num(means.covariance[gyro]) @ pick.T
    weights, square = _weighted(factors, covariance)
    u = float(np.sqrt(weights @ covariance @ weights))
    freedom = len(factors) - 1
    if freedom > 0 and square > float(chdtri(freedom, 1.0 - AGREE)):
        u *= float(np.sqrt(square / freedom))
    return Value(float(weights @ factors), u)
