"""Pulses that a board has counted in each interval, from its running counter."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def pulses_of(counts: NDArray[Any]) -> NDArray[np.int64]:
    """Return the pulses (n - 1,) between successive counts (n,); the counter is 32 bits wide."""
    return np.asarray(np.mod(np.diff(counts.astype(np.int64)) + 2**31, 2**32) - 2**31)
