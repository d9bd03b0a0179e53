"""Which coefficients a plan determines, and what the others fold into."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .orthogonal import split_columns

Array = NDArray[np.float64]
Terms = dict[str, dict[str, float]]

SMALLEST_RMS = 1e-6
"""A column is dependent when its part orthogonal to the kept ones has an rms below this."""
SMALLEST_TERM = 5e-6
"""What a dependent column may seem to have of a kept one by the tolerance above."""


def folded_terms(names: Sequence[str], columns: Array, scale: Array) -> Terms:
    """Return each kept coefficient as the combination that it measures, in the coefficients' units.

    `columns` (n, k) are those of a model in the order in which they are judged, each divided by its
    `scale` (k,). A column is kept where it is independent of those kept before it; the others fold
    into the kept ones: {"K0": {"K0": 1, "Kpp": 1}}.
    """
    split = split_columns(columns, SMALLEST_RMS)
    terms: Terms = {}
    for row, index in enumerate(split.kept):
        own: dict[str, float] = {names[index]: 1.0}
        for j, name in enumerate(names):
            share = float(split.folds[row, j])
            if j not in split.kept and abs(share) > SMALLEST_TERM:
                # c_j X_j = c_j F f_i, both columns over their scales: F s_j / s_i in true units.
                own[name] = tidy(round(share, 9) * float(scale[j] / scale[index]))
        terms[names[index]] = own
    return terms


def tidy(value: float) -> float:
    """Return a share without the digits that rounding leaves."""
    return float(f"{value:.12g}")
