"""Flags on the shots themselves, and on what their fits leave that is no white noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.special import gammaincc

from procedures.estimation.flags import Gaps, excitation_flags, gaps_of
from station.findings import Flag, contradiction

from .dataset import SerfDataset, Shot, ShotResult
from .parameters import AnalysisSettings
from .precession import Precession
from .shots import AXES, GAMMA_HZ_PER_NT, MIN_SIGNAL_TO_NOISE, SPINS

Array = NDArray[np.float64]
UNEXPLAINED = 0.3
"""Of the squares of the frequencies: what coils that lean leave at most."""
LARGE_BASELINE = 1.5
"""A baseline beyond this many amplitudes of the tone."""
GAMMA_MARGIN = 1e-3
"""Alkali atoms differ from the free electron, and from one another, by less than 2e-4."""
CLOCK_MARGIN = 2e-4
LATE = 3.0
"""1/e times after time zero at which no record begins: it would hold a twentieth of its tone."""
CHANCE = 1e-4
"""How often white noise alone is flagged, at most."""
BINS, SAMPLES = (1, 4, 16), (4, 16, 64)
"""Widths of the windows over a spectrum and over a record."""
ROUNDING = 1e-9
"""Noise over signal of records that are computed and have none."""
BESIDE = 16
"""Bins to either side of a tone in which what all shots leave is taken together."""


def data_flags(
    dataset: SerfDataset,
    seen: Sequence[Precession],
    shots: Sequence[ShotResult],
    settings: AnalysisSettings,
) -> Iterator[Flag]:
    """Yield the flags on the shots themselves."""
    yield from _statements(dataset, seen)
    yield from _left_out(dataset, seen, shots)
    yield from _excitation(dataset, seen)
    nominal_s = 1.0 / dataset.sample_rate_Hz
    records = (gaps_of(shot.time_s, nominal_s, settings.gap) for shot in dataset.shots)
    gaps = sum(records, Gaps())
    yield from gaps.flags("The records have", nominal_s, "the fits do not mind")
    yield from _shape(seen, settings)


def _left_out(
    dataset: SerfDataset, seen: Sequence[Precession], shots: Sequence[ShotResult]
) -> Iterator[Flag]:
    """Yield the flags of shots and samples that do not count."""
    if dataset.repeated:
        names = list(dict.fromkeys(name for name, _ in dataset.repeated))
        why = "; ".join(dict.fromkeys(reason for _, reason in dataset.repeated))
        text = f"Shots were taken again, the bad ones are left out: {', '.join(names)} ({why})."
        details = {"shots": names, "count": len(dataset.repeated)}
        yield Flag("shot-repeated", text, details=details)
    over = [precession for precession in seen if precession.saturated]
    if over:
        count = sum(precession.saturated for precession in over)
        text = f"{count} samples are saturated and left out, in {', '.join(_names(over))}."
        yield Flag("overload", text, details={"count": count, "shots": _names(over)})
    for precession in seen:
        if not precession.used:
            text = f"The shot {precession.shot.name} is not used: {precession.rejected}."
            yield Flag("shot-rejected", text, details={"shot": precession.shot.name})
    outliers = {
        shot.name: int(np.sum(precession.usable & ~shot.kept))
        for precession, shot in zip(seen, shots, strict=True)
        if shot.used
    }
    if count := sum(outliers.values()):
        yield Flag(
            "outliers-rejected",
            f"{count} samples stand more than six standard deviations from the fit and are left "
            f"out, in {', '.join(name for name, number in outliers.items() if number)}.",
            details={"count": count},
        )


def _excitation(dataset: SerfDataset, seen: Sequence[Precession]) -> Iterator[Flag]:
    """Yield a flag for each coil whose field is not the commanded one, by the precession.

    Angles and residual field aside, the squares of the frequencies are sums of those of the coils.
    A coil that no shot with a tone drives, while others are seen, makes no field that turns the
    spins. What the slowing-down factor leaves open counts for the coil.
    """
    clear = [
        precession
        for precession in seen
        if precession.used and precession.used_fit.signal_to_noise >= MIN_SIGNAL_TO_NOISE
    ]
    if not clear or 2 * len(clear) < len(seen):
        return  # it is the light, or the cell
    omega = np.array([precession.used_fit.omega_rad_per_s for precession in clear])
    squares = np.array([precession.shot.field_nT**2 for precession in clear])
    of_coils = np.linalg.lstsq(squares, omega**2, rcond=None)[0]
    if np.linalg.norm(omega**2 - squares @ of_coils) > UNEXPLAINED * np.linalg.norm(omega**2):
        return  # the coils are not what makes these tones: that is reported of the shots
    measured_nT = np.sqrt(np.maximum(of_coils, 0.0))
    spin = SPINS[dataset.nuclear_spin]
    for k, axis in enumerate(AXES):
        driving = [precession for precession in seen if precession.shot.field_nT[k]]
        if not driving or (
            not squares[:, k].any() and any(precession.saturated for precession in driving)
        ):
            continue
        per_nT = float(measured_nT[k]) / dataset.gamma_rad_per_s_nT
        share = min(max(1.0, spin.polarised * per_nT), spin.at_rest * per_nT)
        largest_nT = max(abs(float(precession.shot.field_nT[k])) for precession in driving)
        yield from excitation_flags(axis, axis, {axis: share}, (largest_nT, "nT"), axis)


def _names(seen: Sequence[Precession]) -> list[str]:
    return [precession.shot.name for precession in seen]


def _statements(dataset: SerfDataset, seen: Sequence[Precession]) -> Iterator[Flag]:
    """Yield a flag for each stated number that nature or the rows' times deny."""
    if abs(dataset.gamma_Hz_per_nT / GAMMA_HZ_PER_NT - 1.0) > GAMMA_MARGIN:
        yield contradiction(
            "gyromagnetic_ratio",
            f"The gyromagnetic ratio is stated as {dataset.gamma_Hz_per_nT:.6g} Hz/nT; the "
            f"electron's is {GAMMA_HZ_PER_NT} Hz/nT, and the slowing-down factor is as wrong as "
            "the statement. Correct gyromagnetic_ratio.",
        )
    begun = [
        precession.used_fit.decay_per_s * float(precession.shot.time_s[0])
        for precession in seen
        if precession.used
    ]
    if begun and abs(late := float(np.median(begun))) > LATE:
        yield contradiction(
            "t_s",
            f"The rows begin {late:.3g} 1/e times of the tones after the time zero of t_s, where "
            "the field goes on and the pump light off: there the tones would be "
            f"{np.exp(min(late, 99.0)):.2g} times as large. Correct t_s.",
        )
    for shot in dataset.shots:
        steps = np.rint(np.diff(shot.time_s) * dataset.sample_rate_Hz)
        place = np.concatenate([[0.0], np.cumsum(steps)])
        slope, start = np.polyfit(place, shot.time_s, 1)
        uneven_s = float(np.max(np.abs(shot.time_s - start - slope * place)))
        span_s = float(place[-1]) / dataset.sample_rate_Hz
        off = float(slope) * dataset.sample_rate_Hz - 1.0
        if abs(off) > CLOCK_MARGIN + 3.0 * uneven_s / span_s:
            yield contradiction(
                "sample_rate",
                f"The rows of {shot.name} are {float(slope):.7g} s apart, {100.0 * off:+.2g} % "
                f"off the stated {dataset.sample_rate_Hz:g} Hz, and the slowing-down factor is as "
                "uncertain. Find out which clock is right, and correct t_s or sample_rate.",
            )
            return


def _shape(seen: Sequence[Precession], settings: AnalysisSettings) -> Iterator[Flag]:
    """Yield the flags on what the fits of single shots show."""
    fitted = [precession for precession in seen if precession.fit is not None]
    few = [precession for precession in fitted if precession.used_fit.cycles < settings.few_cycles]
    if few:
        least = min(few, key=lambda precession: precession.used_fit.cycles)
        cycles = least.used_fit.cycles
        yield Flag(
            "few-cycles",
            f"Fewer than {settings.few_cycles:g} cycles pass within the 1/e time in "
            f"{', '.join(_names(few))}, the fewest in {least.shot.name}, {cycles:.2f}; a "
            "larger field would be measured better.",
            details={"shots": _names(few), "cycles": cycles},
        )
    large = [
        precession
        for precession in fitted
        if precession.used
        and abs(precession.used_fit.baseline_V) > LARGE_BASELINE * precession.used_fit.amplitude_V
    ]
    if large:
        yield Flag(
            "baseline",
            f"The decaying baseline is larger than {LARGE_BASELINE:g} amplitudes of the tone "
            f"in {', '.join(_names(large))}: the field lies near pump and probe.",
            details={"shots": _names(large)},
        )


@dataclass(frozen=True)
class Left:
    """What a shot's fit leaves in units of white noise.

    `power` (bins,) is exponentially distributed, the first bin left out; `square` (samples,) is
    half a chi-square with one degree of freedom; `tone` is the bin of the tone.
    """

    power: Array
    square: Array
    time_s: Array
    bin_Hz: float
    tone: int


def misfit_flags(dataset: SerfDataset, shots: Sequence[ShotResult]) -> list[Flag]:
    """Return a flag where residuals have more in a stretch of time or spectrum than white noise.

    Each shot for itself, and all together beside their tones and by their time.
    """
    left = {result.name: _left(shot.time_s, result) for shot, result in _used(dataset, shots)}
    if not left:
        return []
    windows = sum(len(BINS) * len(a.power) + len(SAMPLES) * len(a.square) for a in left.values())
    limit = CHANCE / windows
    where = {name: text for name, residual in left.items() if (text := _place(residual, limit))}
    if not where and not _together(list(left.values()), limit):
        return []
    shown = "; ".join(f"{name} {text}" for name, text in list(where.items())[:4])
    more = f" and {len(where) - 4} more" if len(where) > 4 else ""
    text = f"in {shown}{more}" if where else "of all shots together, beside their tones"
    return [
        Flag(
            "misfit",
            f"The fits leave more than white noise {text}: the uncertainties do not cover it. Look "
            "for pick-up (mains_frequency), a field that moves during the record, lost or "
            "repeated rows, a recorder that stood still, a filter, light that goes off late or not "
            "at the time zero of t_s, and repeat the shots.",
            None,
            {"shots": list(where) or list(left)},
        )
    ]


def _used(dataset: SerfDataset, shots: Sequence[ShotResult]) -> Iterator[tuple[Shot, ShotResult]]:
    """Yield the shots of the solution whose residuals are more than rounding."""
    for shot, result in zip(dataset.shots, shots, strict=True):
        if not result.used or result.fit is None or not np.isfinite(result.omega_rad_per_s):
            continue
        noisy = result.fit.noise_V > ROUNDING * result.fit.amplitude_V
        if noisy and len(result.residual_V) > 4 * BESIDE:
            yield shot, result


def _left(time_s: Array, shot: ShotResult) -> Left:
    t, r = time_s[shot.kept], shot.residual_V
    interval_s = float(np.median(np.diff(t)))
    power = np.abs(np.fft.rfft(r))[1:-1] ** 2 / len(r)
    # The median does not mind a few lines.
    floor = float(np.median(power)) / np.log(2.0)
    bin_Hz = 1.0 / (interval_s * len(r))
    tone = round(shot.omega_rad_per_s / (2.0 * np.pi) / bin_Hz) - 1
    return Left(power / floor, 0.5 * r**2 / floor, t, bin_Hz, tone)


def _place(left: Left, limit: float) -> str | None:
    """Return where a record has more than noise, the least probable place; None where nowhere."""
    chance, middle = _least(left.power, 1.0, BINS)
    by_time, instant = _least(left.square, 0.5, SAMPLES)
    if min(chance, by_time) >= limit:
        return None
    if chance <= by_time:
        return f"at about {(middle + 1.0) * left.bin_Hz:.4g} Hz"
    return f"at about {1e3 * float(left.time_s[int(instant)]):.3g} ms"


def _together(left: Sequence[Left], limit: float) -> bool:
    """Tell whether all shots together have more than noise beside their tones, or at a time."""
    count = float(len(left))
    beside = [
        residual.power[residual.tone - BESIDE : residual.tone + BESIDE + 1]
        for residual in left
        if BESIDE <= residual.tone < len(residual.power) - BESIDE
    ]
    length = min(len(residual.square) for residual in left)
    at_times = np.sum([residual.square[:length] for residual in left], axis=0)
    chance = _least(at_times, 0.5 * count, SAMPLES)[0]
    if beside:
        chance = min(chance, _least(np.sum(beside, axis=0), float(len(beside)), BINS)[0])
    return chance < limit


def _least(values: Array, shape: float, widths: Sequence[int]) -> tuple[float, float]:
    """Return the least chance of a window's sum of gamma deviates, and the window's middle."""
    best, place = 1.0, 0.0
    for width in widths:
        if width > len(values):
            continue
        sums = sliding_window_view(values, width).sum(axis=1)
        first = int(np.argmax(sums))
        chance = float(gammaincc(shape * width, sums[first]))
        if chance < best:
            best, place = chance, first + 0.5 * (width - 1)
    return best, place
