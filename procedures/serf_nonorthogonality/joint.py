"""All shots in one fit, for a polarisation that changes the frequency while it fades.

Shared are the polarisation at time zero, the relaxation and the broadening by spin exchange; each
shot has its own frequency in the end, and its own linear coefficients as in `tone`. How the
frequency falls depends on the angle between field and pump light, which the caller knows from the
angles solved so far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.descent import Place, descend, inverse_of

from .shots import SlowingDown
from .spin_motion import clocks, decay_line
from .tone import Effect, NoTone, Projection, ToneFit, fit_tone, last_of, project

Array = NDArray[np.float64]

SHARED = 3
MAX_STEPS = 25
SQUARES = (0.03, 0.08, 0.15, 0.25, 0.36, 0.5, 0.68, 0.85)
"""P² to begin with."""
LOWEST_SQUARE, HIGHEST_SQUARE = -0.2, 0.999


@dataclass(frozen=True)
class Record:
    """A shot as the joint fit takes it: usable samples only, and the deviation of one, in V."""

    time_s: Array
    voltage_V: Array
    noise_V: float


@dataclass(frozen=True)
class JointFit:
    """What all shots say together.

    `unknowns` are P² at time zero, R/q(0) in 1/s, the broadening over w² in s, and the frequencies
    (shots,) in the end, with their covariance; `residual_V` are in the records' order;
    `chi_square` is of all samples. `baseline_over_tone` (shots,) compares the amplitudes at time
    zero; `by_late_start` (shots,) are derivatives of the frequencies, in rad/s², by a time zero of
    the own record that came later than its time stamps say; `drift_per_s` is a steady drift of the
    frequency of each shot, relative, which nothing of the model follows; `decay_per_s` how fast
    its tone fades by itself.
    """

    unknowns: Array
    covariance: Array
    residual_V: tuple[Array, ...]
    baseline_over_tone: Array
    baseline_over_tone_u: Array
    by_late_start: Array
    drift_per_s: tuple[Effect, ...]
    decay_per_s: tuple[Effect, ...]
    chi_square: float

    @property
    def square(self) -> float:
        """P² at time zero."""
        return float(self.unknowns[0])

    @property
    def rate_per_s(self) -> float:
        """R/q(0)."""
        return float(self.unknowns[1])

    @property
    def beta_s(self) -> float:
        """The broadening over w²."""
        return float(self.unknowns[2])

    @property
    def omega_rad_per_s(self) -> Array:
        """The frequencies (shots,) in the end."""
        return self.unknowns[SHARED:]

    @property
    def polarisation(self) -> float:
        """The polarisation at time zero."""
        return float(np.sqrt(max(self.square, 0.0)))


class NoJointFit(ValueError):
    """The joint fit found no minimum."""


@dataclass(frozen=True)
class JointModel:
    """Shots of one cell; `along` (shots,) squares of the cosine between field and pump light."""

    records: Sequence[Record]
    spin: SlowingDown
    along: Array
    mains_Hz: float | None

    def fit(self, start: Array) -> JointFit:
        """Fit all records from unknowns as a `JointFit` has them. Raises NoJointFit."""
        minimum = descend(self._at, start, MAX_STEPS)
        # What is eliminated of the shots' own parameters is in the inverse of the whole.
        covariance = None if minimum is None else inverse_of(minimum[1].normal)
        if minimum is None or covariance is None:
            raise NoJointFit("a parameter has no influence")
        unknowns, step = minimum
        ratio, ratio_u, late, drift, decay = [], [], [], [], []
        shots = zip(self.records, step.what, unknowns[SHARED:].tolist(), strict=True)
        for record, (linear, slopes), omega in shots:
            left, noise = linear.residual_V, record.noise_V
            size = float(np.hypot(*linear.linear[:2]))
            ratio.append(linear.linear[2] / size)
            ratio_u.append(noise * np.sqrt(linear.inverse[2, 2]) / size)
            late.append(last_of(slopes[[3, 4]], left, noise).moves)
            drift.append(last_of(slopes[[0, 1, 2, 3, 5]], left, noise))
            faster = last_of(slopes[[3, 6]], left, noise)
            usual = float(unknowns[1] + unknowns[2] * omega**2)
            decay.append(faster._replace(value=usual + faster.value))
        return JointFit(
            unknowns=unknowns,
            covariance=covariance,
            residual_V=tuple(linear.residual_V for linear, _ in step.what),
            baseline_over_tone=np.array(ratio),
            baseline_over_tone_u=np.array(ratio_u),
            by_late_start=np.array(late),
            drift_per_s=tuple(drift),
            decay_per_s=tuple(decay),
            chi_square=step.cost,
        )

    def start(self, fits: Sequence[ToneFit]) -> Array:
        """Return where the joint fit begins, from the fits of the shots alone.

        In the time of the right clock each shot is a tone of one frequency. The clock of each P² of
        a grid is tried on the shot with the most signal; then all shots are fitted in the time of
        the best. Raises NoJointFit.
        """
        strongest = int(np.argmax([fit.signal_to_noise for fit in fits]))
        rate = float(np.median([fit.decay_per_s for fit in fits])) * 0.85
        tried = [(self._in_its_time(strongest, square, rate), square) for square in SQUARES]
        tones = [(fit, square) for fit, square in tried if fit is not None]
        if not tones:
            raise NoJointFit("no polarisation explains the strongest shot")
        best, square = min(tones, key=lambda tone: tone[0].noise_V)
        rate = 0.9 * best.decay_per_s
        slower = best.omega_rad_per_s / fits[strongest].omega_rad_per_s
        omega, decay = [], []
        for k, fit in enumerate(fits):
            near = slower * fit.omega_rad_per_s, best.decay_per_s
            own = self._in_its_time(k, square, rate, near)
            if own is None:
                raise NoJointFit(f"shot {k + 1} is no tone in the time of its polarisation")
            omega.append(own.omega_rad_per_s)
            decay.append(own.decay_per_s)
        line = decay_line(np.array(omega), np.array(decay), np.full(len(decay), 0.01 * rate))
        return np.array([square, max(line.rate_per_s, 1e-3), line.beta_s, *omega])

    def _in_its_time(
        self, shot: int, square: float, rate: float, near: tuple[float, float] | None = None
    ) -> ToneFit | None:
        """Return the fit of a shot in the time of its clock, None where it is no tone there."""
        record, along = self.records[shot], self.along[[shot]]
        ones = np.ones(1)
        (u,) = clocks(
            [record.time_s], self.spin, square * ones, rate * ones, 0.1 * rate * ones, along
        )
        try:
            return fit_tone(u, record.voltage_V, mains_Hz=self.mains_Hz, start=near)
        except NoTone:
            return None

    def _at(self, unknowns: Array) -> Place[list[tuple[Projection, Array]]] | None:
        """Return of each shot the linear part, and what its slopes (7, n) are beside it.

        By P², R/q(0), broadening and frequency; then by a late start, a drift, a faster decay.
        """
        square, rate, beta = (float(value) for value in unknowns[:SHARED])
        omega, count = unknowns[SHARED:], len(self.records)
        if not (LOWEST_SQUARE < square < HIGHEST_SQUARE and rate > 0.0 and np.all(omega > 0.0)):
            return None
        broad = beta * omega**2
        nudge = np.array([1e-4, 1e-4 * rate, 1e-3 * rate])
        # One integration for the place itself and for a nudge of P², of R/q(0) and of Gamma_se.
        squares = np.repeat([square, square + nudge[0], square, square], count)
        rates = np.repeat([rate, rate, rate + nudge[1], rate], count)
        broads = np.concatenate([broad, broad, broad, broad + nudge[2]])
        times = [record.time_s for record in self.records]
        phases = clocks(times * 4, self.spin, squares, rates, broads, np.tile(self.along, 4))
        normal, right = np.zeros((len(unknowns), len(unknowns))), np.zeros(len(unknowns))
        cost, shots = 0.0, []
        for k, record in enumerate(self.records):
            t, u, w = record.time_s, phases[k], float(omega[k])
            place = w, rate, float(broad[k])
            linear = project(t, u, record.voltage_V, place, self.mains_Hz)
            if linear is None:
                return None
            tone, turned = linear.tone_V, linear.turned_V
            fading = tone + linear.baseline_V
            by = [(phases[k + (n + 1) * count] - u) / nudge[n] for n in range(SHARED)]
            by_clock = w * turned - rate * fading
            by_broad = by_clock * by[2] - t * tone
            slopes = linear.beside(
                [
                    by_clock * by[0],
                    by_clock * by[1] - u * fading,
                    w**2 * by_broad,
                    u * turned + 2.0 * beta * w * by_broad,
                    broad[k] * tone - by_clock * np.gradient(u, t),
                    0.5 * w * t * u * turned,
                    -t * tone,
                ]
            )
            shots.append((linear, slopes))
            weight, left, own = record.noise_V**-2, linear.residual_V, slopes[: SHARED + 1]
            places = np.array([*range(SHARED), SHARED + k])
            normal[np.ix_(places, places)] += weight * (own @ own.T)
            right[places] += weight * (own @ left)
            cost += weight * float(left @ left)
        return Place(cost, normal, right, shots)
