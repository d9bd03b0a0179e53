"""What is known of one axis at rest when it has been analysed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.estimation.allan import AllanDeviation
from procedures.estimation.channel import Screened

from .bridging import bridged, pieces
from .bursts import MAX_BURSTS, Burst, strongest_burst
from .dataset import Array, Record
from .means import Minimum
from .noise_fit import NoiseFit


@dataclass(frozen=True)
class Disturbed:
    """A burst of a switch-on that is left out, in s from power-on."""

    switch_on: int
    begin_s: float
    end_s: float
    count: int
    burst: Burst


@dataclass(frozen=True)
class AxisAnalysis:
    """One axis: screened records, means and samples of switch-ons, noise, and Allan deviation.

    In deg/h, what of the warm-up is in the mean of the means, and how far that may have `walked`.
    """

    axis: str
    screened: tuple[Screened, ...]
    means: Array
    counts: Array
    fit: NoiseFit | None
    minimum: Minimum | None
    curve: AllanDeviation | None
    disturbed: tuple[Disturbed, ...] = ()
    tail: float = 0.0
    walked: float = 0.0


def without_bursts(
    records: Sequence[Record], grids: Sequence[Array], fit: NoiseFit | None, interval_s: float
) -> tuple[list[Array], tuple[Disturbed, ...]]:
    """Return the records on their grids with NaN in bursts, and these; none without a noise."""
    if fit is None:
        return list(grids), ()
    kept, disturbed = [], []
    for record, grid in zip(records, grids, strict=True):
        rate = grid.copy()
        for piece in pieces(rate):
            for _ in range(MAX_BURSTS):
                filled = bridged(piece, interval_s, fit.theta, 0.0)
                columns = fit.columns(len(piece), interval_s)
                burst = strongest_burst(filled, interval_s, fit, columns)
                if burst is None:
                    break
                before = np.isfinite(rate)
                piece[burst.first : burst.stop] = np.nan  # a view of `rate`
                lost = np.flatnonzero(before & ~np.isfinite(rate))
                if not len(lost):
                    break
                begin_s, end_s = float(record.time_s[0]) + interval_s * lost[[0, -1]]
                number = record.switch_on
                disturbed.append(Disturbed(number, begin_s, end_s, len(lost), burst))
        kept.append(rate)
    return kept, tuple(disturbed)
