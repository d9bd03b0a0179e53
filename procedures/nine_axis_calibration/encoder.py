"""The table's encoder: continuous angle and true rate from readings modulo 360 deg."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .dataset import TurnRecord

Array = NDArray[np.float64]

WILD_ENCODER = 50.0


@dataclass(frozen=True)
class Encoder:
    """The encoder of one record: continuous `angle_deg` (n,) and each sample's true rate (n,)."""

    angle_deg: Array
    rate_deg_per_s: Array
    mean_rate_deg_per_s: float
    noise_deg: float
    reversed: bool


def unwrap(record: TurnRecord, interval_s: float) -> Encoder:
    """Return the encoder's continuous angle and the true rate during each sample.

    Steps are told from whole turns by the rate, first the commanded one, then the measured one, so
    that neither a gap nor a table some per cent off its rate slips a turn. A wild reading is taken
    from its neighbours. The first sample gets the mean rate: where it began was not read.
    """
    time_s, reading = record.time_s, record.encoder_deg
    known = np.isfinite(reading)
    if int(known.sum()) < 2:
        nothing = np.full(len(time_s), np.nan)
        return Encoder(nothing, nothing, np.nan, 0.0, False)
    place, nominal = np.flatnonzero(known), record.commanded_deg_per_s
    step_s, step = np.diff(time_s[place]), np.diff(reading[place])
    against = _spread(step, -nominal, step_s) < 0.1 * _spread(step, nominal, step_s)
    rate = -nominal if against else nominal
    turned = _nearest(step, rate, step_s)
    short = step_s <= 1.5 * float(np.median(step_s))
    rate = float(np.median(turned[short] / step_s[short]))
    turned = _nearest(step, rate, step_s)
    angle = reading[place[0]] + np.concatenate(([0.0], np.cumsum(turned)))
    straight = rate * (time_s[place] - time_s[place[0]])
    off = angle - straight
    off = off - np.median(off)
    # A table wanders slowly: a wild reading differs from both of its neighbours.
    jump = np.abs(np.diff(off))
    usual = float(np.median(jump))
    wild = np.zeros(len(place), dtype=bool)
    far = jump > max(WILD_ENCODER * usual, 1e-3)
    wild[1:-1] = far[:-1] & far[1:]
    if bool(wild.any()):
        # The turn that a wild reading was counted into may be wrong on both of its sides.
        good = np.flatnonzero(~wild)
        place = place[good]
        turned = _nearest(np.diff(reading[place]), rate, np.diff(time_s[place]))
        angle = reading[place[0]] + np.concatenate(([0.0], np.cumsum(turned)))
    whole = np.interp(time_s, time_s[place], angle)
    edge = time_s > time_s[place[-1]]
    whole[edge] = angle[-1] + rate * (time_s[edge] - time_s[place[-1]])
    before = time_s < time_s[place[0]]
    whole[before] = angle[0] + rate * (time_s[before] - time_s[place[0]])
    mean = float((angle[-1] - angle[0]) / (time_s[place[-1]] - time_s[place[0]]))
    rates = np.concatenate(([mean], np.diff(whole) / np.diff(time_s)))
    return Encoder(whole, rates, mean, _reading_noise(rates[1:], interval_s), bool(against))


def _nearest(step: Array, rate: float, step_s: Array) -> Array:
    """Return the steps, known modulo 360 deg, that come nearest to a rate."""
    expected = rate * step_s
    return np.asarray(expected + np.mod(step - expected + 180.0, 360.0) - 180.0)


def _spread(step: Array, rate: float, step_s: Array) -> float:
    """Return how badly steps modulo 360 deg fit a rate: a median in deg."""
    return float(np.median(np.abs(_nearest(step, rate, step_s) - rate * step_s))) + 1e-9


def _reading_noise(rates: Array, interval_s: float) -> float:
    """Return the noise of an encoder reading, from neighbouring rates: they share one reading."""
    if len(rates) < 8:
        return 0.0
    off = rates - np.median(rates)
    shared = -float(np.mean(off[1:] * off[:-1]))
    return float(np.sqrt(max(shared, 0.0))) * interval_s
