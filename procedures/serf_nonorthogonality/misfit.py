"""What the fits leave that is no white noise: lines, bursts, stretches that are not followed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.special import gammaincc

from station.findings import Flag

from .dataset import SerfDataset, Shot
from .findings import ShotResult

Array = NDArray[np.float64]

CHANCE = 1e-4
"""How often white noise alone is flagged, at most."""
BINS, SAMPLES = (1, 4, 16), (4, 16, 64)
"""Widths of the windows over a spectrum and over a record."""
ROUNDING = 1e-9
"""Noise over signal of records that are computed and have none."""
BESIDE = 16
"""Bins to either side of a tone in which what all shots leave is taken together."""


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
    left = {one.name: _left(shot.time_s, one) for shot, one in _used(dataset, shots)}
    if not left:
        return []
    windows = sum(len(BINS) * len(a.power) + len(SAMPLES) * len(a.square) for a in left.values())
    limit = CHANCE / windows
    where = {name: said for name, one in left.items() if (said := _place(one, limit))}
    if not where and not _together(list(left.values()), limit):
        return []
    told = "; ".join(f"{name} {said}" for name, said in list(where.items())[:4])
    more = f" and {len(where) - 4} more" if len(where) > 4 else ""
    said = f"in {told}{more}" if where else "of all shots together, beside their tones"
    return [
        Flag(
            "misfit",
            f"The fits leave more than white noise {said}: the uncertainties do not cover it. Look "
            "for pick-up (mains_frequency), a field that moves during the record, lost or "
            "repeated rows, a recorder that stood still, a filter, light that goes off late, "
            "and repeat the shots.",
            None,
            {"shots": list(where) or list(left)},
        )
    ]


def _used(dataset: SerfDataset, shots: Sequence[ShotResult]) -> Iterator[tuple[Shot, ShotResult]]:
    """Yield the shots of the solution whose residuals are more than rounding."""
    for shot, one in zip(dataset.shots, shots, strict=True):
        if not one.used or one.fit is None or not np.isfinite(one.omega_rad_per_s):
            continue
        noisy = one.fit.noise_V > ROUNDING * one.fit.amplitude_V
        if noisy and len(one.residual_V) > 4 * BESIDE:
            yield shot, one


def _left(time_s: Array, shot: ShotResult) -> Left:
    t, r = time_s[shot.kept], shot.residual_V
    interval_s = float(np.median(np.diff(t)))
    power = np.abs(np.fft.rfft(r))[1:-1] ** 2 / len(r)
    # The median does not mind a few lines.
    floor = float(np.median(power)) / np.log(2.0)
    bin_Hz = 1.0 / (interval_s * len(r))
    tone = round(shot.omega_rad_per_s / (2.0 * np.pi) / bin_Hz) - 1
    return Left(power / floor, 0.5 * r**2 / floor, t, bin_Hz, tone)


def _place(one: Left, limit: float) -> str | None:
    """Return where a record has more than noise, the least probable place; None where nowhere."""
    chance, middle = _least(one.power, 1.0, BINS)
    by_time, instant = _least(one.square, 0.5, SAMPLES)
    if min(chance, by_time) >= limit:
        return None
    if chance <= by_time:
        return f"at about {(middle + 1.0) * one.bin_Hz:.4g} Hz"
    return f"at about {1e3 * float(one.time_s[int(instant)]):.3g} ms"


def _together(left: Sequence[Left], limit: float) -> bool:
    """Tell whether all shots together have more than noise beside their tones, or at a time."""
    count = float(len(left))
    beside = [
        one.power[one.tone - BESIDE : one.tone + BESIDE + 1]
        for one in left
        if BESIDE <= one.tone < len(one.power) - BESIDE
    ]
    length = min(len(one.square) for one in left)
    at_times = np.sum([one.square[:length] for one in left], axis=0)
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
