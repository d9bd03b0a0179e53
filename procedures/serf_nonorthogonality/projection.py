"""The linear part of a shot's fit at a given frequency and decay, and its slopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def design_of(t: Array, omega: float, decay: float, slow: float, mains_Hz: float | None) -> Array:
    """Return the columns (n, 4 or 6): tone, baseline with the decay `slow`, offset, mains."""
    fade = np.exp(-decay * t)
    columns = [
        fade * np.cos(omega * t),
        fade * np.sin(omega * t),
        np.exp(-slow * t),
        np.ones_like(t),
    ]
    if mains_Hz is not None:
        turn = 2.0 * np.pi * mains_Hz * t
        columns += [np.cos(turn), np.sin(turn)]
    return np.column_stack(columns)


@dataclass(frozen=True)
class Projection:
    """The linear solution at a place, with the projected slopes by w and G."""

    linear: Array
    residual: Array
    slopes: Array
    basis: Array
    slow: float
    columns: int

    @property
    def cost(self) -> float:
        """The sum of squares that is left."""
        return float(self.residual @ self.residual)


def project(
    t: Array,
    y: Array,
    omega: float,
    decay: float,
    baseline_decay_per_s: float | None,
    mains_Hz: float | None,
) -> Projection:
    """Return the linear solution; the baseline is as fast as the tone where no decay is given."""
    slow = decay if baseline_decay_per_s is None else baseline_decay_per_s
    design = design_of(t, omega, decay, slow, mains_Hz)
    basis, triangle = np.linalg.qr(design)
    linear = np.linalg.solve(triangle, basis.T @ y)
    cosine, sine, baseline = design[:, 0], design[:, 1], design[:, 2]
    by_omega = t * (linear[1] * cosine - linear[0] * sine)
    by_decay = -t * (linear[0] * cosine + linear[1] * sine)
    if baseline_decay_per_s is None:
        by_decay = by_decay - t * linear[2] * baseline
    slopes = np.column_stack([by_omega, by_decay])
    slopes -= basis @ (basis.T @ slopes)
    return Projection(linear, y - basis @ (basis.T @ y), slopes, basis, slow, design.shape[1])


def chirp_of(state: Projection, t: Array, omega: float, decay: float) -> tuple[float, float]:
    """Return by how much frequency and decay are higher at the beginning, relative, and its u.

    What the slowing-down factor of a fading polarisation does to first order in its square: both
    rates are larger by the share c e^(-2 G t).
    """
    early = -np.expm1(-2.0 * decay * t) / (2.0 * decay)
    a, b = state.linear[:2]
    fade, turn = np.exp(-decay * t), omega * t
    cosine, sine = fade * np.cos(turn), fade * np.sin(turn)
    column = early * (omega * (b * cosine - a * sine) - decay * (a * cosine + b * sine))
    column -= state.basis @ (state.basis.T @ column)
    share, *_ = np.linalg.lstsq(state.slopes, column, rcond=None)
    column = column - state.slopes @ share
    power = float(column @ column)
    if power <= 0.0:
        return 0.0, np.inf
    freedom = max(len(t) - state.columns - 2, 1)
    noise = np.sqrt(state.cost / freedom)
    return float(column @ state.residual) / power, float(noise / np.sqrt(power))
