"""A table's encoder: continuous angle and true rate from readings modulo 360 deg."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WILD_ENCODER = 20.0
"""Steps further off the turn than this many usual ones, in median magnitudes, are wild."""
SMALLEST_WILD_DEG = 1e-3
ALIKE = 0.3
ROUNDS = 5
FINEST = 9
UNSTEADY = 8.0
FEWEST_FOR_NEIGHBOURS, FEWEST_FOR_LINE = 9, 3


@dataclass(frozen=True)
class Encoder:
    """The encoder of one record: continuous `angle_deg` (n,) and each sample's true rate (n,).

    `wild` is how many of its readings do not fit the turn. `unsteady` (n,) are the samples in which
    the table was not at its rate, as while it spins up.
    """

    angle_deg: Array
    rate_deg_per_s: Array
    mean_rate_deg_per_s: float
    noise_deg: float
    reversed: bool
    wild: int
    unsteady: Mask


def unwrap(time_s: Array, reading: Array, nominal: float, interval_s: float) -> Encoder:
    """Return the continuous angle of readings (n,) and the true rate during each sample.

    `nominal` is the commanded rate in deg/s; readings in deg modulo 360, NaN where there is none.

    Steps are distinguished from whole turns by the rate, first the commanded, then the measured
    one, so that neither a gap nor a table some per cent off its rate slips a turn. A wild reading,
    the first and the last one too, is taken from the others. The first sample gets the usual rate:
    where it began was not read.
    """
    known = np.isfinite(reading)
    if int(known.sum()) < 2:
        nothing = np.full(len(time_s), np.nan)
        steady = np.zeros(len(time_s), dtype=bool)
        return Encoder(nothing, nothing, np.nan, 0.0, False, 0, steady)
    place = np.flatnonzero(known)
    step_s, step = np.diff(time_s[place]), np.diff(reading[place])
    against = _spread(step, -nominal, step_s) < 0.1 * _spread(step, nominal, step_s)
    rate = -nominal if against else nominal
    turned = _nearest(step, rate, step_s)
    short = step_s <= 1.5 * float(np.median(step_s))
    rate = float(np.median(turned[short] / step_s[short]))
    good, turned = _without_wild(time_s[place], reading[place], rate)
    wild = len(place) - len(good)
    place = place[good]
    angle = reading[place[0]] + np.concatenate(([0.0], np.cumsum(turned)))
    whole = np.interp(time_s, time_s[place], angle)
    edge = time_s > time_s[place[-1]]
    whole[edge] = angle[-1] + rate * (time_s[edge] - time_s[place[-1]])
    before = time_s < time_s[place[0]]
    whole[before] = angle[0] + rate * (time_s[before] - time_s[place[0]])
    mean = float((angle[-1] - angle[0]) / (time_s[place[-1]] - time_s[place[0]]))
    rates = np.concatenate(([mean], np.diff(whole) / np.diff(time_s)))
    floor = max(SMALLEST_WILD_DEG, 3.0 * _finest_deg(reading[place])) / interval_s
    unsteady = _unsteady(rates, floor)
    if bool(unsteady.any()):
        rates[0] = rate
    noise_deg = _reading_noise(rates[1:], interval_s)
    if FEWEST_FOR_LINE < len(place) < FEWEST_FOR_NEIGHBOURS and not bool(unsteady.any()):
        noise_deg = _off_a_line(time_s[place], angle)
    return Encoder(whole, rates, mean, noise_deg, bool(against), wild, unsteady)


def _without_wild(time_s: Array, reading: Array, rate: float) -> tuple[NDArray[np.int64], Array]:
    """Return which readings (n,) are good, and the steps between them.

    A table gains and loses speed over several readings; a wild one steps away from the turn and
    back again, and at either end of the record once. Without it the turn is counted anew.
    """
    good = np.arange(len(time_s))
    floor = max(SMALLEST_WILD_DEG, 3.0 * _finest_deg(reading))
    for _ in range(ROUNDS):
        turned = _nearest(np.diff(reading[good]), rate, np.diff(time_s[good]))
        off = turned - rate * np.diff(time_s[good])
        off = off - np.median(off)
        far = np.abs(off) > max(WILD_ENCODER * float(np.median(np.abs(off))), floor)
        wild = np.zeros(len(good), dtype=bool)
        back = np.abs(off[1:] + off[:-1]) < ALIKE * np.maximum(np.abs(off[1:]), np.abs(off[:-1]))
        wild[1:-1] = far[:-1] & far[1:] & back
        if not bool(wild.any()) and len(off) > 2:
            wild[0] = far[0] and not far[1]
            wild[-1] = far[-1] and not far[-2]
        if not bool(wild.any()) or int(np.sum(~wild)) < 2:
            break
        good = good[~wild]
    return good, _nearest(np.diff(reading[good]), rate, np.diff(time_s[good]))


def _finest_deg(reading: Array) -> float:
    """Return the last decimal place of the readings, in deg."""
    for places in range(FINEST):
        if bool(np.all(np.abs(reading - np.round(reading, places)) < 1e-10)):
            return float(10.0**-places)
    return 0.0


def _unsteady(rates: Array, floor: float) -> Mask:
    """Return in which samples the table was not at its rate; where the first began is not known."""
    off = np.abs(rates - np.median(rates))
    usual = 1.4826 * float(np.median(off[1:]))
    unsteady = off > max(UNSTEADY * usual, floor)
    unsteady[0] = False
    return np.asarray(unsteady)


def _nearest(step: Array, rate: float, step_s: Array) -> Array:
    """Return the steps, known modulo 360 deg, that come nearest to a rate."""
    expected = rate * step_s
    return np.asarray(expected + np.mod(step - expected + 180.0, 360.0) - 180.0)


def _spread(step: Array, rate: float, step_s: Array) -> float:
    """Return how badly steps modulo 360 deg fit a rate: a median in deg."""
    return float(np.median(np.abs(_nearest(step, rate, step_s) - rate * step_s))) + 1e-9


def _reading_noise(rates: Array, interval_s: float) -> float:
    """Return the noise of an encoder reading, from neighbouring rates: they share one reading."""
    if len(rates) < FEWEST_FOR_NEIGHBOURS - 1:
        return 0.0
    off = rates - np.median(rates)
    shared = -float(np.mean(off[1:] * off[:-1]))
    return float(np.sqrt(max(shared, 0.0))) * interval_s


def _off_a_line(time_s: Array, angle_deg: Array) -> float:
    """Return the standard deviation of a few angles about an even turn."""
    straight = np.vander(time_s - time_s[0], 2)
    solved, *_ = np.linalg.lstsq(straight, angle_deg, rcond=None)
    left = angle_deg - straight @ solved
    return float(np.sqrt(left @ left / (len(left) - 2)))
