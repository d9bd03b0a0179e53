"""Whether the means hold the earth's rate as the stated directions say: unit, sign, labels.

An axis that is to feel less than `MIN_EARTH_DEG_PER_H` shows none of it, nor does a gyro whose bias
is as large as the earth's rate: then the unit and the sense of the output are as stated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import permutations
from operator import mul

import numpy as np

from procedures.estimation.readings import DEG_PER_H, Reading, Remainder, named, suiting
from station.findings import Flag, contradiction

from .dataset import Array, StaticDataset

MIN_EARTH_DEG_PER_H = 1.0
ZERO, REVERSED = 0.005, 0.04
"""Parts of the earth's rate within which a mean is none, or is its opposite."""
TRIAD = 3


def earth_flags(dataset: StaticDataset, means: Sequence[float]) -> list[Flag]:
    """Return the flags of means (axes,) in deg/h, NaN for none, that contradict the directions."""
    names = list(dataset.directions)
    earth = np.array(
        [axis.earth_deg_per_h(dataset.latitude_rad) for axis in dataset.directions.values()]
    )
    read = np.array(means)
    flags = [
        flag
        for name, own, mean in zip(names, earth, read, strict=True)
        if abs(own) > MIN_EARTH_DEG_PER_H and np.isfinite(mean)
        for flag in _axis(name, float(own), float(mean))
    ]
    if not flags and len(names) == TRIAD and bool(np.isfinite(read).all()):
        flags += _labels(names, earth, read)
    return flags


def _axis(name: str, earth: float, mean: float) -> Iterator[Flag]:
    """Yield the flag of an axis that reads nothing of the earth, or its opposite."""
    ratio = mean / earth
    should = f"{name} reads {mean:.4g} deg/h where it should feel {earth:.4g} deg/h of the earth"
    if abs(ratio) < ZERO:
        units = [
            Reading[float](f"the output is in {unit}", partial(mul, factor), "unit")
            for unit, factor in DEG_PER_H.items()
        ]
        suits = suiting(mean, [units], lambda rate: Remainder((rate - earth) ** 2, 1.0))
        likely = f": it fits if {named(suits)}" if suits else ""
        sentence = (
            f"{should}{likely}. Look at the unit of the output, whether the earth's rate was taken "
            "off before, and whether the gyro works; every result goes with the unit."
        )
        yield contradiction("input_axis", sentence, name, ratio=ratio)
    elif abs(ratio + 1.0) < REVERSED:
        sentence = (
            f"{should}: its sign is the other one. Look whether the input axis points as stated, "
            "and at the sign of the output; the bias goes with it."
        )
        yield contradiction("input_axis", sentence, name, ratio=ratio)


def _labels(names: Sequence[str], earth: Array, read: Array) -> Iterator[Flag]:
    """Yield the flag of axes of a triad under each other's names."""
    orders = [order for order in permutations(range(TRIAD)) if order != tuple(range(TRIAD))]
    readings = [
        Reading[Array](
            f"the columns hold {', '.join(names[k] for k in order)} in this order",
            partial(_ordered, order),
            "input_axis",
        )
        for order in orders
    ]
    suits = suiting(read, [readings], lambda rates: Remainder(_squares(rates - earth), TRIAD))
    if suits:
        sentence = (
            f"The means of {', '.join(names)} are off the earth's rate by "
            f"{np.sqrt(_squares(read - earth) / TRIAD):.3g} deg/h; they fit if {named(suits)}. "
            "Correct the columns or the directions; each bias is that of another axis."
        )
        yield contradiction("input_axis", sentence, None, exchanged=True)


def _ordered(order: tuple[int, ...], rates: Array) -> Array:
    """Return the rates of the axes where column n holds that of axis `order[n]`."""
    return np.asarray(rates[np.argsort(order)])


def _squares(rates: Array) -> float:
    return float(rates @ rates)
