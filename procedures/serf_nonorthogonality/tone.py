"""One shot: a decaying tone with decaying baseline, offset and mains, by variable projection.

    S(t) = e^(-G t) (a cos wt + b sin wt) + C e^(-g t) + D + mains

Only w and G are searched for; the other coefficients are linear and follow from them (Golub and
Pereyra 1973, derivatives after Kaufman 1975). Without the baseline, which is as large as the tone
where the field lies between pump and probe, the frequency is wrong by degrees of coil angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from .projection import chirp_of, design_of, project
from .starts import starting_points

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_ITERATIONS = 40
STEP_ENOUGH = 1e-10
LEAST_SAMPLES = 16
WILD = 6.0
MOST_WILD = 0.05


@dataclass(frozen=True)
class ToneFit:
    """What the fit of a shot says; angular frequency and rates in rad/s and 1/s, the rest in V.

    `amplitude_V` is that of the tone at time zero, `sine_V` and `cosine_V` its parts; `chirp` is by
    how much the frequency is higher at the beginning than in the end, relative, to first order;
    `kept` (n,) marks the samples that were used, `residual_V` (n,) what is left of every one.
    """

    omega_rad_per_s: float
    omega_u: float
    decay_per_s: float
    decay_u: float
    cosine_V: float
    sine_V: float
    baseline_V: float
    baseline_decay_per_s: float
    offset_V: float
    mains_V: float
    noise_V: float
    degrees_of_freedom: int
    chirp: float
    chirp_u: float
    kept: Mask
    residual_V: Array
    model_V: Array

    @property
    def frequency_Hz(self) -> float:
        """The frequency."""
        return self.omega_rad_per_s / (2.0 * np.pi)

    @property
    def amplitude_V(self) -> float:
        """The amplitude of the tone at time zero."""
        return float(np.hypot(self.cosine_V, self.sine_V))

    @property
    def cycles(self) -> float:
        """How many cycles pass within the 1/e time of the tone."""
        return self.omega_rad_per_s / (2.0 * np.pi * self.decay_per_s)

    @property
    def signal_to_noise(self) -> float:
        """The amplitude over the standard deviation of a sample."""
        return self.amplitude_V / self.noise_V if self.noise_V > 0.0 else np.inf


class NoTone(ValueError):
    """A record that holds no decaying tone; the message says what it holds."""


def fit_tone(
    time_s: Array,
    voltage_V: Array,
    usable: Mask | None = None,
    baseline_decay_per_s: float | None = None,
    mains_Hz: float | None = None,
    start: tuple[float, float] | None = None,
) -> ToneFit:
    """Fit one record; `usable` (n,) leaves out samples that are none, such as saturated ones.

    The baseline decays with `baseline_decay_per_s`, or as fast as the tone where that is None.
    `start` is (w, G) to begin with, found from the record where it is None. Samples that
    stand six robust standard deviations from fit and neighbours are left out. Raises NoTone.
    """
    kept = np.isfinite(voltage_V) if usable is None else usable & np.isfinite(voltage_V)
    if int(kept.sum()) < LEAST_SAMPLES:
        raise NoTone(f"{int(kept.sum())} usable samples are too few")
    t, y = time_s[kept], voltage_V[kept]
    if float(np.ptp(y)) == 0.0:
        raise NoTone("the signal does not change")
    places = [start] if start is not None else starting_points(t, y, mains_Hz)
    fits = [_search(t, y, place, baseline_decay_per_s, mains_Hz) for place in places]
    sound = [fit for fit in fits if fit is not None]
    if not sound:
        raise NoTone("no decaying tone fits the record")
    best = min(sound, key=lambda fit: fit.cost)
    wild = _wild(best.residual)
    if wild.any():
        again = kept.copy()
        again[np.flatnonzero(kept)[wild]] = False
        t, y = time_s[again], voltage_V[again]
        better = _search(t, y, (best.omega, best.decay), baseline_decay_per_s, mains_Hz)
        if better is not None:
            kept, best = again, better
    return _said(best, time_s, voltage_V, kept, mains_Hz)


@dataclass(frozen=True)
class _Found:
    """A minimum of the search."""

    omega: float
    decay: float
    slow: float
    linear: Array
    residual: Array
    inverse: Array
    columns: int
    chirp: tuple[float, float]

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)


def _search(
    t: Array,
    y: Array,
    start: tuple[float, float],
    baseline_decay_per_s: float | None,
    mains_Hz: float | None,
) -> _Found | None:
    """Go down from a start by damped Gauss-Newton; None where it ends at no tone."""
    omega, decay = start
    span_s = float(t[-1] - t[0])
    largest = np.pi / float(np.median(np.diff(t)))
    damping, before = 1e-3, np.inf
    state = None
    for _ in range(MOST_ITERATIONS):
        state = project(t, y, omega, decay, baseline_decay_per_s, mains_Hz)
        before = state.cost
        scale = np.linalg.norm(state.slopes, axis=0)
        if not bool(np.all(scale > 0.0)):
            return None
        small = state.slopes / scale
        normal, right = small.T @ small, small.T @ state.residual
        for _ in range(12):
            step = np.linalg.solve(normal + damping * np.eye(2), right) / scale
            new_omega, new_decay = omega + float(step[0]), decay + float(step[1])
            if new_decay > 0.0 and 0.0 < new_omega < largest:
                after = project(t, y, new_omega, new_decay, baseline_decay_per_s, mains_Hz)
                if after.cost <= before:
                    break
            damping *= 8.0
        else:
            break
        omega, decay, damping = new_omega, new_decay, 0.1 * damping
        moved = max(abs(step[0]) / omega, abs(step[1]) / decay)
        if moved < STEP_ENOUGH or before - after.cost <= 1e-12 * before:
            break
    if omega * span_s < np.pi or decay * span_s < 0.05:
        return None
    state = project(t, y, omega, decay, baseline_decay_per_s, mains_Hz)
    normal = state.slopes.T @ state.slopes
    if not np.all(np.isfinite(normal)) or np.linalg.cond(normal) > 1e20:
        return None
    return _Found(
        omega,
        decay,
        state.slow,
        state.linear,
        state.residual,
        np.asarray(np.linalg.inv(normal), dtype=np.float64),
        state.columns,
        chirp_of(state, t, omega, decay),
    )


def _wild(residual: Array) -> Mask:
    """Return which residuals stand far out of their neighbours; none where there are too many.

    What a wrong model leaves is as large in the neighbours.
    """
    beside = np.median(sliding_window_view(np.pad(residual, 2, mode="edge"), 5), axis=1)
    out = residual - beside
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    found: Mask = (np.abs(out) > WILD * spread) & (np.abs(residual) > WILD * spread)
    if spread <= 0.0 or found.mean() > MOST_WILD:
        return np.zeros(len(residual), dtype=bool)
    return found


def _said(
    found: _Found, time_s: Array, voltage_V: Array, kept: Mask, mains_Hz: float | None
) -> ToneFit:
    freedom = max(int(kept.sum()) - found.columns - 2, 1)
    noise = float(np.sqrt(found.cost / freedom))
    model = design_of(time_s, found.omega, found.decay, found.slow, mains_Hz) @ found.linear
    linear = found.linear
    return ToneFit(
        omega_rad_per_s=found.omega,
        omega_u=noise * float(np.sqrt(found.inverse[0, 0])),
        decay_per_s=found.decay,
        decay_u=noise * float(np.sqrt(found.inverse[1, 1])),
        cosine_V=float(linear[0]),
        sine_V=float(linear[1]),
        baseline_V=float(linear[2]),
        baseline_decay_per_s=found.slow,
        offset_V=float(linear[3]),
        mains_V=float(np.hypot(*linear[4:6])) if mains_Hz is not None else 0.0,
        noise_V=noise,
        degrees_of_freedom=freedom,
        chirp=found.chirp[0],
        chirp_u=found.chirp[1],
        kept=kept,
        residual_V=voltage_V - model,
        model_V=model,
    )


def pooled_chirp(fits: Sequence[ToneFit]) -> tuple[float, float]:
    """Return the weighted mean of the shots' chirps and its standard uncertainty."""
    told = [fit for fit in fits if np.isfinite(fit.chirp_u) and fit.chirp_u > 0.0]
    if not told:
        return 0.0, np.inf
    weights = np.array([fit.chirp_u**-2 for fit in told])
    values = np.array([fit.chirp for fit in told])
    return float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)
