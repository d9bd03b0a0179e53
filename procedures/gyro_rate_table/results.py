"""Scale factor, nonlinearity, asymmetry, repeatability and bias of a joint solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.measured import Measured, root

from .dataset import PPM, Array
from .joint_fit import JointFit

AGREE = 1e-3
"""By chance, rates of one scale factor agree worse than this seldom."""
DRAWS = 1000
NOTHING = 1e-9


@dataclass(frozen=True)
class Results:
    """What a gyro on a rate table gives, None where the data do not determine it.

    Ratios: `scale_factor`, `factors` K_i (m,) at `nominal` rates in deg/s with u (m,), NaN where
    not determined. In ppm: `nonlinearity` and `of_full_scale`, `asymmetry`, `repeatability`. `bias`
    in deg/h, the earth's rate in it. `agree` is whether the K_i differ by noise alone; `curve`
    (2, m) the distance from the line in both senses, over full scale, in ppm.
    """

    scale_factor: Measured | None
    nonlinearity: Measured | None
    of_full_scale: Measured | None
    asymmetry: Measured | None
    repeatability: Measured | None
    bias: Measured | None
    nominal: Array
    factors: Array
    factors_u: Array
    agree: bool
    curve: Array


def results_of(fit: JointFit, range_deg_per_s: float | None = None) -> Results:
    """Return the results of a solution; full scale is the largest input unless it is stated."""
    ratios, width = fit.scale_factors(), len(fit.value)
    rates = fit.layout.rates
    line = (rates**2 @ ratios) / float(rates @ rates) if len(rates) else np.zeros(width)
    has_line = bool(len(rates)) and fit.determined(line)
    scale = float(line @ fit.value)
    seen = np.array([fit.determined(ratio) for ratio in ratios], dtype=bool)
    factors = np.where(seen, ratios @ fit.value, np.nan)
    factors_u = np.where(seen, _u(fit, ratios), np.nan)
    spread = _spread(fit) if has_line else None
    even = np.zeros(width)
    even[fit.asymmetry] = 2.0 * PPM
    has_even = has_line and fit.determined(even)
    relative = (ratios - line) * PPM / scale if has_line else ratios
    nonlinearity = of_full_scale = None
    agree, curve = True, np.full((2, len(rates)), np.nan)
    if has_line and len(rates) > 1 and bool(seen.all()):
        nonlinearity, agree = _largest(fit, relative)
        if has_even:
            even_line = np.outer(rates - rates.mean(), even / 2.0) / scale
            full = rates.max()
            if range_deg_per_s is not None:
                full = range_deg_per_s * SECONDS_PER_HOUR
            both = [(rates[:, None] * relative + s * even_line) / full for s in (1.0, -1.0)]
            of_full_scale, _ = _largest(fit, np.vstack(both))
            curve = np.array([both[0] @ fit.value, -(both[1] @ fit.value)])
    counts = np.bincount(fit.layout.repeat_of, minlength=fit.switch_ons)
    mean = counts / counts.sum() @ fit.biases()
    return Results(
        _scale_factor(fit, line, spread) if has_line else None,
        nonlinearity,
        of_full_scale,
        _measured(fit, even / scale) if has_even else None,
        _repeatability(spread, scale) if spread else None,
        _measured(fit, mean) if fit.determined(mean) else None,
        fit.layout.nominal,
        factors,
        factors_u,
        agree,
        curve,
    )


def _u(fit: JointFit, gradients: Array) -> Array:
    squares = np.einsum("ij,jk,ik->i", gradients, fit.covariance, gradients)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _measured(fit: JointFit, gradient: Array) -> Measured:
    return Measured(float(gradient @ fit.value), float(_u(fit, gradient[None])[0]))


def _largest(fit: JointFit, gradients: Array) -> tuple[Measured, bool]:
    """Return the largest magnitude of several combinations, and whether they are all noise.

    By chi-square. The largest of noise is no normal number about zero: u is then its root mean
    square, so that the interval holds zero. Otherwise u is that of the largest one.
    """
    values, covariance = gradients @ fit.value, gradients @ fit.covariance @ gradients.T
    size, shape = np.linalg.eigh(covariance)
    there = size > NOTHING * size.max()
    square = float(np.sum((shape.T @ values)[there] ** 2 / size[there]))
    worst = int(np.argmax(np.abs(values)))
    agree = square <= float(chdtri(int(there.sum()), AGREE))
    u = float(np.sqrt(covariance[worst, worst]))
    if agree:
        noise = np.random.default_rng(0).standard_normal((DRAWS, int(there.sum())))
        drawn = noise @ (shape[:, there] * np.sqrt(size[there])).T
        u = float(np.sqrt(np.mean(np.max(np.abs(drawn), axis=1) ** 2)))
    return Measured(abs(float(values[worst])), u), agree


@dataclass(frozen=True)
class _Spread:
    """Variance of these switch-ons' scale factors, noise in it and taken off, and its u."""

    square: float
    own: float
    u: float
    count: int


def _spread(fit: JointFit) -> _Spread | None:
    parts = fit.departures()
    if fit.switch_ons < 2 or not all(fit.determined(part) for part in parts):
        return None
    value = parts @ fit.value
    noise = parts @ fit.covariance @ parts.T
    freedom = fit.switch_ons - 1
    own = float(np.trace(noise)) / freedom
    away = 2.0 * value / freedom
    u = np.sqrt(float(away @ noise @ away) + 2.0 * float(np.sum(noise * noise)) / freedom**2)
    return _Spread(float(value @ value) / freedom, own, float(u), fit.switch_ons)


def _repeatability(spread: _Spread, scale: float) -> Measured:
    factor = (PPM / scale) ** 2
    return root((spread.square - spread.own) * factor, spread.u * factor)


def _scale_factor(fit: JointFit, line: Array, spread: _Spread | None) -> Measured:
    """Return K; where it differs between switch-ons or drifts, that is in its u.

    Of n switch-ons the spread has n - 1 degrees of freedom, also where it happens to be small: what
    it is taken off from is as uncertain as the whole of it (Welch and Satterthwaite).
    """
    measured = _measured(fit, line)
    variance = measured.u**2 + fit.strayed**2
    if spread is None:
        return Measured(measured.value, float(np.sqrt(variance)))
    scattered = max(spread.square - spread.own, 0.0) / spread.count
    variance += scattered
    freedom = None
    if spread.square > 0.0:
        freedom = (spread.count - 1) * (variance * spread.count / spread.square) ** 2
    return Measured(measured.value, float(np.sqrt(variance)), freedom)
