"""Mishaps of records at rest that `sabotage_nine_axis.py` plants, each a change of a dataset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.nine_axis_calibration.dataset import NineAxisDataset, StaticRecord, TurnRecord

Array = NDArray[Any]
Spoil = Callable[[NineAxisDataset, np.random.Generator], NineAxisDataset]

ASKEW = frozenset({"wrong-position", "positions-disagree", "contradicts-statement"})
RESTLESS = frozenset({"bias-wanders", "output-step", "positions-disagree", "wrong-position"})
UNEVEN = frozenset({"misfit", "unsteady-rate", "outliers-rejected"})
STUCK = frozenset({"frozen", "overload"})


@dataclass(frozen=True)
class Plant:
    """A fault: what it does to a dataset, the codes that name its cause.

    `detectable` says so where rows differ.
    """

    name: str
    flags: frozenset[str]
    spoil: Spoil
    detectable: bool | None = None


def still(change: Callable[[Array, StaticRecord], Array], positions: tuple[int, ...] = ()) -> Spoil:
    """Return the fault that changes the gyros' readings (n, 3) at rest, in some positions."""

    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        static = tuple(
            replace(one, rate_deg_per_h=rounded(change(one.rate_deg_per_h.copy(), one), 4))
            if not positions or one.position in positions
            else one
            for one in dataset.static
        )
        return replace(dataset, static=static)

    return spoil


def force(change: Callable[[Array], Array], positions: tuple[int, ...] = ()) -> Spoil:
    """Return the fault that changes the accelerometers' readings (n, 3) in some positions."""

    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        static = tuple(
            replace(one, acceleration_g=rounded(change(one.acceleration_g.copy()), 6))
            if not positions or one.position in positions
            else one
            for one in dataset.static
        )
        return replace(dataset, static=static)

    return spoil


def _signed(values: Array, column: int) -> Array:
    values[:, column] *= -1.0
    return values


def _columns(*order: int) -> Callable[[Array], Array]:
    return lambda values: values[:, list(order)]


def rounded(values: Array, decimals: int) -> NDArray[np.float64]:
    return np.asarray(np.round(values, decimals), dtype=np.float64)


def _added(values: Array, column: int, extra: Array | float) -> Array:
    values[:, column] = values[:, column] + extra
    return values


def held(values: Array, column: int, start: int, stop: int) -> Array:
    values[start:stop, column] = values[start, column]
    return values


def ramp(one: StaticRecord | TurnRecord) -> Array:
    return np.linspace(0.0, 1.0, len(one.time_s))


def _labels(swap: dict[int, int]) -> Spoil:
    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        static = [
            replace(one, position=swap.get(one.position, one.position)) for one in dataset.static
        ]
        return replace(dataset, static=tuple(static))

    return spoil


def _latitude(change: Callable[[float], float]) -> Spoil:
    return lambda dataset, _: replace(dataset, latitude_deg=change(dataset.latitude_deg))


def _from_the_next(share: float) -> Spoil:
    """Return the fault that the first part of position 2 was still recorded in position 1."""

    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        first, second, *rest = dataset.static
        count = round(share * len(second.time_s))
        rate, sensed = second.rate_deg_per_h.copy(), second.acceleration_g.copy()
        rate[:count], sensed[:count] = first.rate_deg_per_h[:count], first.acceleration_g[:count]
        moved = replace(second, rate_deg_per_h=rate, acceleration_g=sensed)
        return replace(dataset, static=(first, moved, *rest))

    return spoil


def _bumped(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
    """Turn the plate by 1 deg about the vertical in the middle of position 3."""
    del rng
    static = list(dataset.static)
    third = static[2]
    rate = third.rate_deg_per_h.copy()
    latitude = np.radians(dataset.latitude_deg)
    rate[len(rate) // 2 :, 2] += 15.041 * np.cos(latitude) * np.radians(2.0)
    static[2] = replace(third, rate_deg_per_h=rate)
    return replace(dataset, static=tuple(static))


def _tilted(size_deg: float) -> Spoil:
    """Return the fault that position 1 leans about north beyond its prior."""

    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        first, *rest = dataset.static
        lean, latitude = np.radians(size_deg), np.radians(dataset.latitude_deg)
        rate, sensed = first.rate_deg_per_h.copy(), first.acceleration_g.copy()
        rate[:, 0] += 15.041 * np.sin(latitude) * lean
        sensed[:, 0] += lean
        return replace(
            dataset, static=(replace(first, rate_deg_per_h=rate, acceleration_g=sensed), *rest)
        )

    return spoil


def _copied_static(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
    """Give position 2 the gyros of position 1, as they felt it, turned to the plate's axes."""
    del rng
    first, second, *rest = dataset.static
    copied = replace(second, rate_deg_per_h=first.rate_deg_per_h.copy())
    return replace(dataset, static=(first, copied, *rest))


PER_DEG = np.pi / 180.0

STATIC_FAULTS = (
    Plant("gyro X inverted at rest", ASKEW, still(lambda v, _: _signed(v, 0))),
    Plant("gyros X and Y exchanged at rest", ASKEW, still(lambda v, _: v[:, [1, 0, 2]])),
    Plant("gyro Z a copy of Y at rest", ASKEW, still(lambda v, _: v[:, [0, 1, 1]])),
    Plant("rates at rest in deg/s", ASKEW, still(lambda v, _: v / 3600.0)),
    Plant("rates at rest in rad/h", ASKEW, still(lambda v, _: v * PER_DEG)),
    Plant("rates at rest 5 % too large", ASKEW, still(lambda v, _: v * 1.05)),
    Plant("earth rate taken off", ASKEW, still(lambda v, _: v - v.mean(axis=0))),
    Plant("accelerometers in m/s2", ASKEW, force(lambda v: v * 9.80665)),
    Plant("accelerometers inverted", ASKEW, force(lambda v: -v)),
    Plant("accelerometers exchanged", ASKEW, force(_columns(1, 0, 2))),
    Plant("accelerometer X 3 mg off", ASKEW, force(lambda v: _added(v, 0, 3e-3))),
    Plant(
        "accelerometer X 3 mg off in position 1", ASKEW, force(lambda v: _added(v, 0, 3e-3), (1,))
    ),
    Plant("positions 1 and 2 exchanged", ASKEW, _labels({1: 2, 2: 1})),
    Plant(
        "position 1 stood as 4", ASKEW, still(lambda v, _: v - np.array([0.0, 23.078, 0.0]), (1,))
    ),
    Plant("southern latitude", ASKEW, _latitude(lambda one: -one)),
    Plant("latitude 2 deg off", ASKEW, _latitude(lambda one: one + 2.0)),
    Plant("latitude of minutes as decimals", ASKEW, _latitude(lambda one: one - 0.36)),
    Plant("first quarter of 2 from 1", ASKEW | RESTLESS, _from_the_next(0.25)),
    Plant("first twentieth of 2 from 1", RESTLESS | UNEVEN, _from_the_next(0.05)),
    Plant("plate bumped in position 3", RESTLESS, _bumped),
    Plant("position 1 leans by 0.3 deg", ASKEW, _tilted(0.3)),
    Plant(
        "bias step of 0.5 deg/h in 2",
        RESTLESS,
        still(lambda v, _: _added(v, 0, 0.5 * (np.arange(len(v)) > 40)), (2,)),
    ),
    Plant(
        "bias 0.8 deg/h up from position 2",
        RESTLESS,
        still(lambda v, _: _added(v, 1, 0.8), (2, 3, 4, 5, 6)),
    ),
    Plant("bias 0.8 deg/h up in 3 only", RESTLESS, still(lambda v, _: _added(v, 2, 0.8), (3,))),
    Plant(
        "bias drifts 1 deg/h in a record", RESTLESS, still(lambda v, one: _added(v, 0, ramp(one)))
    ),
    Plant(
        "warm-up at rest",
        RESTLESS,
        still(lambda v, one: _added(v, 2, 3.0 * np.exp(-one.time_s / 40.0)), (1,)),
    ),
    Plant(
        "burst at rest",
        RESTLESS | UNEVEN,
        still(lambda v, _: _added(v, 0, 8.0 * (np.arange(len(v)) % 100 < 20))),
    ),
    Plant(
        "spikes at rest",
        UNEVEN,
        still(lambda v, _: _added(v, 1, 50.0 * (np.arange(len(v)) % 40 == 7))),
    ),
    Plant("gyro X stuck at rest", STUCK, still(lambda v, _: held(v, 0, 0, len(v)), (1,))),
    Plant(
        "gyro Y stuck for half of 2",
        STUCK,
        still(lambda v, _: held(v, 1, len(v) // 2, len(v)), (2,)),
    ),
    Plant("gyro Z reads zero in 3", STUCK | ASKEW, still(lambda v, _: v * [1.0, 1.0, 0.0], (3,))),
    Plant(
        "rates at rest in steps of 3 deg/h",
        frozenset({"coarse-output", "misfit"}),
        still(lambda v, _: np.round(v / 3.0) * 3.0),
    ),
    Plant("gyros of 1 copied to 2", ASKEW | STUCK, _copied_static),
    Plant(
        "swing with a period of 70 s",
        RESTLESS,
        still(lambda v, one: _added(v, 2, 1.5 * np.sin(0.09 * one.time_s))),
    ),
    Plant(
        "last rows of 1 lifted off",
        RESTLESS | UNEVEN,
        still(lambda v, _: np.vstack((v[:-8], v[-8:] + 20.0)), (1,)),
    ),
    Plant("gyro X rectified", ASKEW, still(lambda v, _: np.abs(v))),
)
