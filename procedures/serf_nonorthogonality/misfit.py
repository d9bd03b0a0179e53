"""What the fits of the shots leave that is no white noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import gammaincc

from station.findings import Flag

from .dataset import ShotResult

CHANCE = 1e-4
"""How often white noise alone is flagged, at most."""
BINS = (1, 4, 16)
"""Widths of the windows over a spectrum."""
ROUNDING = 1e-9
"""Noise over signal of records that are computed and have none."""
FEWEST = 64
MAX_NAMED = 4


def misfit_flags(shots: Sequence[ShotResult]) -> list[Flag]:
    """Return a flag where residuals have more in a stretch of their spectrum than white noise."""
    noisy = [
        shot
        for shot in shots
        if np.isfinite(shot.omega_rad_per_s)
        and shot.used_fit.noise_V > ROUNDING * shot.used_fit.amplitude_V
        and len(shot.residual_V) > FEWEST
    ]
    windows = sum(0.5 * len(shot.residual_V) * len(BINS) for shot in noisy)
    where = {s.name: text for s in noisy if (text := _place(s, CHANCE / windows)) is not None}
    if not where:
        return []
    shown = "; ".join(f"{name} {text}" for name, text in list(where.items())[:MAX_NAMED])
    more = f" and {len(where) - MAX_NAMED} more" if len(where) > MAX_NAMED else ""
    return [
        Flag(
            "misfit",
            f"The fits leave more than white noise in {shown}{more}: the uncertainties do not "
            "cover it. Look for pick-up (mains_frequency), a recorder at its limits, a field that "
            "moves during the record, lost or repeated rows, a recorder that stood still, a "
            "filter, light that goes off late or not at the time zero of t_s, and repeat the "
            "shots.",
            None,
            {"shots": list(where)},
        )
    ]


def _place(shot: ShotResult, limit: float) -> str | None:
    """Return where a record has more than noise, the least probable place; None where nowhere."""
    left = shot.residual_V
    power = np.abs(np.fft.rfft(left))[1:-1] ** 2 / len(left)
    # The median does not mind a few lines.
    power /= float(np.median(power)) / np.log(2.0)
    places = []
    for width in BINS:
        sums = sliding_window_view(power, width).sum(axis=1)
        first = int(np.argmax(sums))
        places.append((float(gammaincc(width, sums[first])), first + 0.5 * (width - 1)))
    chance, middle = min(places)
    if chance >= limit:
        return None
    bin_Hz = 1.0 / (float(np.median(np.diff(shot.shot.time_s[shot.kept]))) * len(left))
    return f"at about {(middle + 1.0) * bin_Hz:.4g} Hz"
