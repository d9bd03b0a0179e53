"""Slow terms of an accelerometer's output, temperature and drift: which may be, how likely each is.

An average over the models takes the place of choosing one: a drift too small to be chosen may be
large against the noise of a coefficient that resembles it. It is that of Burnham and Anderson,
Model Selection and Multimodel Inference, 2002, section 4.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .orthogonal import CHARGE

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Terms = Mapping[str, Array]
"""Columns (rows,) of slow terms by their names, temperature first, then drift."""
K0_T, KI_T = "K0_T", "Ki_T"
USUAL = {K0_T: 30e-6, KI_T: 100e-6}
"""Per degC and in parts of Ki: the temperature terms of quartz accelerometers with a flexure, 20 to
50 µg and 80 to 150 ppm."""
DRIFT = "drift "
WARMED_K = 0.05
"""From such a range of temperature on no criterion is asked: at 150 ppm/degC it is 7.5 µV at 1 g,
and where temperature follows the angle the coefficients take it up and leave no residual."""
FEWEST_LEFT = 3
"""So many rows must be left over, or no value is given: fewer say neither how large the noise is
nor whether the model holds. Where temperature terms would leave fewer, the criterion is asked all
the same, and what is left out is in the uncertainty."""
AKAIKE = 2.0


def stacked(terms: Terms, rows: int) -> Array:
    """Return the columns of terms as (rows, m)."""
    return np.column_stack([np.empty((rows, 0)), *terms.values()])


def candidates(fixed: Array, terms: Terms, kept: Mask) -> list[list[str]]:
    """Return the names of the slow terms of each model that may be.

    Every order of drift with no temperature term, with K0_T, and with K0_T and Ki_T; only with both
    where the temperature changed by more than `WARMED_K`. `fixed` (rows, k) are the columns that
    are always there; only `kept` rows count.
    """
    warm = [name for name in terms if not name.startswith(DRIFT)]
    drift = [name for name in terms if name.startswith(DRIFT)]
    left = int(kept.sum()) - fixed.shape[1] - len(warm)
    sure = left >= FEWEST_LEFT and has_warmed(terms, kept)
    heads = [warm] if sure or not warm else [[], warm[:1], warm]
    return [[*head, *drift[:order]] for head in heads for order in range(len(drift) + 1)]


def likelihoods(
    squares: Sequence[float], models: Sequence[Sequence[str]], count: int, free: int
) -> Array:
    """Return how likely each of the `candidates` is by the squares it left of `count` rows.

    `free` are the degrees of freedom that the largest leaves. A linear drift costs what Akaike's
    criterion asks: most coefficients of a plan in the published order resemble one. Other terms
    cost what they cost where one is chosen.
    """
    linear = np.array([f"{DRIFT}1" in model for model in models])
    others = np.array([len(model) for model in models]) - linear
    charge = CHARGE * np.log(count) * count / max(free, 1)
    criterion = max(free, 1) * np.log(squares) + AKAIKE * linear + charge * others
    share = np.exp(-0.5 * (criterion - criterion.min()))
    return np.asarray(share / share.sum())


def apart(share: Array, values: Array) -> Array:
    """Return the covariance (k, k) of how far the `values` (n, k) of n models lie apart."""
    off = values - share @ values
    return np.asarray(np.einsum("n,ni,nj->ij", share, off, off))


def has_warmed(terms: Terms, kept: Mask) -> bool:
    """Return whether the temperature of the kept rows changed by more than `WARMED_K`."""
    return K0_T in terms and float(np.ptp(terms[K0_T][kept])) > WARMED_K
