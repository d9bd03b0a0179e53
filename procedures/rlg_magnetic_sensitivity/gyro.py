"""The gyro's output at the driven frequencies: the fit, and the source document's own formula."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import fdtrc

from procedures.estimation.linear import Columns, Rows, least_squares, reject_outliers
from procedures.estimation.noise import (
    LocalNoise,
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

    driven_Hz: float
    power: float
    chance: float


@dataclass(frozen=True)
class GyroFit:
    """Phasors of the fitted lines with covariance and freedom: the driven lines, then all others.

    `phasor_deg_per_h` is (m,), `covariance` (2 m, 2 m) that of real and imaginary parts, in pairs;
    interval averaging is corrected. `double` says which line is twice each driven one, None where
    twice the frequency has no room. `lines_deg_per_h` is the part of the model that all lines make,
    drift left out; `kept` marks the samples that the fit used. `noise_floor_deg_per_h` (m,) is the
    expected root mean square ordinate of the published spectrum next to a line if there were none.
    `drift_order` is the order of the fit; `drift_evident` says whether the data prove any drift.
    """

    phasor_deg_per_h: Complex
    covariance: Array
    degrees_of_freedom: Array
    double: tuple[int | None, ...]
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
    mixed = [g for a, b in combinations(frequencies, 2) for g in (abs(a - b), a + b)]
    for f in [2.0 * f for f in frequencies] + mixed:
        apart = all(abs(f - g) * span_s >= 1.0 for g in lines)
        if apart and 1.5 / span_s < f < 0.5 / interval_s - 1.0 / span_s:
            lines.append(f)
    return lines[len(frequencies) :]


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
    driven, top = len(frequencies), settings.max_drift_order
    while extra and len(time_all) < 4 * (2 * (driven + len(extra)) + top + 1):
        extra.pop()
    lines = [*frequencies, *extra]
    line_count = 2 * len(lines)
    if len(time_all) < 2 * (line_count + top + 1):
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

    samples = len(data_kept)
    first = least_squares(used, data_kept)
    top_order = min(settings.max_autoregression_order, samples // 20)
    colour = fit_autoregression(first.residuals, index, top_order)
    white = whitened(used, index, colour)
    white_data = whitened(Columns.of(data_kept[:, None]), index, colour).times(np.ones(1))
    full = least_squares(white, white_data)
    sums = full.sum_of_squares + np.append(np.cumsum(full.gains[line_count + 1 :][::-1])[::-1], 0.0)
    # A slope costs next to nothing over whole cycles and its absence biases the lines: it is always
    # in the fit. Drift is reported only when the evidence is beyond doubt.
    order = max(drift_order(sums, samples, 1.0), min(1, top))
    unknowns = line_count + order + 1
    fit = least_squares(white.first(unknowns), white_data)
    freedom = max(samples - unknowns, 1)
    overall = LocalNoise(fit.sum_of_squares / freedom, float(max(freedom - colour.order, 1)))
    spectrum = periodogram(fit.residuals, index, interval_s)
    band_Hz = 0.5 * (order + 2) / span_s, 0.5 / interval_s - 0.5 / span_s

    def noise_at(f: float, others: Sequence[float]) -> LocalNoise:
        return noise_near_line(spectrum, f, others, *band_Hz, overall, colour.order > 0)

    def has_overtone(driven_Hz: float) -> bool:
        triple = 3.0 * driven_Hz
        return triple <= band_Hz[1] and all(abs(triple - f) * spectrum.span_s >= 1.5 for f in lines)

    def overtone_of(driven_Hz: float) -> Overtone:
        noise = noise_at(3.0 * driven_Hz, lines)
        place = int(np.argmin(np.abs(spectrum.frequency_Hz - 3.0 * driven_Hz)))
        power = float(spectrum.ordinate[place]) / noise.variance if noise.variance > 0.0 else 0.0
        return Overtone(driven_Hz, power, float(fdtrc(2.0, noise.degrees_of_freedom, power)))

    model = design.first(unknowns).times(fit.coefficients)
    residuals = data - model
    near = [noise_at(f, lines[:k] + lines[k + 1 :]) for k, f in enumerate(lines)]
    factors = np.array([averaging_factor(f, interval_s) for f in lines])
    scale = np.sqrt([noise.variance for noise in near]) / factors
    signed = np.repeat(scale, 2) * np.tile([1.0, -1.0], len(lines))
    covariance = fit.inverse_normal[:line_count, :line_count] * np.outer(signed, signed)
    power = np.diag(covariance).reshape(-1, 2).sum(axis=1)

    def everywhere(values: Array) -> Array:
        column = np.full(len(segment.time_s), np.nan)
        column[finite] = values
        return column

    mask = finite.copy()
    mask[finite] = kept
    return GyroFit(
        phasor_deg_per_h=phasors(fit.coefficients[:line_count]) / factors,
        covariance=covariance,
        degrees_of_freedom=np.array([noise.degrees_of_freedom for noise in near]),
        double=tuple(lines.index(2.0 * f) if 2.0 * f in extra else None for f in frequencies),
        model_deg_per_h=everywhere(model + mean),
        lines_deg_per_h=everywhere(design.first(line_count).times(fit.coefficients[:line_count])),
        residual_deg_per_h=everywhere(residuals),
        kept=mask,
        drift_order=order,
        drift_evident=drift_order(sums, samples, 2.0) >= 1,
        autoregression_order=colour.order,
        lag_one_correlation=lag_one_correlation(residuals[kept], index),
        residual_sigma_deg_per_h=float(np.sqrt(np.mean(residuals[kept] ** 2) * samples / freedom)),
        noise_floor_deg_per_h=np.sqrt(power) * np.abs(factors),
        overtones=tuple(overtone_of(f) for f in frequencies if has_overtone(f)),
    )


def no_fit(segment: Segment) -> GyroFit:
    """Return what stands in the place of a fit where none is possible."""
    none, blank = np.zeros(0), np.full(len(segment.time_s), np.nan)
    kept = np.isfinite(segment.rate_deg_per_h)
    return GyroFit(
        none.astype(np.complex128),
        none,
        none,
        (),
        blank,
        blank,
        blank,
        kept,
        0,
        False,
        0,
        0.0,
        np.nan,
        none,
        (),
    )


def published_value(segment: Segment, axis: str) -> Published:
    """Evaluate S5 to S7 for one driven axis: DFT of the samples as recorded, peak near f, y / M.

    f and M are the commanded ones. The peak is the largest of the line nearest to f and its two
    neighbours. The rule needs N samples in an unbroken row: where rows are missing it cannot run as
    written, nothing is filled in and the value is None. Of a record that is averaged the lines that
    the rule reads were summed up from its samples before.
    """
    drive, rate = segment.drive[axis], segment.rate_deg_per_h
    amplitude = None
    if segment.averaged is not None:
        amplitude = segment.averaged.amplitude_deg_per_h[axis]
    elif len(rate) and segment.places == len(rate) and np.isfinite(rate).all():
        spectrum = amplitude_spectrum(rate, segment.sample_interval_s)
        amplitude = peak_near(*spectrum, drive.frequency_Hz)
    value = None
    if amplitude is not None and drive.amplitude_mT > 0.0:
        value = amplitude / drive.amplitude_mT
    return Published(QUANTITY, axis, value, UNIT, "dft-peak")


def plotted_spectrum(segment: Segment) -> tuple[Array, Array]:
    """Return the spectrum of S6 to look at; where rows are missing, about the mean without them."""
    rate = segment.rate_deg_per_h
    present = np.isfinite(rate)
    if len(rate) < 3 or not present.any():
        return np.zeros(0), np.zeros(0)
    whole = bool(present.all()) and segment.places == len(rate)
    mean = 0.0 if whole else float(np.mean(rate[present]))
    series = np.zeros(segment.places)
    series[grid_index(segment.time_s, segment.sample_interval_s)[present]] = rate[present] - mean
    frequency_Hz, amplitude = amplitude_spectrum(series, segment.sample_interval_s)
    if not whole:
        amplitude *= len(series) / int(present.sum())
        amplitude[0] = abs(mean)
    return frequency_Hz, amplitude
