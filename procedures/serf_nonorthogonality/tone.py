"""One shot: a decaying tone with decaying baseline, offset and mains, by variable projection.

    S(t) = e^(-G t) (a cos wt + b sin wt) + C e^(-g t) + D + mains

Only w and G are searched for; the other coefficients are linear and follow from them (Golub and
Pereyra 1973, derivatives after Kaufman 1975). Without the baseline, which is as large as the tone
where the field lies between pump and probe, the frequency is wrong by degrees of coil angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from procedures.estimation.descent import Place, descend, inverse_of
from procedures.estimation.linear import robust_sigma
from procedures.estimation.sine import line_columns

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FIRST_LOOK, MAX_STEPS = 5, 40
MIN_SAMPLES = 16
WILD = 6.0
MAX_WILD = 0.05
MIN_TURN_RAD, MIN_DECAYS = np.pi, 0.05
"""Of a tone within its record, in rad and 1/e times."""
SHARES_OF_SPAN = (1.5, 4.0, 10.0, 25.0, 60.0, 150.0)
"""Decays to begin with, in 1/e times that the record holds."""
MIN_SAMPLES_OF_DECAY = 12
"""Within the 1/e time of a decay to begin with."""
PADDING = 4
MAX_STARTS = 4
APART = 1.5
"""How far two starts lie apart, in widths of the record's spectrum or of the decay."""


class NoTone(ValueError):
    """A record that holds no decaying tone; the message says what it holds."""


class Effect(NamedTuple):
    """What may act beside a fit: its value, its u, what the frequency in rad/s changes by with it.

    u is infinite where the record does not show it.
    """

    value: float
    u: float
    moves: float


@dataclass(frozen=True)
class ToneFit:
    """What the fit of a shot says; angular frequency and rates in rad/s and 1/s, the rest in V.

    `sine_V` and `cosine_V` are the parts of the tone at time zero, `baseline_V` is that of the
    baseline; `noise_V` the standard deviation of a sample. `chirp` is by how much the frequency is
    higher at the beginning than in the end, relative, to first order; `rate_per_s` the decay that
    the baseline itself shows; `drift_per_s` a steady drift of the frequency, relative, beside a
    chirp. `kept` (n,) marks the samples that were used, `residual_V` is what is left of these.
    """

    omega_rad_per_s: float
    omega_u: float
    decay_per_s: float
    decay_u: float
    cosine_V: float
    sine_V: float
    baseline_V: float
    noise_V: float
    degrees_of_freedom: int
    chirp: Effect
    rate_per_s: Effect
    drift_per_s: Effect
    kept: Mask
    residual_V: Array

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


@dataclass(frozen=True)
class Projection:
    """The linear part of a fit: what of a record, and of slopes, the columns do not take up.

    `rows` (k, n) are the columns, `linear` (k,) their coefficients, `inverse` (k, k) that of their
    products, `residual_V` (n,) what is left.
    """

    rows: Array
    linear: Array
    inverse: Array
    residual_V: Array

    @property
    def tone_V(self) -> Array:
        """The tone (n,)."""
        return np.asarray(self.linear[:2] @ self.rows[:2])

    @property
    def turned_V(self) -> Array:
        """The derivative of the tone by its phase (n,)."""
        return np.asarray(self.linear[1] * self.rows[0] - self.linear[0] * self.rows[1])

    @property
    def baseline_V(self) -> Array:
        """The decaying baseline (n,)."""
        return np.asarray(self.linear[2] * self.rows[2])

    def beside(self, slopes: Sequence[Array]) -> Array:
        """Return what of slopes (m, n) is their own."""
        own = np.array(slopes)
        return np.asarray(own - own @ self.rows.T @ self.inverse @ self.rows)


def project(
    t: Array, clock: Array, y: Array, tone: tuple[float, float, float], mains_Hz: float | None
) -> Projection | None:
    """Return the linear part of the fit of a record `y` (n,) at times `t` (n,), mains in these.

    `tone` is w, g, the decay of the baseline, both in the time of `clock` (n,), and by how much
    faster the tone decays, in `t`. None where the columns do not differ.
    """
    omega, slow, faster = tone
    base, turn = np.exp(-slow * clock), omega * clock
    fade = base * np.exp(-faster * t) if faster else base
    rows = [fade * np.cos(turn), fade * np.sin(turn), base, np.ones_like(t)]
    if mains_Hz is not None:
        rows += [*line_columns(t, [mains_Hz]).T]
    columns = np.array(rows)
    inverse = inverse_of(columns @ columns.T)
    if inverse is None:
        return None
    linear = inverse @ (columns @ y)
    return Projection(columns, linear, inverse, y - linear @ columns)


def last_of(slopes: Array, residual: Array, noise: float) -> Effect:
    """Return the last unknown of slopes (k, n), and what it does to the first one."""
    inverse = inverse_of(slopes @ slopes.T)
    if inverse is None:
        return Effect(0.0, np.inf, 0.0)
    value, square = float(inverse[-1] @ (slopes @ residual)), float(inverse[-1, -1])
    return Effect(value, noise * float(np.sqrt(square)), float(inverse[0, -1]) / square)


@dataclass(frozen=True)
class _Record:
    """Samples (n,) that count; the baseline decays with `slow_per_s`, or as fast as the tone."""

    t: Array
    y: Array
    slow_per_s: float | None
    mains_Hz: float | None

    def at(self, place: Array) -> Place[tuple[Projection, Array]] | None:
        """Return the linear part and the slopes (2, n) at w and G; None where no tone has these."""
        omega, decay = (float(value) for value in place)
        if not (decay > 0.0 and 0.0 < omega < np.pi / float(np.median(np.diff(self.t)))):
            return None
        slow = decay if self.slow_per_s is None else self.slow_per_s
        linear = project(self.t, self.t, self.y, (omega, slow, decay - slow), self.mains_Hz)
        if linear is None:
            return None
        fading = linear.tone_V + (linear.baseline_V if self.slow_per_s is None else 0.0)
        slopes = linear.beside([self.t * linear.turned_V, -self.t * fading])
        return Place.of(slopes, linear.residual_V, (linear, slopes))

    def settled(self, start: Array, kept: Mask) -> ToneFit | None:
        """Return the fit that a start leads to; None where that is no decaying tone."""
        minimum = descend(self.at, start, MAX_STEPS)
        if minimum is None:
            return None
        (omega, decay), step = minimum[0].tolist(), minimum[1]
        linear, own = step.what
        inverse, span_s = inverse_of(step.normal), float(self.t[-1] - self.t[0])
        if inverse is None or omega * span_s < MIN_TURN_RAD or decay * span_s < MIN_DECAYS:
            return None
        left, t = linear.residual_V, self.t
        freedom = max(len(t) - len(linear.linear) - 2, 1)
        noise = float(np.sqrt(step.cost / freedom))
        u = noise * np.sqrt(np.diag(inverse))
        # Of a fading polarisation: both rates are larger by the share c e^(-2 G t).
        early = -np.expm1(-2.0 * decay * t) / (2.0 * decay)
        further = [
            early * (omega * linear.turned_V - decay * linear.tone_V),
            -t * linear.baseline_V,
            0.5 * omega * t**2 * linear.turned_V,
        ]
        slopes = np.vstack([own, linear.beside(further)])
        chirp, slower, drift = (
            last_of(slopes[which], left, noise) for which in ([0, 1, 2], [0, 1, 3], [0, 1, 2, 4])
        )
        rate = Effect(decay + slower.value, np.inf, slower.moves)
        if self.slow_per_s is not None:
            rate = slower._replace(value=self.slow_per_s + slower.value)
        cosine, sine, baseline = (float(value) for value in linear.linear[:3])
        return ToneFit(
            omega_rad_per_s=omega,
            omega_u=float(u[0]),
            decay_per_s=decay,
            decay_u=float(u[1]),
            cosine_V=cosine,
            sine_V=sine,
            baseline_V=baseline,
            noise_V=noise,
            degrees_of_freedom=freedom,
            chirp=chirp,
            rate_per_s=rate,
            drift_per_s=drift,
            kept=kept,
            residual_V=left,
        )


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

    def record(kept: Mask) -> _Record:
        return _Record(time_s[kept], voltage_V[kept], baseline_decay_per_s, mains_Hz)

    whole = record(kept)
    if float(np.ptp(whole.y)) == 0.0:
        raise NoTone("the signal does not change")
    starts = [start] if start is not None else starting_points(whole.t, whole.y, mains_Hz)
    begun = [descend(whole.at, np.array(place), FIRST_LOOK) for place in starts]
    # The one that is ahead after a few steps is the right one, unless it ends at no tone.
    ahead = sorted((some for some in begun if some is not None), key=lambda some: some[1].cost)
    best = next((fit for place, _ in ahead if (fit := whole.settled(place, kept))), None)
    if best is None:
        raise NoTone("no decaying tone fits the record")
    wild = wild_samples(best.residual_V)
    if wild.any():
        fewer = kept.copy()
        fewer[np.flatnonzero(kept)[wild]] = False
        place = np.array([best.omega_rad_per_s, best.decay_per_s])
        best = record(fewer).settled(place, fewer) or best
    return best


def starting_points(t: Array, y: Array, mains_Hz: float | None) -> list[tuple[float, float]]:
    """Return up to four pairs of angular frequency and decay, the most promising first.

    For each decay of a grid the record, freed from offset and from baselines of this decay and its
    half, is weighted with that decay: the matched filter of the tone. Uneven samples count as even.
    """
    count = len(t)
    interval_s = float(t[-1] - t[0]) / (count - 1)
    span_s = count * interval_s
    length = PADDING * int(2 ** np.ceil(np.log2(count)))
    frequency = 2.0 * np.pi * np.fft.rfftfreq(length, interval_s)
    since = t - t[0]
    starts: list[tuple[float, float, float]] = []
    for decay in np.array(SHARES_OF_SPAN) / span_s:
        if decay * interval_s * MIN_SAMPLES_OF_DECAY > 1.0:
            break
        weight = np.exp(-decay * since)
        columns = [np.ones(count), weight, np.exp(-0.5 * decay * since)]
        if mains_Hz is not None:
            columns += [*line_columns(t, [mains_Hz]).T]
        basis, _ = np.linalg.qr(np.column_stack(columns))
        left = (y - basis @ (basis.T @ y)) * weight
        power = np.abs(np.fft.rfft(left, length)) ** 2 / float(weight @ weight)
        width = APART * max(2.0 * np.pi / span_s, decay)
        # Below one cycle in the record there is no tone; nor at the very end of the spectrum.
        power[frequency < 2.0 * np.pi * 0.7 / span_s] = 0.0
        power[-2:] = 0.0
        for _ in range(3):
            k = int(np.argmax(power))
            if power[k] <= 0.0:
                break
            starts.append((float(power[k]), float(frequency[k]), float(decay)))
            power[np.abs(frequency - frequency[k]) < width] = 0.0
    chosen: list[tuple[float, float]] = []
    for _, omega, decay in sorted(starts, reverse=True):
        near = 2.0 * np.pi * APART / span_s
        if all(abs(omega - other) > near or decay != same for other, same in chosen):
            chosen.append((omega, decay))
    return chosen[:MAX_STARTS]


def wild_samples(residual: Array) -> Mask:
    """Return which residuals stand far out of their neighbours; none where there are too many.

    What a wrong model leaves is as large in the neighbours.
    """
    beside = np.median(sliding_window_view(np.pad(residual, 2, mode="edge"), 5), axis=1)
    limit = WILD * robust_sigma(residual)
    wild: Mask = (np.abs(residual - beside) > limit) & (np.abs(residual) > limit)
    return wild if limit > 0.0 and wild.mean() <= MAX_WILD else wild & False


def pooled(effects: Sequence[Effect]) -> tuple[float, float]:
    """Return the weighted mean over several shots, and its u; infinite where none shows it."""
    value, u, _ = np.array(effects).reshape(-1, 3).T
    known = np.isfinite(u) & (u > 0.0)
    if not known.any():
        return 0.0, np.inf
    weight = u[known] ** -2.0
    return float(weight @ value[known] / weight.sum()), float(weight.sum() ** -0.5)
