"""Where the search for a decaying tone begins: an exponentially weighted spectrum on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHARES_OF_SPAN = (1.5, 4.0, 10.0, 25.0, 60.0, 150.0)
"""Decays to begin with, in 1/e times that the record holds."""
LEAST_SAMPLES = 12
"""Within the 1/e time of a decay to begin with."""
PADDING = 4
MOST_STARTS = 4
APART = 1.5
"""How far two starts lie apart, in widths of the record's spectrum or of the decay."""


def starting_points(t: Array, y: Array, mains_Hz: float | None) -> list[tuple[float, float]]:
    """Return up to four pairs of angular frequency and decay, the most promising first.

    For each decay of a grid the record, freed from offset and from baselines of this decay and its
    half, is weighted with that decay: the matched filter of the tone. Uneven samples count as even.
    """
    count = len(t)
    interval_s = float(t[-1] - t[0]) / (count - 1)
    span_s = count * interval_s
    length = PADDING * int(2 ** np.ceil(np.log2(count)))
    frequency = 2.0 * np.pi * np.fft.rfftfreq(length, interval_s)
    since = t - t[0]
    found: list[tuple[float, float, float]] = []
    for share in SHARES_OF_SPAN:
        decay = share / span_s
        if decay * interval_s * LEAST_SAMPLES > 1.0:
            break
        columns = [np.ones(count), np.exp(-decay * since), np.exp(-0.5 * decay * since)]
        if mains_Hz is not None:
            turn = 2.0 * np.pi * mains_Hz * t
            columns += [np.cos(turn), np.sin(turn)]
        basis, _ = np.linalg.qr(np.column_stack(columns))
        weight = np.exp(-decay * since)
        left = (y - basis @ (basis.T @ y)) * weight
        power = np.abs(np.fft.rfft(left, length)) ** 2 / float(weight @ weight)
        width = APART * max(2.0 * np.pi / span_s, decay)
        # Below one cycle in the record there is no tone; nor at the very end of the spectrum.
        power[frequency < 2.0 * np.pi * 0.7 / span_s] = 0.0
        power[-2:] = 0.0
        for _ in range(3):
            k = int(np.argmax(power))
            if power[k] <= 0.0:
                break
            found.append((float(power[k]), float(frequency[k]), decay))
            power[np.abs(frequency - frequency[k]) < width] = 0.0
    found.sort(key=lambda one: -one[0])
    chosen: list[tuple[float, float]] = []
    for _, omega, decay in found:
        near = 2.0 * np.pi * APART / span_s
        if all(abs(omega - other) > near or decay != same for other, same in chosen):
            chosen.append((omega, decay))
    return chosen[:MOST_STARTS]
