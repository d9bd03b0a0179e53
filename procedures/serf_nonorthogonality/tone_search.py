"""The search for a decaying tone: from the peaks of weighted spectra down to a minimum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MAX_ITERATIONS = 40
ENOUGH = 1e-9
"""Of the sum of squares: with a thousand samples a thousandth of an uncertainty."""
SHARES_OF_SPAN = (1.5, 4.0, 10.0, 25.0, 60.0, 150.0)
"""Decays to begin with, in 1/e times that the record holds."""
MIN_SAMPLES = 12
"""Within the 1/e time of a decay to begin with."""
PADDING = 4
MAX_STARTS = 4
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
    starts: list[tuple[float, float, float]] = []
    for share in SHARES_OF_SPAN:
        decay = share / span_s
        if decay * interval_s * MIN_SAMPLES > 1.0:
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
            starts.append((float(power[k]), float(frequency[k]), decay))
            power[np.abs(frequency - frequency[k]) < width] = 0.0
    starts.sort(key=lambda start: -start[0])
    chosen: list[tuple[float, float]] = []
    for _, omega, decay in starts:
        near = 2.0 * np.pi * APART / span_s
        if all(abs(omega - other) > near or decay != same for other, same in chosen):
            chosen.append((omega, decay))
    return chosen[:MAX_STARTS]


# The linear part of a fit at a given frequency and decay, and its slopes. All that the search needs
# is in the products of a few columns with each other and with the record, so that a step costs one
# pass over the samples (variable projection, Golub and Pereyra 1973; derivatives: Kaufman 1975).


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
    a, b, c = (float(value) for value in linear[:3])
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


@dataclass(frozen=True)
class Minimum:
    """A minimum of the search."""

    omega: float
    decay: float
    slow: float
    linear: Array
    cost: float
    inverse: Array
    chirp: tuple[float, float, float]
    """The value, its u, and the frequency's derivative by it; so too the baseline's decay."""
    rate: tuple[float, float, float]
    drift: tuple[float, float]
    freedom: int


def descend(
    t: Array,
    y: Array,
    start: tuple[float, float],
    baseline_decay_per_s: float | None,
    mains_Hz: float | None,
    steps: int,
) -> tuple[float, float, float] | None:
    """Go down from a start by damped Gauss-Newton: frequency, decay, cost; None at no tone."""
    omega, decay = start
    largest = np.pi / float(np.median(np.diff(t)))
    damping = 1e-3
    here = project(t, y, omega, decay, baseline_decay_per_s, mains_Hz)
    for _ in range(steps):
        squared = np.diag(here.normal)
        if not bool(np.all(np.isfinite(squared)) and np.all(squared > 0.0)):
            return None
        scale = np.sqrt(squared)
        small, right = here.normal / np.outer(scale, scale), here.right / scale
        for _ in range(12):
            step = np.linalg.solve(small + damping * np.eye(2), right) / scale
            new_omega, new_decay = omega + float(step[0]), decay + float(step[1])
            if new_decay > 0.0 and 0.0 < new_omega < largest:
                after = project(t, y, new_omega, new_decay, baseline_decay_per_s, mains_Hz)
                if after.cost <= here.cost:
                    break
            damping *= 8.0
        else:
            break
        gained = here.cost - after.cost
        omega, decay, here, damping = new_omega, new_decay, after, 0.1 * damping
        if gained <= ENOUGH * here.cost:
            break
    return omega, decay, here.cost


def minimum_from(
    t: Array,
    y: Array,
    start: tuple[float, float],
    baseline_decay_per_s: float | None,
    mains_Hz: float | None,
) -> Minimum | None:
    """Return the minimum that a start leads to; None where that is no decaying tone."""
    minimum = descend(t, y, start, baseline_decay_per_s, mains_Hz, MAX_ITERATIONS)
    if minimum is None:
        return None
    omega, decay, _ = minimum
    span_s = float(t[-1] - t[0])
    if omega * span_s < np.pi or decay * span_s < 0.05:
        return None
    here = project(t, y, omega, decay, baseline_decay_per_s, mains_Hz, chirp=True)
    own = here.normal[:2, :2]
    scale = np.sqrt(np.diag(own))
    if not bool(np.all(np.isfinite(here.normal)) and np.all(scale > 0.0)):
        return None
    small = own / np.outer(scale, scale)
    if np.linalg.cond(small) > 1e12:
        return None
    inverse = np.asarray(np.linalg.inv(small) / np.outer(scale, scale), dtype=np.float64)
    freedom = max(len(t) - len(here.linear) - 2, 1)
    noise = float(np.sqrt(here.cost / freedom))
    more = []
    for place in (2, 3):
        share = inverse @ here.normal[:2, place]
        power = float(here.normal[place, place] - here.normal[place, :2] @ share)
        if power > 0.0:
            step = float(here.right[place] - share @ here.right[:2]) / power
            more.append((step, noise / float(np.sqrt(power)), -float(share[0])))
        else:
            more.append((0.0, np.inf, 0.0))
    chirp, (step, rate_u, by_rate) = more
    drift = beyond(here.normal[:, [0, 1, 2, 4]][[0, 1, 2, 4]], here.right[[0, 1, 2, 4]], noise)
    rate = here.slow + step, rate_u if baseline_decay_per_s is not None else np.inf, by_rate
    return Minimum(
        omega, decay, here.slow, here.linear, here.cost, inverse, chirp, rate, drift, freedom
    )


def beyond(normal: Array, right: Array, noise: float) -> tuple[float, float]:
    """Return the last unknown of normal equations (k, k), and its u, infinite where it has none."""
    scale = np.sqrt(np.diag(normal))
    if not bool(np.all(scale > 0.0)):
        return 0.0, np.inf
    small = normal / np.outer(scale, scale)
    if np.linalg.cond(small) > 1e12:
        return 0.0, np.inf
    inverse = np.linalg.inv(small)
    value = float(inverse[-1] @ (right / scale)) / float(scale[-1])
    return value, noise * float(np.sqrt(inverse[-1, -1])) / float(scale[-1])
