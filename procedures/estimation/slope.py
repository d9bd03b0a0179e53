"""The slope of a noisy record and its uncertainty, whatever the colour of the noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BLOCKS = 60


def slope_with_uncertainty(
    time_s: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[float, float]:
    """Fit a line to block means; return its slope and standard uncertainty per second.

    Arrays have shape (samples,). Block means take the quantisation noise, which is blue, out of
    the uncertainty; a lag-1 correlation of what remains widens it.
    """
    blocks = min(BLOCKS, len(time_s) // 4)
    if blocks < 4:
        return float("nan"), float("inf")
    edges = np.linspace(0, len(time_s), blocks + 1).astype(int)
    counts = np.diff(edges)
    t = np.add.reduceat(time_s, edges[:-1]) / counts
    y = np.add.reduceat(values, edges[:-1]) / counts
    t = t - t.mean()
    slope = float(t @ y / (t @ t))
    residuals = y - y.mean() - slope * t
    variance = float(residuals @ residuals) / (blocks - 2)
    lag1 = float(residuals[1:] @ residuals[:-1]) / max(float(residuals @ residuals), 1e-300)
    widening = (1 + max(lag1, 0.0)) / (1 - min(max(lag1, 0.0), 0.9))
    return slope, float(np.sqrt(variance * widening / (t @ t)))
