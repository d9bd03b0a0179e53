"""The gyro's output at the driven frequencies: the fit, and the source document's own formula."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from procedures.estimation.linear import Columns, Rows, least_squares, reject_outliers
from procedures.estimation.noise import (
    LocalNoise,
    Periodogram,
    fit_autoregression,
    grid_index,
    lag_one_correlation,
    noise_near_line,
    periodogram,
    whitened,
)
from procedures.estimation.sine import (
    amplitude_spectrum,
    averaging_factor,
    drift_order,
    legendre_columns,
    line_columns,
    peak_near,
    phasors,
)
from station.findings import Published

from .dataset import QUANTITY, UNIT, Array, Complex, Mask, Segment
from .parameters import AnalysisSettings


@dataclass(frozen=True)
class Overtone:
    """Three times a driven frequency in what the fit leaves: power over that of the noise there.

    `chance` is how often noise alone has as much.
    """

    frequency_Hz: float
    driven_Hz: float
    power: float
    chance: float


@dataclass(frozen=True)
class GyroFit:
    """Phasors of the driven lines and of their doubles, with covariance and freedom.

    `phasor_deg_per_h` (2 k,) holds k driven lines, then k doubles (zero and not in
    `has_double` where twice the frequency has no room); `lines_deg_per_h` is the part of the model
    that all fitted lines make, drift left out; `covariance` (4 k, 4 k) is that of the
    real and imaginary parts, in pairs. Interval averaging is corrected.
    """

    phasor_deg_per_h: Complex
    covariance: Array
    degrees_of_freedom: Array
    has_double: Mask
    model_deg_per_h: Array
    lines_deg_per_h: Array
    residual_deg_per_h: Array
    kept: Mask
    drift_order: int
    drift_evident: bool
    autoregression_order: int
    lag_one_correlation: float
    residual_sigma_deg_per_h: float
    noise_floor_deg_per_h: Array
    overtones: tuple[Overtone, ...]


def extra_lines(frequencies: Sequence[float], span_s: float, interval_s: float) -> list[float]:
    """Return the lines besides the driven ones: doubles first, then sums and differences.

    A double must lie below half the sampling rate; a sum or difference also above 1.5/T; none may
    come within 1/T of a line that is there already.
    """
    lines = list(frequencies)
    extra: list[float] = []

    def room(f: float) -> bool:
        return all(abs(f - g) * span_s >= 1.0 for g in lines)

    mixed = [
        sign
        for i, f in enumerate(frequencies)
        for g in frequencies[i + 1 :]
        for sign in (abs(f - g), f + g)
    ]
    for f in [2.0 * f for f in frequencies] + mixed:
        if 1.5 / span_s < f < 0.5 / interval_s - 1.0 / span_s and room(f):
            lines.append(f)
            extra.append(f)
    return extra


def columns_needed(lines: int, settings: AnalysisSettings) -> int:
    """Return how many unknowns the fit of that many lines has."""
    return 2 * lines + settings.max_drift_order + 1


def fit_gyro(
    segment: Segment, frequencies: Sequence[float], settings: AnalysisSettings
) -> GyroFit | None:
    """Regress a segment's output on drift and lines at frequencies that are held.

    Outliers are set aside on an ordinary fit; an autoregression of what is left whitens data and
    columns; the drift order is chosen, and the lines estimated, on whitened data. None where the
    record has too few samples for its own model.
    """
    finite = np.isfinite(segment.rate_deg_per_h) & np.isfinite(segment.time_s)
    time_all = segment.time_s[finite]
    if len(time_all) < 3:
        return None
    interval_s = segment.sample_interval_s
    index_all = grid_index(time_all, interval_s)
    span_s = float(index_all[-1] + 1) * interval_s
    extra = extra_lines(frequencies, span_s, interval_s)
    top = settings.max_drift_order
    while extra and len(time_all) < 4 * columns_needed(len(frequencies) + len(extra), settings):
        extra.pop()
    lines = [*frequencies, *extra]
    if len(time_all) < 2 * columns_needed(len(lines), settings):
        return None
    start_s, stop_s = float(time_all[0]), float(time_all[-1])
    moved = time_all - 0.5 * (start_s + stop_s)

    def model_rows(rows: Rows) -> Array:
        drift = legendre_columns(time_all[rows], top, start_s, stop_s)
        return np.hstack((line_columns(moved[rows], lines), drift))

    design = Columns(len(time_all), model_rows)
    mean = float(np.median(segment.rate_deg_per_h[finite]))
    data = segment.rate_deg_per_h[finite] - mean
    quantum = segment.quantum_deg_per_h
    kept = reject_outliers(design, data, settings.outlier, 0.6 * quantum, quantum)
    used, data_kept, index = design.where(kept), data[kept], index_all[kept] - index_all[kept][0]

    first = least_squares(used, data_kept)
    top_order = min(settings.max_autoregression_order, len(data_kept) // 20)
    colour = fit_autoregression(first.residuals, index, top_order)
    white = whitened(used, index, colour)
    white_data = whitened(Columns.of(data_kept[:, None]), index, colour).times(np.ones(1))
    full = least_squares(white, white_data)
    line_count = 2 * len(lines)
    sums = full.sum_of_squares + np.append(np.cumsum(full.gains[line_count + 1 :][::-1])[::-1], 0.0)
    samples = len(data_kept)
    # A slope costs next to nothing over whole cycles and its absence biases the lines: it is always
    # in the fit. Drift is reported only when the evidence is beyond doubt.
    order = max(drift_order(sums, samples, 1.0), min(1, top))
    evident = drift_order(sums, samples, 2.0) >= 1
    unknowns = line_count + order + 1
    fit = least_squares(white.first(unknowns), white_data)
    freedom = max(samples - unknowns, 1)
    sigma2 = fit.sum_of_squares / freedom

    model = design.first(unknowns).times(fit.coefficients)
    residuals = data - model
    result_lines = _line_slots(frequencies, extra)
    phasor = np.zeros(2 * len(frequencies), dtype=np.complex128)
    scale = np.zeros(4 * len(frequencies))
    picks = np.zeros(4 * len(frequencies), dtype=np.int64)
    overall = LocalNoise(sigma2, float(max(freedom - colour.order, 1)))
    freedoms = np.full(2 * len(frequencies), overall.degrees_of_freedom)
    spectrum = periodogram(fit.residuals, index, interval_s)
    lowest_Hz = 0.5 * (order + 2) / span_s
    highest_Hz = 0.5 / interval_s - 0.5 / span_s
    band = (lowest_Hz, highest_Hz)
    all_phasors = phasors(fit.coefficients[:line_count])
    for slot, place in enumerate(result_lines):
        if place is None:
            continue
        f = lines[place]
        factor = averaging_factor(f, interval_s)
        others = lines[:place] + lines[place + 1 :]
        near = noise_near_line(spectrum, f, others, *band, overall, colour.order > 0)
        freedoms[slot] = near.degrees_of_freedom
        phasor[slot] = all_phasors[place] / factor
        picks[2 * slot : 2 * slot + 2] = (2 * place, 2 * place + 1)
        scale[2 * slot : 2 * slot + 2] = np.sqrt(near.variance) / factor
    signs = np.tile([1.0, -1.0], 2 * len(frequencies)) * scale
    covariance = fit.inverse_normal[np.ix_(picks, picks)] * np.outer(signs, signs)
    power = np.diag(covariance).reshape(-1, 2).sum(axis=1)
    factors = np.array([averaging_factor(f, interval_s) for f in frequencies])
    everything = np.full(len(segment.time_s), np.nan)
    everything[finite] = model + mean
    alone = np.full(len(segment.time_s), np.nan)
    alone[finite] = design.first(line_count).times(fit.coefficients[:line_count])
    leftover = np.full(len(segment.time_s), np.nan)
    leftover[finite] = residuals
    mask = np.zeros(len(segment.time_s), dtype=bool)
    mask[finite] = kept
    return GyroFit(
        phasor_deg_per_h=phasor,
        covariance=covariance,
        degrees_of_freedom=freedoms,
        has_double=np.array([p is not None for p in result_lines[len(frequencies) :]], dtype=bool),
        model_deg_per_h=everything,
        lines_deg_per_h=alone,
        residual_deg_per_h=leftover,
        kept=mask,
        drift_order=order,
        drift_evident=evident,
        autoregression_order=colour.order,
        lag_one_correlation=lag_one_correlation(residuals[kept], index),
        residual_sigma_deg_per_h=float(np.sqrt(np.mean(residuals[kept] ** 2) * samples / freedom)),
        noise_floor_deg_per_h=np.sqrt(power[: len(frequencies)]) * np.abs(factors),
        overtones=_overtones(frequencies, lines, spectrum, band, overall, colour.order > 0),
    )


def _overtones(
    frequencies: Sequence[float],
    lines: Sequence[float],
    spectrum: Periodogram,
    band_Hz: tuple[float, float],
    overall: LocalNoise,
    coloured: bool,
) -> tuple[Overtone, ...]:
    """Return what stands at three times each driven frequency, where no fitted line is near."""
    overtones = []
    for f in frequencies:
        triple = 3.0 * f
        if triple > band_Hz[1] or any(abs(triple - g) * spectrum.span_s < 1.5 for g in lines):
            continue
        near = noise_near_line(spectrum, triple, lines, *band_Hz, overall, coloured)
        place = int(np.argmin(np.abs(spectrum.frequency_Hz - triple)))
        ratio = float(spectrum.ordinate[place]) / near.variance if near.variance > 0.0 else 0.0
        chance = float(fdtrc(2.0, near.degrees_of_freedom, ratio))
        overtones.append(Overtone(triple, f, ratio, chance))
    return tuple(overtones)


def _line_slots(frequencies: Sequence[float], extra: list[float]) -> list[int | None]:
    slots: list[int | None] = list(range(len(frequencies)))
    first = len(frequencies)
    doubles = [2.0 * f for f in frequencies]
    return slots + [first + extra.index(f) if f in extra else None for f in doubles]


def published_value(segment: Segment, axis: str) -> Published:
    """Evaluate S5 to S7 for one driven axis: DFT of the samples as recorded, peak near f, y / M.

    f and M are the commanded ones. The peak is the largest of the line nearest to f and its two
    neighbours. The rule needs N samples in an unbroken row: where rows are missing it cannot run as
    written, nothing is filled in and the value is None. Of a record that is averaged the lines that
    the rule reads were summed up from its samples before.
    """
    drive = segment.drive[axis]
    amplitude = (
        _amplitude(segment, drive.frequency_Hz)
        if segment.averaged is None
        else segment.averaged.amplitude_deg_per_h[axis]
    )
    value = None
    if amplitude is not None and drive.amplitude_mT > 0.0:
        value = amplitude / drive.amplitude_mT
    return Published(QUANTITY, axis, value, UNIT, "dft-peak")


def _amplitude(segment: Segment, wanted_Hz: float) -> float | None:
    rate = segment.rate_deg_per_h
    whole = len(rate) >= 3 and segment.places == len(rate) and bool(np.all(np.isfinite(rate)))
    if not whole:
        return None
    frequency_Hz, amplitude = amplitude_spectrum(rate, segment.sample_interval_s)
    return peak_near(frequency_Hz, amplitude, wanted_Hz)


def plotted_spectrum(segment: Segment) -> tuple[Array, Array]:
    """Return the spectrum of S6 to look at; where rows are missing, about the mean without them."""
    if len(segment.time_s) < 3:
        return np.zeros(0), np.zeros(0)
    rate = np.where(np.isfinite(segment.rate_deg_per_h), segment.rate_deg_per_h, np.nan)
    index = grid_index(segment.time_s, segment.sample_interval_s)
    present = np.isfinite(rate)
    places = segment.places
    if bool(present.all()) and places == len(index):
        return amplitude_spectrum(rate, segment.sample_interval_s)
    if not bool(present.any()):
        return np.zeros(0), np.zeros(0)
    mean = float(np.mean(rate[present]))
    series = np.zeros(places)
    series[index[present]] = rate[present] - mean
    frequency_Hz, amplitude = amplitude_spectrum(series, segment.sample_interval_s)
    amplitude *= places / int(present.sum())
    amplitude[0] = abs(mean)
    return frequency_Hz, amplitude
