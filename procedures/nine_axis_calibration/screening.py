"""Samples that measured nothing, saturated or frozen: found, and kept out of every mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .dataset import NineAxisDataset, TurnRecord

Array = NDArray[np.float64]

AT_THE_END = 1.0 - 1e-6
MOST_OF_A_RECORD = 0.01
STUCK = 0.3
FEWEST_STUCK = 5
TOO_LITTLE = 0.999
FEWEST_FROZEN = 10
"""So many samples in a row are never the same by chance, all axes together."""
USUALLY_NEW = 0.9
"""Of coarse data, of which fewer are new beside the longest repeat, none counts as frozen."""


@dataclass(frozen=True)
class Saturated:
    """Saturated samples of one turned axis at one rate; `whole` when the record is left out."""

    axis: int
    commanded_deg_per_s: float
    count: int
    whole: bool


def without_saturated(
    dataset: NineAxisDataset,
) -> tuple[NineAxisDataset, tuple[Saturated, ...], int]:
    """Return the dataset without saturated samples, which ones those were, and how many at rest.

    A record of which more than a hundredth is saturated is left out: what is cut off at one end
    makes the mean of the others wrong. Where the range is not known, output that stands still at
    its largest value and is too small for the encoder's rate counts as saturated.
    """
    range_deg_per_s = dataset.largest_rate_deg_per_s
    found: list[Saturated] = []
    turns = []
    gains = _gains(dataset.turns)
    for record, gain in zip(dataset.turns, gains, strict=True):
        rate = record.rate_deg_per_s
        own = rate[:, record.axis]
        over = _beyond(rate, range_deg_per_s)
        usual = _usual_gain(dataset.turns, gains, record)
        if not bool(over[:, record.axis].any()) and _stands_still(own, gain, usual):
            over[:, record.axis] = True
        count = int(over[:, record.axis].sum())
        if bool(over.any()):
            whole = over.mean(axis=0) > MOST_OF_A_RECORD
            over[:, whole] = True
            record = replace(record, rate_deg_per_s=np.where(over, np.nan, rate))
            if count:
                found.append(
                    Saturated(
                        record.axis, record.commanded_deg_per_s, count, bool(whole[record.axis])
                    )
                )
        turns.append(record)
    static, at_rest = [], 0
    for still in dataset.static:
        over = _beyond(still.rate_deg_per_h / 3600.0, range_deg_per_s)
        at_rest += int(over.sum())
        if bool(over.any()):
            still = replace(still, rate_deg_per_h=np.where(over, np.nan, still.rate_deg_per_h))
        static.append(still)
    return replace(dataset, static=tuple(static), turns=tuple(turns)), tuple(found), at_rest


def _beyond(rate: Array, range_deg_per_s: float | None) -> NDArray[np.bool_]:
    if range_deg_per_s is None:
        return np.zeros(rate.shape, dtype=bool)
    return np.asarray(np.abs(rate) >= AT_THE_END * range_deg_per_s)


def _gains(records: Sequence[TurnRecord]) -> list[float]:
    """Return each record's median output over its commanded rate."""
    found = []
    for one in records:
        own = one.rate_deg_per_s[:, one.axis]
        own = own[np.isfinite(own)]
        found.append(float(np.median(own)) / one.commanded_deg_per_s if len(own) else np.nan)
    return found


def _usual_gain(records: Sequence[TurnRecord], gains: Sequence[float], record: TurnRecord) -> float:
    """Return the gain of the other rates of the same axis that are slower; NaN without any."""
    slower = [
        gain
        for one, gain in zip(records, gains, strict=True)
        if one.axis == record.axis
        and abs(one.commanded_deg_per_s) < abs(record.commanded_deg_per_s)
        and np.isfinite(gain)
    ]
    return float(np.median(slower)) if slower else np.nan


def _stands_still(own: Array, gain: float, usual: float) -> bool:
    values = own[np.isfinite(own)]
    if len(values) < FEWEST_STUCK or not np.isfinite(usual) or gain >= TOO_LITTLE * usual:
        return False
    top = values[np.argmax(np.abs(values))]
    share = float(np.mean(values == top))
    return share > STUCK and share * len(values) >= FEWEST_STUCK


def without_frozen(dataset: NineAxisDataset) -> tuple[NineAxisDataset, int, int]:
    """Return the dataset without samples that repeat one before, and their numbers.

    At rest and turning. The first of those that are alike counts.
    """
    static, turns = [], []
    at_rest = turning = 0
    for still in dataset.static:
        frozen = frozen_samples(np.column_stack((still.rate_deg_per_h, still.acceleration_g)))
        at_rest += int(frozen.sum())
        rates, forces = (
            np.where(frozen[:, None], np.nan, one)
            for one in (still.rate_deg_per_h, still.acceleration_g)
        )
        static.append(replace(still, rate_deg_per_h=rates, acceleration_g=forces))
    for record in dataset.turns:
        frozen = frozen_samples(record.rate_deg_per_s)
        turning += int(frozen.sum())
        rates = np.where(frozen[:, None], np.nan, record.rate_deg_per_s)
        turns.append(replace(record, rate_deg_per_s=rates))
    if at_rest + turning:
        dataset = replace(dataset, static=tuple(static), turns=tuple(turns))
    return dataset, at_rest, turning


def frozen_samples(values: Array) -> NDArray[np.bool_]:
    """Return which samples (n, columns) repeat the one before, in a row of ten alike or more."""
    frozen = np.zeros(len(values), dtype=bool)
    there = values[:, np.isfinite(values).any(axis=0)]
    if not there.size:
        return frozen
    new = np.append(True, np.any(there[1:] != there[:-1], axis=1))
    starts = np.flatnonzero(new)
    lengths = np.diff(np.append(starts, len(values)))
    for start, length in zip(starts, lengths, strict=True):
        if length >= FEWEST_FROZEN:
            frozen[start + 1 : start + length] = True
    others = new[~frozen]
    return frozen if float(others.mean()) > USUALLY_NEW else np.zeros_like(frozen)
