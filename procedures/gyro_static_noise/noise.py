"""Noise, ramp and lines of one axis by restricted maximum likelihood, all long records together.

The noise of counted pulses is known: angles rounded while the gyro's noise moves them. Periodic
lines are the air conditioning, the gyro's dither, a neighbour.

Gaps are bridged by what the noise lets stand there: a missing sample is drawn from its distribution
given its neighbours. A mere interpolation would be too smooth, and cut the anticorrelation of
rounded angles, which then passes for white noise.

Bursts are blocks of a record that its noise cannot give, shifted for a while or scattering more, by
a score test over all places and many lengths. For a shift of length L the data weighted by the
inverse covariance are added up over the window; for scatter the squares of the residuals made white
are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.fft import next_fast_len, rfft
from scipy.linalg import toeplitz
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.rate_spectrum import (
    coefficients,
    covariances,
    in_time,
    noise_variances,
    variances,
)
from procedures.estimation.reml import Components, Solved, Stretch, fit, profile_interval, solve

from .dataset import Array, Record

FEWEST = 40
"""Samples of a record below which it says nothing about noise."""
BAND = 0.25
"""Part of an output's bandwidth up to which it passes noise as it is."""
WALK_ALLOWED = 0.7
"""Standard uncertainties by which the random walk may be larger, for u of the ramp."""
BANDS = 16
"""Parts of the frequencies in which the noise is held against the model."""
ROUNDS = 3
WHITE = 1e9

WHITE_FROM = 0.4
"""N sqrt(t0) over the pulse from which successive rounding errors are as good as independent."""
SAWTOOTH_U = 2.0
"""By what u is larger where roundings follow one another: they are no normal noise."""
MAX_HARMONICS, MAX_BEATS = 400, 8
NOTHING = 1e-12
BLOCKS = 16
"""Parts of a record in which the mean rate decides how roundings follow one another."""
SMEARED = 0.2
"""Cycles per sample over which a harmonic is spread at most to count as a beat."""
FADED = 10.0
"""Widths by which a beat reaches beyond the frequencies that the mean rate takes."""

MAX_LINES = 10
FEWEST_CYCLES = 2.0
WORTH_A_TRY = 12.0
"""Fall of -2 ln L, noise not fitted again, below which a line cannot be one."""
FINER = 2
AROUND, USUAL_FALL = 201, 2.0 * np.log(2.0)
"""Frequencies whose median fall a line is held against, and that of noise."""
ALONE = 40.0
"""Fall, over that of its neighbours, of a line in an output of roundings."""


@dataclass(frozen=True)
class Line:
    """A line of the rate: its frequency, and its amplitude, root mean square over the records."""

    frequency_Hz: float
    amplitude_deg_per_h: float


@dataclass(frozen=True)
class Pieces:
    """Records on their grids, NaN in gaps, and all that is known of how they were measured."""

    rates: tuple[Array, ...]
    interval_s: float
    pulse: float
    bandwidth_Hz: float | None
    _parts: dict[int, Array] = field(default_factory=dict)

    def kept(self, count: int) -> int:
        """Return how many coefficients of a record lie where the output passes noise as it is."""
        if self.bandwidth_Hz is None:
            return count - 1
        highest = int(2.0 * BAND * self.bandwidth_Hz * count * self.interval_s)
        return max(2, min(count - 1, highest))

    def parts(self, count: int) -> Array:
        """Return the variances of unit noises; without Q where the band hides it."""
        if count not in self._parts:
            first = 0 if self.bandwidth_Hz is None else 1
            self._parts[count] = noise_variances(count, self.interval_s)[first:, : self.kept(count)]
        return self._parts[count]

    def columns(self, count: int, frequencies_Hz: Sequence[float]) -> Array:
        """Return ramp, per deg/h^2, and lines of a record of `count` samples, (count, p)."""
        time_s = centred_times(count, self.interval_s)
        return np.column_stack([time_s / SECONDS_PER_HOUR, *line_columns(time_s, frequencies_Hz)])

    def stretches(
        self, filled: Sequence[Array], walk: float, lines: Sequence[float] = ()
    ) -> list[Stretch]:
        """Return the records as coefficients; `walk` is N, `lines` are frequencies in Hz."""
        stretches = []
        for rate in filled:
            count = len(rate)
            kept = self.kept(count)
            rest = rounding_variances(count, self.interval_s, self.pulse, walk, block_means(rate))
            stretches.append(
                Stretch(
                    coefficients(rate - float(np.mean(rate)))[:kept],
                    self.parts(count),
                    rest[:kept],
                    coefficients(self.columns(count, lines))[:kept],
                )
            )
        return stretches

    def bridged(self, theta: Array) -> tuple[Array, ...]:
        """Return the records with their gaps filled."""
        return tuple(bridged(rate, self.interval_s, theta, self.pulse) for rate in self.rates)

    def is_sawtooth(self, walk: float) -> bool:
        """Return whether noise moves the angle by so little that roundings follow one another."""
        return walk * float(np.sqrt(self.interval_s)) < WHITE_FROM * self.pulse


@dataclass(frozen=True)
class NoiseFit:
    """The squares theta (4,) of Q, N, B, K in arcsec, deg/h sqrt(s), deg/h, deg/h/sqrt(s).

    Q holds the rounding of pulses and is 0 where the output's band hides it. `intervals` (4, 2) are
    of the squares, 95 %. `sawtooth` says that roundings follow one another. `solved` are the sizes
    of ramp and lines in each of the `pieces`, records without gaps, that `known` were made of.
    """

    known: Pieces
    theta: Array
    covariance: Array
    intervals: Array
    ramp: float
    ramp_u: float
    lines: tuple[Line, ...]
    pieces: tuple[Array, ...]
    solved: tuple[Solved, ...]
    sawtooth: bool

    @property
    def u(self) -> Array:
        """The standard uncertainties (4,) of the squares."""
        return np.sqrt(np.diag(self.covariance))

    def columns(self, count: int) -> Array:
        """Return ramp, per deg/h^2, and lines of a record of `count` samples, (count, p)."""
        return self.known.columns(count, [line.frequency_Hz for line in self.lines])

    def chance(self) -> float:
        """Return how seldom this noise spreads over the frequencies as unevenly as the records."""
        chi_square, bands = 0.0, 0
        for solved in self.solved:
            for white in np.array_split(solved.residuals**2 / solved.variance, BANDS):
                chi_square += float(white.sum() - len(white)) ** 2 / (2.0 * max(len(white), 1))
                bands += 1
        return float(chdtrc(bands, chi_square))


def fit_noise(known: Pieces, periodic_chance: float) -> NoiseFit | None:
    """Return the noise of one axis; None where no record is long enough."""
    if not known.rates:
        return None
    theta = _guess(known)
    gappy = any(not np.isfinite(rate).all() for rate in known.rates)
    filled, walk = known.bridged(theta), WHITE
    for _ in range(ROUNDS if gappy or known.pulse else 1):
        stretches = known.stretches(filled, walk)
        best = fit(stretches)
        theta = _whole(best)[0]
        if gappy:
            filled = known.bridged(theta)
        if known.pulse:
            walk = float(np.sqrt(theta[1]))
    counts = [len(rate) for rate in filled]
    sawtooth = known.is_sawtooth(walk)
    lines: list[float] = []
    needed = 2.0 * np.log(sum(counts) / periodic_chance) * (SAWTOOTH_U**2 if sawtooth else 1.0)
    own = [beats(rate, known.interval_s, known.pulse, walk) for rate in filled if sawtooth]
    for _ in range(MAX_LINES):
        candidate = strongest_line(best, known.interval_s, counts, own)
        if candidate is None:
            break
        wider = known.stretches(filled, walk, [*lines, candidate])
        again = fit(wider, best.theta)
        if best.deviance - again.deviance <= needed:
            break
        lines, stretches, best = [*lines, candidate], wider, again
    theta, covariance = _whole(best)
    if sawtooth:
        covariance[0] *= SAWTOOTH_U
        covariance[:, 0] *= SAWTOOTH_U
    theta[0] += known.pulse**2 / 12.0
    reach = 1.96 * np.sqrt(np.diag(covariance))
    intervals = np.maximum(np.column_stack([theta - reach, theta + reach]), 0.0)
    for number in (2, 3):
        intervals[number] = profile_interval(stretches, best, number - (4 - len(best.theta)))
    ramp, ramp_u = _ramp(stretches, best)
    sizes = np.array([record.sizes[1:] for record in best.solved]).reshape(len(counts), -1, 2)
    # A line of means over intervals is smaller than that of the rate.
    amplitudes = np.sqrt(np.mean(np.sum(sizes**2, axis=2), axis=0))
    seen = tuple(
        Line(line, float(size / np.sinc(line * known.interval_s)))
        for line, size in zip(lines, amplitudes, strict=True)
    )
    return NoiseFit(
        known, theta, covariance, intervals, ramp, ramp_u, seen, filled, best.solved, sawtooth
    )


def _whole(best: Components) -> tuple[Array, Array]:
    """Return theta (4,) and its covariance, Q zero and not known where the band hides it."""
    hidden = 4 - len(best.theta)
    covariance = np.zeros((4, 4))
    covariance[hidden:, hidden:] = best.covariance
    return np.concatenate((np.zeros(hidden), best.theta)), covariance


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


def _guess(known: Pieces) -> Array:
    """Return a first theta for the bridging of gaps: what neighbours differ by, taken as white."""
    steps = np.concatenate([np.diff(rate) for rate in known.rates])
    white = 0.5 * float(np.nanmean(steps**2)) * known.interval_s
    return np.array([0.0, white + 1e-12, 0.0, 0.0])


def line_columns(time_s: Array, frequencies_Hz: Sequence[float]) -> list[Array]:
    """Return cosine and sine (n,) of each frequency."""
    angles = [2.0 * np.pi * frequency_Hz * time_s for frequency_Hz in frequencies_Hz]
    return [part(angle) for angle in angles for part in (np.cos, np.sin)]


def centred_times(count: int, interval_s: float) -> Array:
    """Return the times (n,) of a record's samples from its middle."""
    return np.asarray((np.arange(count) - 0.5 * (count - 1)) * interval_s, dtype=np.float64)


def strongest_line(
    best: Components,
    interval_s: float,
    counts: Sequence[int],
    known: Sequence[Sequence[tuple[float, float]]] = (),
) -> float | None:
    """Return the frequency in Hz that lowers -2 ln L most; None where none is worth a try.

    Looked for in the residuals made white, then refined with the noise as it is. What beats in the
    `known` bands, in Hz, of any record is its rounding.
    """
    length = next_fast_len(FINER * max(counts), real=True)
    falls = np.zeros(length // 2 + 1)
    for solved, count in zip(best.solved, counts, strict=True):
        white = in_time(solved.residuals / np.sqrt(solved.variance), count)
        falls += 2.0 * np.abs(rfft(white, length)) ** 2 / count
    frequency = np.arange(len(falls)) / (length * interval_s)
    span_s = max(counts) * interval_s
    falls[frequency < FEWEST_CYCLES / span_s] = 0.0
    if known:
        # What rounding leaves beside its bands is no line: it lifts its neighbours, too.
        usual = median_filter(falls, AROUND, mode="nearest") / USUAL_FALL
        falls = falls / np.maximum(usual, 1.0)
    for low_Hz, high_Hz in (band for bands in known for band in bands):
        falls[(frequency >= low_Hz) & (frequency <= high_Hz)] = 0.0
    top = int(np.argmax(falls))
    if falls[top] < (ALONE if known else WORTH_A_TRY):
        return None

    def kept(frequency_Hz: float) -> float:
        return -sum(
            _fall(solved, frequency_Hz, interval_s, count)
            for solved, count in zip(best.solved, counts, strict=True)
        )

    reach = 1.0 / (FINER * span_s)
    bounds = (max(frequency[top] - reach, FEWEST_CYCLES / span_s), frequency[top] + reach)
    return float(minimize_scalar(kept, bounds=bounds, method="bounded").x)


def _fall(solved: Solved, frequency_Hz: float, interval_s: float, count: int) -> float:
    """Return by how much a line lowers -2 ln L of one record with its noise as it is."""
    time_s = centred_times(count, interval_s)
    pair = np.column_stack(line_columns(time_s, [frequency_Hz]))
    pair = coefficients(pair)[: len(solved.residuals)]
    weighted = pair / solved.variance[:, None]
    explained = weighted.T @ solved.residuals
    return float(explained @ np.linalg.solve(weighted.T @ pair, explained))


def block_means(rate: Array) -> Array:
    """Return the mean rates of the blocks of a record (n,)."""
    return np.array([float(np.mean(block)) for block in np.array_split(rate, BLOCKS)])


def rounding_variances(
    count: int, interval_s: float, pulse: float, walk: float, mean_rates: Array
) -> Array:
    """Return the variances (n - 1,) that rounding to whole pulses adds to a record's coefficients.

    `pulse` in arcsec, `walk` N in deg/h sqrt(s), `mean_rates` (b,) in deg/h as the gyro sees
    them, block by block. The error of an angle is a sawtooth of it; each harmonic turns with the
    mean rate and fades as the angle walks. Where the rate drifts, the mean over the blocks counts.
    """
    if pulse <= 0.0:
        return np.zeros(count - 1)
    lag = np.arange(count + 1)
    angle = np.zeros(count + 1)
    angle[0] = pulse**2 / 12.0
    fading = 2.0 * (np.pi * walk / pulse) ** 2 * interval_s
    turning = 2.0 * np.pi * ((mean_rates * interval_s / pulse) % 1.0)
    for harmonic in range(1, MAX_HARMONICS):
        fade = fading * harmonic**2
        if fade > -np.log(NOTHING):
            break
        reach = count + 1 if fade <= 0.0 else min(count + 1, int(-np.log(NOTHING) / fade) + 1)
        own = lag[1:reach]
        size = pulse**2 / (2.0 * (np.pi * harmonic) ** 2)
        turned = np.mean([np.cos(harmonic * rate * own) for rate in turning], axis=0)
        angle[1:reach] += size * np.exp(-fade * own) * turned
    before = np.abs(lag[:count] - 1)
    second = 2.0 * angle[:count] - angle[1:] - angle[before]
    return np.maximum(variances(second / interval_s**2), 0.0)


def beats(rate: Array, interval_s: float, pulse: float, walk: float) -> list[tuple[float, float]]:
    """Return the bands in Hz, lowest and highest, where the rounding of a record (n,) beats.

    A harmonic of the sawtooth turns with the fraction of a pulse in a sample, which goes with the
    mean rate of the blocks, and fades as the angle walks.
    """
    turns = block_means(rate) * interval_s / pulse
    bands = []
    for harmonic in range(1, MAX_BEATS):
        fading = 2.0 * (np.pi * harmonic * walk / pulse) ** 2 * interval_s
        half = harmonic * float(np.ptp(turns)) + FADED * fading / (2.0 * np.pi) + 2.0 / len(rate)
        if half > SMEARED:
            break
        middle = abs((harmonic * float(np.mean(turns)) + 0.5) % 1.0 - 0.5)
        bands.append(((middle - half) / interval_s, (middle + half) / interval_s))
    return bands


BESIDE_GAP = 40
"""Samples on either side that a gap is predicted from."""
LONG_GAP, MAX_GAP = 0.02, 300
"""Part of a record, and samples, that a gap may be to be bridged; a longer one divides it."""


def pieces(rate: Array) -> list[Array]:
    """Return the parts of a record on its grid between gaps too long to be bridged, none empty."""
    longest = min(MAX_GAP, max(1.0, LONG_GAP * len(rate)))
    good = np.flatnonzero(np.isfinite(rate))
    parts = np.split(good, np.flatnonzero(np.diff(good) - 1 > longest) + 1)
    return [rate[part[0] : part[-1] + 1] for part in parts if len(part)]


def bridged(rate: Array, interval_s: float, theta: Array, pulse_arcsec: float) -> Array:
    """Return a record (n,) with its gaps, NaN, filled; `theta` holds the squares of Q, N, B, K.

    The draw is the same each time, so that results repeat.
    """
    filled = rate.copy()
    random = np.random.default_rng(0)
    squares = theta + np.array([pulse_arcsec**2 / 12.0, 0.0, 0.0, 0.0])
    missing = np.flatnonzero(~np.isfinite(rate))
    for gap in np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1) if len(missing) else ():
        low, high = max(gap[0] - BESIDE_GAP, 0), min(gap[-1] + BESIDE_GAP + 1, len(rate))
        places = np.arange(low, high)
        known = np.isfinite(filled[places])
        covariance = toeplitz(squares @ covariances(len(places), interval_s))
        filled[places[~known]] = _drawn(covariance, filled[places], known, random)
    return filled


def _drawn(
    covariance: Array, values: Array, known: np.ndarray, random: np.random.Generator
) -> Array:
    """Return the unknown values given the known ones about a mean that nobody knows."""
    count = int(known.sum())
    system = np.ones((count + 1, count + 1))
    system[:count, :count] = covariance[np.ix_(known, known)]
    system[count, count] = 0.0
    towards = np.ones((count + 1, len(values) - count))
    towards[:count] = covariance[np.ix_(known, ~known)]
    weights = np.linalg.solve(system, towards)
    expected = weights[:count].T @ values[known]
    left = covariance[np.ix_(~known, ~known)] - weights.T @ towards
    size, shape = np.linalg.eigh(0.5 * (left + left.T))
    noise = random.standard_normal(len(size))
    return np.asarray(expected + shape @ (np.sqrt(np.maximum(size, 0.0)) * noise))


SHORTEST, LONGEST = 5, 0.05
"""Samples, and part of a record: a longer block is a step or drift, and no burst."""
LONGER = 1.4
MAX_BURSTS = 5
MIN_SCATTER = 2.0
"""Of the usual variance: less may be rounding, which is not normal."""
CHANCE = 1e-4
WIDER = 0.2
"""Part of a burst by which it is left out beyond both its ends, which are not sharply seen."""


@dataclass(frozen=True)
class Burst:
    """A block that is left out: `shift` in deg/h, or how many times as large the scatter is.

    `first` to `stop` are its samples on the grid of a piece, `gain` is how much -2 ln L falls.
    `count` samples from `begin_s` to `end_s` after power-on of `switch_on` are lost by it.
    """

    first: int
    stop: int
    gain: float
    shift: float = 0.0
    scatter: float = 0.0
    switch_on: int = 0
    begin_s: float = 0.0
    end_s: float = 0.0
    count: int = 0


def without_bursts(
    records: Sequence[Record], grids: Sequence[Array], noise: NoiseFit
) -> tuple[list[Array], list[Burst]]:
    """Return the records on their grids with NaN in bursts, and these."""
    kept, bursts = [], []
    for record, grid in zip(records, grids, strict=True):
        rate = grid.copy()
        for piece in pieces(rate):
            for _ in range(MAX_BURSTS):
                burst = strongest_burst(piece, noise)
                if burst is None:
                    break
                before = np.isfinite(rate)
                piece[burst.first : burst.stop] = np.nan  # a view of `rate`
                lost = np.flatnonzero(before & ~np.isfinite(rate))
                if not len(lost):
                    break
                begin_s, end_s = float(record.time_s[0]) + noise.known.interval_s * lost[[0, -1]]
                where = {"begin_s": begin_s, "end_s": end_s, "count": len(lost)}
                bursts.append(replace(burst, switch_on=record.switch_on, **where))
        kept.append(rate)
    return kept, bursts


def strongest_burst(piece: Array, noise: NoiseFit) -> Burst | None:
    """Return the block of a record (n,), NaN in gaps, that the noise least gives; None without."""
    count, interval_s = len(piece), noise.known.interval_s
    rate = bridged(piece, interval_s, noise.theta, 0.0)
    # A filtered output has the noise of the model only up to a part of its band.
    kept = noise.known.kept(count)
    variance = noise.theta @ noise_variances(count, interval_s)[:, :kept]
    data = coefficients(rate - rate.mean())[:kept]
    design = coefficients(noise.columns(count))[:kept]
    weighted = design / variance[:, None]
    data = data - design @ np.linalg.lstsq(weighted.T @ design, weighted.T @ data, rcond=None)[0]
    square = in_time(data / np.sqrt(variance), count) ** 2
    # Among the samples of a record the usual scatter is taken, so that other misfits do not count.
    square = square / max(float(np.mean(square)), 1e-300)
    sums = np.concatenate(([0.0], np.cumsum(in_time(data / variance, count))))
    squares = np.concatenate(([0.0], np.cumsum(square)))
    steps = np.arange(0.0, np.log(max(LONGEST * count / SHORTEST, 1e-9)), np.log(LONGER))
    lengths = np.unique(np.rint(SHORTEST * np.exp(steps)).astype(int)).tolist()
    needed = 2.0 * np.log(count * max(len(lengths), 1) / CHANCE)
    needed *= SAWTOOTH_U**2 if noise.sawtooth else 1.0
    best: Burst | None = None
    for length in lengths:
        boxcar = np.zeros(count)
        boxcar[(count - length) // 2 :][:length] = 1.0
        information = float(np.sum(coefficients(boxcar)[:kept] ** 2 / variance))
        total = sums[length:] - sums[:-length]
        scatter = (squares[length:] - squares[:-length]) / length
        more = np.where(scatter > MIN_SCATTER, scatter, 1.0)
        wild = length * kept / count * (more - 1.0 - np.log(more))
        for gains, shifted in ((total**2 / information, True), (wild, False)):
            place = int(np.argmax(gains))
            gain = float(gains[place])
            if gain <= max(needed, best.gain if best else 0.0):
                continue
            edge = round(WIDER * length)
            best = Burst(max(place - edge, 0), min(place + length + edge, count), gain)
            if shifted:
                best = replace(best, shift=float(total[place] / information))
            else:
                best = replace(best, scatter=float(np.sqrt(scatter[place])))
    return best
