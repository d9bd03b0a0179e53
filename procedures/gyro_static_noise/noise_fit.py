"""Noise, ramp and lines of one axis by restricted maximum likelihood, all long records together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from procedures.estimation.rate_spectrum import coefficients, noise_variances
from procedures.estimation.reml import Components, Solved, Stretch, fit, profile_interval, solve

from .bridging import bridged
from .dataset import SECONDS_PER_HOUR, Array
from .lines import Line, centred_times, line_columns, strongest_line
from .rounding import BLOCKS, WHITE_FROM, beats, rounding_variances

FEWEST = 40
"""Samples of a record below which it says nothing about noise."""
MAX_LINES = 10
BAND = 0.25
"""Part of an output's bandwidth up to which it passes noise as it is."""
WALK_ALLOWED = 0.7
"""Standard uncertainties by which the random walk may be larger, for u of the ramp."""
SAWTOOTH_U = 2.0
ROUNDS = 3
WHITE = 1e9


@dataclass(frozen=True)
class NoiseFit:
    """The squares theta (4,) of Q, N, B, K in arcsec, deg/h sqrt(s), deg/h, deg/h/sqrt(s).

    Q holds the rounding of pulses; its u is infinite where the output's band hides it. `intervals`
    (4, 2) are of the squares, 95 %. `sawtooth` says that roundings follow one another. `solved` are
    the sizes of ramp and lines in each of the `pieces`.
    """

    theta: Array
    covariance: Array
    intervals: Array
    ramp: float
    ramp_u: float
    lines: tuple[Line, ...]
    pieces: tuple[Array, ...]
    solved: tuple[Solved, ...]
    sawtooth: bool
    bandwidth_Hz: float | None = None

    @property
    def quantisation_seen(self) -> bool:
        """Whether quantisation noise is not hidden by the output's band."""
        return self.bandwidth_Hz is None

    @property
    def doubled(self) -> float:
        """By what u is larger where roundings follow one another: they are no normal noise."""
        return SAWTOOTH_U if self.sawtooth else 1.0

    def kept(self, count: int, interval_s: float) -> int:
        """Return how many coefficients of a record of `count` samples have the model's noise."""
        return kept_coefficients(count, interval_s, self.bandwidth_Hz)

    @property
    def u(self) -> Array:
        """The standard uncertainties (4,) of the squares."""
        return np.sqrt(np.diag(self.covariance))

    def columns(self, count: int, interval_s: float) -> Array:
        """Return ramp, per deg/h^2, and lines of a record of `count` samples, (count, p)."""
        time_s = centred_times(count, interval_s)
        return drift_columns(time_s, [line.frequency_Hz for line in self.lines])


def kept_coefficients(count: int, interval_s: float, bandwidth_Hz: float | None) -> int:
    """Return how many coefficients of a record lie where the output passes noise as it is."""
    if bandwidth_Hz is None:
        return count - 1
    return max(2, min(count - 1, int(2.0 * BAND * bandwidth_Hz * count * interval_s)))


def drift_columns(time_s: Array, frequencies_Hz: Sequence[float]) -> Array:
    """Return ramp, per deg/h^2, and lines at times (n,) from a record's middle, (n, p)."""
    return np.column_stack([time_s / SECONDS_PER_HOUR, *line_columns(time_s, frequencies_Hz)])


@dataclass(frozen=True)
class Pieces:
    """Records on their grids, NaN in gaps, and all that is known of how they were measured."""

    rates: tuple[Array, ...]
    interval_s: float
    pulse: float
    bandwidth_Hz: float | None
    _parts: dict[int, Array] = field(default_factory=dict)

    def kept(self, count: int) -> int:
        """Return how many coefficients of a record of `count` samples are used."""
        return kept_coefficients(count, self.interval_s, self.bandwidth_Hz)

    def parts(self, count: int) -> Array:
        """Return the variances of unit noises; without Q where the band hides it."""
        if count not in self._parts:
            first = 0 if self.bandwidth_Hz is None else 1
            self._parts[count] = noise_variances(count, self.interval_s)[first:, : self.kept(count)]
        return self._parts[count]

    def stretches(
        self, filled: Sequence[Array], walk: float, lines: Sequence[float] = ()
    ) -> list[Stretch]:
        """Return the records as coefficients; `walk` is N, `lines` are frequencies in Hz."""
        stretches = []
        for rate in filled:
            count = len(rate)
            kept = self.kept(count)
            time_s = centred_times(count, self.interval_s)
            columns = drift_columns(time_s, lines)
            centre = float(np.mean(rate))
            blocks = np.array([float(np.mean(block)) for block in np.array_split(rate, BLOCKS)])
            rest = rounding_variances(count, self.interval_s, self.pulse, walk, blocks)
            stretches.append(
                Stretch(
                    coefficients(rate - centre)[:kept],
                    self.parts(count),
                    rest[:kept],
                    coefficients(columns)[:kept],
                )
            )
        return stretches

    def bridged(self, theta: Array) -> tuple[Array, ...]:
        """Return the records with their gaps filled."""
        return tuple(bridged(rate, self.interval_s, theta, self.pulse) for rate in self.rates)


def noise_records(pieces: Sequence[Array]) -> tuple[Array, ...]:
    """Return the records that give the noise: at least half as long as the longest."""
    longest = max((len(piece) for piece in pieces), default=0)
    return tuple(piece for piece in pieces if len(piece) >= max(FEWEST, 0.5 * longest))


def fit_noise(pieces: Pieces, periodic_chance: float) -> NoiseFit | None:
    """Return the noise of one axis; None where no record is long enough."""
    if not pieces.rates:
        return None
    theta = _guess(pieces)
    gappy = any(not np.isfinite(rate).all() for rate in pieces.rates)
    filled, walk = pieces.bridged(theta), WHITE
    for _ in range(ROUNDS if gappy or pieces.pulse else 1):
        stretches = pieces.stretches(filled, walk)
        best = fit(stretches)
        theta = _whole(best, pieces)[0]
        if gappy:
            filled = pieces.bridged(theta)
        if pieces.pulse:
            walk = float(np.sqrt(theta[1]))
    count = sum(len(record) for record in filled)
    lines: list[float] = []
    sawtooth = bool(pieces.pulse and _is_sawtooth(walk, pieces))
    # Roundings that follow one another are no normal noise: their u is doubled everywhere.
    needed = 2.0 * np.log(count / periodic_chance) * (SAWTOOTH_U**2 if sawtooth else 1.0)
    own = [beats(rate, pieces.interval_s, pieces.pulse, walk) for rate in filled if sawtooth]
    for _ in range(MAX_LINES):
        candidate = strongest_line(best, pieces.interval_s, [len(r) for r in filled], own)
        if candidate is None:
            break
        wider = pieces.stretches(filled, walk, [*lines, candidate])
        again = fit(wider, best.theta)
        if best.deviance - again.deviance <= needed:
            break
        lines, stretches, best = [*lines, candidate], wider, again
    return _concluded(pieces, filled, stretches, best, lines, walk)


def _is_sawtooth(walk: float, pieces: Pieces) -> bool:
    """Return whether noise moves the angle by so little that its roundings follow one another."""
    return walk * float(np.sqrt(pieces.interval_s)) < WHITE_FROM * pieces.pulse


def _concluded(
    pieces: Pieces,
    filled: tuple[Array, ...],
    stretches: list[Stretch],
    best: Components,
    lines: list[float],
    walk: float,
) -> NoiseFit:
    theta, covariance = _whole(best, pieces)
    sawtooth = bool(pieces.pulse and _is_sawtooth(walk, pieces))
    if sawtooth:
        covariance[0] *= SAWTOOTH_U
        covariance[:, 0] *= SAWTOOTH_U
    u = np.sqrt(np.diag(covariance))
    intervals = np.column_stack([np.maximum(theta - 1.96 * u, 0.0), theta + 1.96 * u])
    for number in (2, 3):
        own = number - (4 - len(best.theta))
        intervals[number] = profile_interval(stretches, best, own)
    theta[0] += pieces.pulse**2 / 12.0
    intervals[0] = np.maximum(theta[0] + np.array([-1.96, 1.96]) * u[0], 0.0)
    ramp, ramp_u = _ramp(stretches, best)
    sizes = [record.sizes[1:].reshape(-1, 2) for record in best.solved]
    fitted_lines = tuple(
        Line.of(f, [size[n] for size in sizes], pieces.interval_s) for n, f in enumerate(lines)
    )
    return NoiseFit(
        theta,
        covariance,
        intervals,
        ramp,
        ramp_u,
        fitted_lines,
        filled,
        best.solved,
        sawtooth,
        pieces.bandwidth_Hz,
    )


def _whole(best: Components, pieces: Pieces) -> tuple[Array, Array]:
    """Return theta (4,) and its covariance, Q zero and not known where the band hides it."""
    if pieces.bandwidth_Hz is None:
        return best.theta.copy(), best.covariance.copy()
    covariance = np.zeros((4, 4))
    covariance[1:, 1:] = best.covariance
    return np.r_[0.0, best.theta], covariance


def _ramp(stretches: Sequence[Stretch], best: Components) -> tuple[float, float]:
    """Return the mean ramp of all records and its u, random walk larger by part of its own u."""
    more = best.theta.copy()
    more[-1] += WALK_ALLOWED * best.u[-1]
    ramps = np.array([record.sizes[0] for record in best.solved])
    variance = np.array(
        [solve(stretch, stretch.variance(more)).covariance[0, 0] for stretch in stretches]
    )
    weight = 1.0 / variance
    return float(weight @ ramps / weight.sum()), float(1.0 / np.sqrt(weight.sum()))


def _guess(pieces: Pieces) -> Array:
    """Return a first theta for the bridging of gaps: what neighbours differ by, taken as white."""
    steps = np.concatenate([np.diff(rate) for rate in pieces.rates])
    size = float(np.nanmean(steps**2))
    squares = np.array([0.0, 0.5 * size * pieces.interval_s, 0.0, 0.0])
    return np.asarray(squares + np.array([0.0, 1e-12, 0.0, 0.0]))
