"""The linear part of a shot's fit at a given frequency and decay, and its slopes.

Everything the search needs is in the products of a few columns with each other and with the record,
so that a step costs one pass over the samples (variable projection, Golub and Pereyra 1973, with
the derivatives of Kaufman 1975).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rows_of(t: Array, omega: float, decay: float, slow: float, mains_Hz: float | None) -> Array:
    """Return the columns of the fit as rows (4 or 6, n): tone, baseline, offset, mains."""
    fade, turn = np.exp(-decay * t), omega * t
    base = fade if slow == decay else np.exp(-slow * t)
    rows = [fade * np.cos(turn), fade * np.sin(turn), base, np.ones_like(t)]
    if mains_Hz is not None:
        hum = 2.0 * np.pi * mains_Hz * t
        rows += [np.cos(hum), np.sin(hum)]
    return np.array(rows)


@dataclass(frozen=True)
class Projection:
    """The linear solution at a place: what is left of record and slopes beside the columns.

    `normal` (k, k) and `right` (k,) are the normal equations of the slopes by w and G, and by the
    chirp, the baseline's own decay and a steady drift of the frequency (relative, in 1/s) where
    these were asked for, `cost` the sum of squares that is left.
    """

    linear: Array
    normal: Array
    right: Array
    cost: float
    slow: float


def project(
    t: Array,
    y: Array,
    omega: float,
    decay: float,
    baseline_decay_per_s: float | None,
    mains_Hz: float | None,
    *,
    chirp: bool = False,
) -> Projection:
    """Return the linear solution; the baseline is as fast as the tone where no decay is given.

    The chirp is by how much frequency and decay are higher at the beginning, relative, as the
    slowing-down factor of a fading polarisation makes them to first order in its square: both
    rates are larger by the share c e^(-2 G t).
    """
    slow = decay if baseline_decay_per_s is None else baseline_decay_per_s
    rows = rows_of(t, omega, decay, slow, mains_Hz)
    count = len(rows)
    tone = rows[:2]
    late = [t * tone[0], t * tone[1]]
    if baseline_decay_per_s is None:
        late.append(t * rows[2])
    if chirp:
        early = -np.expm1(-2.0 * decay * t) / (2.0 * decay)
        late += [early * tone[0], early * tone[1], t * rows[2], t * late[0], t * late[1]]
    everything = np.vstack([rows, *late, y])
    products = everything @ everything.T
    scale = np.sqrt(np.diag(products)[:count])
    inner = products[:count, :count] / np.outer(scale, scale)
    beside = products[:count, count:] / scale[:, None]
    solved = np.linalg.solve(inner, beside)
    # Of everything but the columns, what is left when the columns are taken off.
    left = products[count:, count:] - beside.T @ solved
    linear = solved[:, -1] / scale
    a, b, c = (float(one) for one in linear[:3])
    mixing = np.zeros((len(late), 5 if chirp else 2))
    mixing[:2, 0] = b, -a
    mixing[:2, 1] = -a, -b
    if baseline_decay_per_s is None:
        mixing[2, 1] = -c
    if chirp:
        mixing[-5:-3, 2] = omega * b - decay * a, -omega * a - decay * b
        mixing[-3, 3] = -c
        mixing[-2:, 4] = 0.5 * omega * b, -0.5 * omega * a
    return Projection(
        linear=linear,
        normal=mixing.T @ left[:-1, :-1] @ mixing,
        right=mixing.T @ left[:-1, -1],
        cost=max(float(left[-1, -1]), 0.0),
        slow=slow,
    )
