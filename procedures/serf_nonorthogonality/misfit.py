"""What the fits of the shots leave that is no white noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.special import gammaincc

from station.findings import Flag

from .dataset import ShotResult

Array = NDArray[np.float64]
CHANCE = 1e-4
"""How often white noise alone is flagged, at most."""
BINS, SAMPLES = (1, 4, 16), (4, 16, 64)
"""Widths of the windows over a spectrum and over a record."""
ROUNDING = 1e-9
"""Noise over signal of records that are computed and have none."""
BESIDE = 16
"""Bins to either side of a tone in which what all shots leave is taken together."""
MAX_NAMED = 4


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


def misfit_flags(shots: Sequence[ShotResult]) -> list[Flag]:
    """Return a flag where residuals have more in a stretch of time or spectrum than white noise.

    Each shot for itself, and all together beside their tones and by their time.
    """
    left = {
        shot.name: _left(shot)
        for shot in shots
        if np.isfinite(shot.omega_rad_per_s)
        and shot.used_fit.noise_V > ROUNDING * shot.used_fit.amplitude_V
        and len(shot.residual_V) > 4 * BESIDE
    }
    if not left:
        return []
    windows = sum(len(BINS) * len(a.power) + len(SAMPLES) * len(a.square) for a in left.values())
    limit = CHANCE / windows
    where = {name: text for name, residual in left.items() if (text := _place(residual, limit))}
    if not where and not _together(list(left.values()), limit):
        return []
    shown = "; ".join(f"{name} {text}" for name, text in list(where.items())[:MAX_NAMED])
    more = f" and {len(where) - MAX_NAMED} more" if len(where) > MAX_NAMED else ""
    text = f"in {shown}{more}" if where else "of all shots together, beside their tones"
    return [
        Flag(
            "misfit",
            f"The fits leave more than white noise {text}: the uncertainties do not cover it. Look "
            "for pick-up (mains_frequency), a recorder at its limits, a field that moves during "
            "the record, lost or repeated rows, a recorder that stood still, a filter, light that "
            "goes off late or not at the time zero of t_s, and repeat the shots.",
            None,
            {"shots": list(where) or list(left)},
        )
    ]


def _left(shot: ShotResult) -> Left:
    t, r = shot.shot.time_s[shot.kept], shot.residual_V
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
