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

# fmt: off
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
    Plant("accelerometer X 3 mg off in position 1", ASKEW,
        force(lambda v: _added(v, 0, 3e-3), (1,))),
    Plant("positions 1 and 2 exchanged", ASKEW, _labels({1: 2, 2: 1})),
    Plant("position 1 stood as 4", ASKEW,
        still(lambda v, _: v - np.array([0.0, 23.078, 0.0]), (1,))),
    Plant("southern latitude", ASKEW, _latitude(lambda one: -one)),
    Plant("latitude 2 deg off", ASKEW, _latitude(lambda one: one + 2.0)),
    Plant("latitude of minutes as decimals", ASKEW, _latitude(lambda one: one - 0.36)),
    Plant("first quarter of 2 from 1", ASKEW | RESTLESS, _from_the_next(0.25)),
    Plant("first twentieth of 2 from 1", RESTLESS | UNEVEN, _from_the_next(0.05)),
    Plant("plate bumped in position 3", RESTLESS, _bumped),
    Plant("position 1 leans by 0.3 deg", ASKEW, _tilted(0.3)),
    Plant("bias step of 0.5 deg/h in 2", RESTLESS,
        still(lambda v, _: _added(v, 0, 0.5 * (np.arange(len(v)) > 40)), (2,))),
    Plant("bias 0.8 deg/h up from position 2", RESTLESS,
        still(lambda v, _: _added(v, 1, 0.8), (2, 3, 4, 5, 6))),
    Plant("bias 0.8 deg/h up in 3 only", RESTLESS, still(lambda v, _: _added(v, 2, 0.8), (3,))),
    Plant("bias drifts 1 deg/h in a record", RESTLESS,
        still(lambda v, one: _added(v, 0, ramp(one)))),
    Plant("warm-up at rest", RESTLESS,
        still(lambda v, one: _added(v, 2, 3.0 * np.exp(-one.time_s / 40.0)), (1,))),
    Plant("burst at rest", RESTLESS | UNEVEN,
        still(lambda v, _: _added(v, 0, 8.0 * (np.arange(len(v)) % 100 < 20)))),
    Plant("spikes at rest", UNEVEN,
        still(lambda v, _: _added(v, 1, 50.0 * (np.arange(len(v)) % 40 == 7)))),
    Plant("gyro X stuck at rest", STUCK, still(lambda v, _: held(v, 0, 0, len(v)), (1,))),
    Plant("gyro Y stuck for half of 2", STUCK,
        still(lambda v, _: held(v, 1, len(v) // 2, len(v)), (2,))),
    Plant("gyro Z reads zero in 3", STUCK | ASKEW, still(lambda v, _: v * [1.0, 1.0, 0.0], (3,))),
    Plant("rates at rest in steps of 3 deg/h", frozenset({"coarse-output", "misfit"}),
        still(lambda v, _: np.round(v / 3.0) * 3.0)),
    Plant("gyros of 1 copied to 2", ASKEW | STUCK, _copied_static),
    Plant("swing with a period of 70 s", RESTLESS,
        still(lambda v, one: _added(v, 2, 1.5 * np.sin(0.09 * one.time_s)))),
    Plant("last rows of 1 lifted off", RESTLESS | UNEVEN,
        still(lambda v, _: np.vstack((v[:-8], v[-8:] + 20.0)), (1,))),
    Plant("gyro X rectified", ASKEW, still(lambda v, _: np.abs(v))),
)
# fmt: on


def turning(
    change: Callable[[TurnRecord, Array], TurnRecord],
    pick: Callable[[TurnRecord], bool] = lambda _: True,
) -> Spoil:
    """Return the fault that changes the records of a turning axis; it gets its gyro's readings."""

    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        turns = tuple(
            change(one, one.rate_deg_per_s[:, one.axis].copy()) if pick(one) else one
            for one in dataset.turns
        )
        return replace(dataset, turns=turns)

    return spoil


def own(change: Callable[[Array, TurnRecord], Array]) -> Callable[[TurnRecord, Array], TurnRecord]:
    """Return the change of the turned gyro's readings alone."""

    def changed(one: TurnRecord, values: Array) -> TurnRecord:
        rate = one.rate_deg_per_s.copy()
        rate[:, one.axis] = np.round(change(values, one), 7)
        return replace(one, rate_deg_per_s=rate)

    return changed


def angle(change: Callable[[TurnRecord], Array]) -> Callable[[TurnRecord, Array], TurnRecord]:
    """Return the change of the encoder's readings alone."""
    return lambda one, _: replace(one, encoder_deg=rounded(np.mod(change(one), 360.0), 5))


def fastest(one: TurnRecord) -> bool:
    return one.axis == 0 and one.commanded_deg_per_s == 100.0


def slowest(one: TurnRecord) -> bool:
    return one.axis == 1 and one.commanded_deg_per_s == 1.0


def middle(one: TurnRecord) -> bool:
    return one.axis == 2 and one.commanded_deg_per_s == 10.0


def _copied_axis(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
    """Give axis Y the records of axis X."""
    del rng
    turns = [one for one in dataset.turns if one.axis != 1]
    turns += [
        replace(one, axis=1, rate_deg_per_s=one.rate_deg_per_s[:, [1, 0, 2]])
        for one in dataset.turns
        if one.axis == 0
    ]
    turns.sort(key=lambda one: one.axis)
    return replace(dataset, turns=tuple(turns))


def _mislabelled(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
    """Call the fastest record of Y one of X."""
    del rng
    turns = []
    for one in dataset.turns:
        if one.axis == 1 and one.commanded_deg_per_s == 50.0:
            one = replace(one, axis=0, rate_deg_per_s=one.rate_deg_per_s[:, [1, 0, 2]])
        turns.append(one)
    return replace(dataset, turns=tuple(turns))


def _lag(tau_s: float) -> Callable[[Array, TurnRecord], Array]:
    """Return the tail of a filter that had not settled at the record's start."""
    return lambda values, one: values - one.commanded_deg_per_s * 1e-4 * np.exp(-one.time_s / tau_s)


def _clipped(limit: float) -> Callable[[Array, TurnRecord], Array]:
    return lambda values, _: np.clip(values, -limit, limit)


def _in_time(drift: Callable[[float], float]) -> Spoil:
    """Return the fault of a bias that moves from record to record: deg/h over table time in s."""

    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        turns, at_s = [], 0.0
        for one in dataset.turns:
            rate = one.rate_deg_per_s.copy()
            extra = np.array([drift(at_s + float(t)) for t in one.time_s]) / 3600.0
            rate[:, one.axis] = np.round(rate[:, one.axis] + extra, 7)
            turns.append(replace(one, rate_deg_per_s=rate))
            at_s += float(one.time_s[-1]) + 20.0
        return replace(dataset, turns=tuple(turns))

    return spoil


def _sine_of_encoder(size_deg: float, order: int = 1) -> Callable[[TurnRecord], Array]:
    return lambda one: one.encoder_deg + size_deg * np.sin(order * np.radians(one.encoder_deg))


def _stretched(ppm: float) -> Callable[[TurnRecord, Array], TurnRecord]:
    return lambda one, _: replace(one, time_s=one.time_s * (1.0 + 1e-6 * ppm))


def _lost_and_closed(one: TurnRecord, values: Array) -> TurnRecord:
    """Lose a reading; the time stamps are counted anew."""
    del values
    keep = np.delete(np.arange(len(one.time_s)), len(one.time_s) // 2)
    return replace(
        one,
        time_s=one.time_s[: len(keep)],
        rate_deg_per_s=one.rate_deg_per_s[keep],
        encoder_deg=one.encoder_deg[keep],
    )


def _grown(values: Array, one: TurnRecord) -> Array:
    return np.asarray(values + 2e-3 * np.sin(7.0 * one.time_s) * ramp(one) ** 2)


def _part(values: Array, start: float, stop: float, extra: float) -> Array:
    count = len(values)
    values[round(start * count) : round(stop * count)] += extra
    return values


def _backwards(one: TurnRecord, values: Array) -> TurnRecord:
    del values
    return replace(one, time_s=one.time_s[::-1].copy())


def _jitter(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
    turns = [
        replace(one, time_s=np.round(one.time_s + 0.02 * rng.standard_normal(len(one.time_s)), 4))
        for one in dataset.turns
    ]
    return replace(dataset, turns=tuple(turns))


def _gain_drift(size: float) -> Spoil:
    """Return the fault of a scale factor that settles over the records of an axis."""

    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        turns = []
        for n, one in enumerate(dataset.turns):
            rate = one.rate_deg_per_s.copy()
            place = n % 10 + ramp(one)
            rate[:, one.axis] = np.round(rate[:, one.axis] * (1.0 + size * np.exp(-place)), 7)
            turns.append(replace(one, rate_deg_per_s=rate))
        return replace(dataset, turns=tuple(turns))

    return spoil


def _askew(lean_deg: float) -> Spoil:
    """Return the fault of a sensor mounted askew: the turned gyro feels less, the others more."""

    def spoil(dataset: NineAxisDataset, rng: np.random.Generator) -> NineAxisDataset:
        del rng
        lean, latitude = np.radians(lean_deg), np.radians(dataset.latitude_deg)
        level = 15.041 * np.cos(latitude) / 3600.0 * np.sin(lean)
        turns = []
        for one in dataset.turns:
            rate = one.rate_deg_per_s.copy()
            swing = level * np.cos(np.radians(one.encoder_deg - 0.5 * one.commanded_deg_per_s))
            lost = (np.cos(lean) - 1.0) * one.commanded_deg_per_s
            rate[:, one.axis] += swing * np.sinc(one.commanded_deg_per_s / 360.0) + lost
            rate[:, (one.axis + 1) % 3] += np.sin(lean) * one.commanded_deg_per_s
            turns.append(replace(one, rate_deg_per_s=np.round(rate, 7)))
        return replace(dataset, turns=tuple(turns))

    return spoil


REFUSED = frozenset({"refused"})
STATED = frozenset({"contradicts-statement", "rate-differs-from-commanded"})

# fmt: off
TURNING_FAULTS = (
    Plant("rates at rest and turning differ by 3 %", ASKEW, turning(own(lambda v, _: 1.03 * v))),
    Plant("turned gyro inverted", STATED, turning(own(lambda v, _: -v))),
    Plant("rates in rad/s", STATED, turning(own(lambda v, _: v * PER_DEG))),
    Plant("rates in deg/h", STATED, turning(own(lambda v, _: v * 3600.0))),
    Plant("one record in rad/s", STATED | UNEVEN, turning(own(lambda v, _: v * PER_DEG), fastest)),
    Plant("encoder in rad", REFUSED, turning(angle(lambda one: one.encoder_deg * PER_DEG))),
    Plant("encoder the other way round", REFUSED, turning(angle(lambda one: -one.encoder_deg))),
    Plant("time in ms", REFUSED | STATED,
        turning(lambda one, _: replace(one, time_s=1e3 * one.time_s))),
    Plant("times run backwards", REFUSED, turning(_backwards, fastest), True),
    Plant("clock 300 ppm off in one record", UNEVEN, turning(_stretched(300.0), fastest)),
    Plant("a row lost at 1 deg/s, times closed", UNEVEN, turning(_lost_and_closed, slowest), True),
    Plant("offset 8 deg/h in the slowest", UNEVEN,
        turning(own(lambda v, _: v + 8.0 / 3600.0), slowest)),
    Plant("step of 30 deg/h at 10 deg/s", UNEVEN | {"output-step"},
        turning(own(lambda v, _: _part(v, 0.5, 1.0, 30.0 / 3600.0)), middle)),
    Plant("bias warms up over the turns", UNEVEN, _in_time(lambda t: 15.0 * np.exp(-t / 400.0))),
    Plant("bias jumps half way through X", UNEVEN, _in_time(lambda t: 8.0 * (t > 100.0))),
    Plant("filter had not settled at 100 deg/s", UNEVEN, turning(own(_lag(6.0)), fastest)),
    Plant("filter had not settled", UNEVEN, turning(own(_lag(4.0)))),
    Plant("clipped at 99.9 deg/s", STUCK, turning(own(_clipped(99.9)))),
    Plant("clipped at exactly 100 deg/s", STUCK, turning(own(_clipped(100.0)))),
    Plant("gyro held for half a record", STUCK | UNEVEN,
        turning(own(lambda v, _: held(v[:, None], 0, len(v) // 2, len(v))[:, 0] - 1e-3), fastest)),
    Plant("gyro reads zero in a record", STUCK | STATED | UNEVEN,
        turning(own(lambda v, _: 0.0 * v), slowest)),
    Plant("output in steps of 0.01 deg/s", frozenset({"coarse-output"}),
        turning(own(lambda v, _: np.round(v / 0.01) * 0.01))),
    Plant("encoder graduation 0.01 deg", UNEVEN, turning(angle(_sine_of_encoder(0.01)))),
    Plant("encoder graduation 0.004 deg, twice a turn", UNEVEN,
        turning(angle(_sine_of_encoder(0.004, 2)))),
    Plant("encoder slips 0.05 deg", UNEVEN,
        turning(angle(lambda one: one.encoder_deg + 0.05 * (ramp(one) > 0.6)), fastest)),
    Plant("encoder slips 0.0008 deg at 1 deg/s", UNEVEN,
        turning(angle(lambda one: one.encoder_deg + 8e-4 * (ramp(one) > 0.6)), slowest)),
    Plant("encoder stuck at the end", UNEVEN, turning(angle(lambda one: held(one.encoder_deg[:,
        None].copy(), 0, len(one.time_s) - 8, len(one.time_s))[:, 0]), slowest)),
    Plant("encoder creeps at the end", UNEVEN,
        turning(angle(lambda one: one.encoder_deg + 0.01 * np.clip(ramp(one) - 0.8, 0.0, None)),
        slowest)),
    Plant("encoder one turn too many", UNEVEN,
        turning(angle(lambda one: one.encoder_deg * 1.001), slowest)),
    Plant("axis Y a copy of X", STUCK, _copied_axis, True),
    Plant("a record of Y called X", STUCK | UNEVEN, _mislabelled, True),
    Plant("spikes while turning", UNEVEN,
        turning(own(lambda v, one: v + 0.05 * (np.arange(len(v)) % 20 == 3)))),
    Plant("burst while turning", UNEVEN,
        turning(own(lambda v, _: _part(v, 0.3, 0.45, 0.003)), slowest)),
    Plant("growing noise", UNEVEN, turning(own(_grown))),
    Plant("mains beat", UNEVEN,
        turning(own(lambda v, one: v + 1e-3 * np.sin(0.045 * one.time_s)), slowest)),
    Plant("stamps jitter by 20 ms", UNEVEN, _jitter),
    Plant("encoder noise 0.02 deg", UNEVEN,
        turning(angle(lambda one: one.encoder_deg + 0.02 * np.sin(1e4 * one.time_s**1.5)))),
    Plant("encoder lies at one angle", UNEVEN,
        turning(angle(lambda one: one.encoder_deg + 0.02 * (np.mod(one.encoder_deg,
        360.0) < 40.0)))),
    Plant("clipped at 100 deg/s forth only", STUCK,
        turning(own(lambda v, _: np.minimum(v, 100.0)))),
    Plant("block copied within a record", STUCK,
        turning(own(lambda v, _: np.concatenate((v[20:40], v[20:]))[: len(v)]), slowest)),
    Plant("scale factor drifts 1000 ppm", UNEVEN, _gain_drift(1e-3)),
    Plant("mounted 4 deg askew", STATED | {"cross-axis"}, _askew(4.0)),
    Plant("noise ten times at the fastest", UNEVEN,
        turning(own(lambda v, one: v + 2e-3 * np.sin(1e4 * one.time_s**1.5)), fastest)),
    Plant("even term 1e-7 of the square", UNEVEN,
        turning(own(lambda v, one: v + 1e-7 * one.commanded_deg_per_s**2))),
    Plant("time 1 s late from the middle", UNEVEN,
        turning(lambda one, _: replace(one, time_s=one.time_s + 1.0 * (ramp(one) > 0.5)), middle)),
    Plant("first tenth from the rate before", UNEVEN,
        turning(own(lambda v, _: _part(v, 0.0, 0.1, -20.0)), middle)),
)
# fmt: on
