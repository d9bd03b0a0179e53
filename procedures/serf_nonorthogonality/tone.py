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

from .tone_search import Minimum, descend, minimum_from, rows_of, starting_points

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FIRST_LOOK = 5
MIN_SAMPLES = 16
WILD = 6.0
MAX_WILD = 0.05


@dataclass(frozen=True)
class ToneFit:
    """What the fit of a shot says; angular frequency and rates in rad/s and 1/s, the rest in V.

    `amplitude_V` is that of the tone at time zero, `sine_V` and `cosine_V` its parts; `chirp` is by
    how much the frequency is higher at the beginning than in the end, relative, to first order, and
    `omega_by_chirp` by how much the frequency in the end is off where that is left aside;
    `own_rate_per_s` is the decay that the baseline itself shows, `omega_by_rate` what the frequency
    changes by with the decay that it was given; `drift_per_s` is a steady drift of the frequency,
    relative, beside a chirp. `kept` (n,) marks the samples that were used,
    `residual_V` (n,) what is left of every one.
    """

    omega_rad_per_s: float
    omega_u: float
    decay_per_s: float
    decay_u: float
    cosine_V: float
    sine_V: float
    baseline_V: float
    offset_V: float
    mains_V: float
    noise_V: float
    degrees_of_freedom: int
    chirp: float
    chirp_u: float
    omega_by_chirp: float
    own_rate_per_s: float
    own_rate_u: float
    omega_by_rate: float
    drift_per_s: float
    drift_u: float
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
    if int(kept.sum()) < MIN_SAMPLES:
        raise NoTone(f"{int(kept.sum())} usable samples are too few")
    t, y = time_s[kept], voltage_V[kept]
    if float(np.ptp(y)) == 0.0:
        raise NoTone("the signal does not change")
    places = [start] if start is not None else starting_points(t, y, mains_Hz)
    begun = [descend(t, y, place, baseline_decay_per_s, mains_Hz, FIRST_LOOK) for place in places]
    ahead = sorted(
        (minimum for minimum in begun if minimum is not None), key=lambda minimum: minimum[2]
    )
    best = None
    for omega, decay, _ in ahead:
        # The one that is ahead after a few steps is the right one, unless it ends at no tone.
        best = minimum_from(t, y, (omega, decay), baseline_decay_per_s, mains_Hz)
        if best is not None:
            break
    if best is None:
        raise NoTone("no decaying tone fits the record")
    wild = wild_samples(y - _model(t, best, mains_Hz))
    if wild.any():
        again = kept.copy()
        again[np.flatnonzero(kept)[wild]] = False
        t, y = time_s[again], voltage_V[again]
        better = minimum_from(t, y, (best.omega, best.decay), baseline_decay_per_s, mains_Hz)
        if better is not None:
            kept, best = again, better
    return _said(best, time_s, voltage_V, kept, mains_Hz)


def _model(t: Array, minimum: Minimum, mains_Hz: float | None) -> Array:
    return np.asarray(
        minimum.linear @ rows_of(t, minimum.omega, minimum.decay, minimum.slow, mains_Hz)
    )


def wild_samples(residual: Array) -> Mask:
    """Return which residuals stand far out of their neighbours; none where there are too many.

    What a wrong model leaves is as large in the neighbours.
    """
    beside = np.median(sliding_window_view(np.pad(residual, 2, mode="edge"), 5), axis=1)
    out = residual - beside
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    wild: Mask = (np.abs(out) > WILD * spread) & (np.abs(residual) > WILD * spread)
    if spread <= 0.0 or wild.mean() > MAX_WILD:
        return np.zeros(len(residual), dtype=bool)
    return wild


def _said(
    minimum: Minimum, time_s: Array, voltage_V: Array, kept: Mask, mains_Hz: float | None
) -> ToneFit:
    model = _model(time_s, minimum, mains_Hz)
    # From the residuals themselves: their sum of squares as a difference is less exact.
    left = (voltage_V - model)[kept]
    noise = float(np.sqrt(left @ left / minimum.freedom))
    linear = minimum.linear
    return ToneFit(
        omega_rad_per_s=minimum.omega,
        omega_u=noise * float(np.sqrt(minimum.inverse[0, 0])),
        decay_per_s=minimum.decay,
        decay_u=noise * float(np.sqrt(minimum.inverse[1, 1])),
        cosine_V=float(linear[0]),
        sine_V=float(linear[1]),
        baseline_V=float(linear[2]),
        offset_V=float(linear[3]),
        mains_V=float(np.hypot(*linear[4:6])) if mains_Hz is not None else 0.0,
        noise_V=noise,
        degrees_of_freedom=minimum.freedom,
        chirp=minimum.chirp[0],
        chirp_u=minimum.chirp[1],
        omega_by_chirp=minimum.chirp[2],
        own_rate_per_s=minimum.rate[0],
        own_rate_u=minimum.rate[1],
        omega_by_rate=minimum.rate[2],
        drift_per_s=minimum.drift[0],
        drift_u=minimum.drift[1],
        kept=kept,
        residual_V=voltage_V - model,
        model_V=model,
    )


def pooled_chirp(fits: Sequence[ToneFit]) -> tuple[float, float]:
    """Return the weighted mean of the shots' chirps and its standard uncertainty."""
    return pooled([fit.chirp for fit in fits], [fit.chirp_u for fit in fits])


def pooled(values: Sequence[float], u: Sequence[float]) -> tuple[float, float]:
    """Return the weighted mean over several shots, and its u; infinite where none does."""
    value, size = np.array(values), np.array(u)
    known = np.isfinite(size) & (size > 0.0)
    if not known.any():
        return 0.0, np.inf
    weight = size[known] ** -2.0
    return float(weight @ value[known] / weight.sum()), float(weight.sum() ** -0.5)
