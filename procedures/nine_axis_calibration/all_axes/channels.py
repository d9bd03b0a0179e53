"""What a recorder did to accelerometers and magnetometer: limits that cut them off, and steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from procedures.common.frozen import IN_A_SHORT_RECORD, frozen_flag
from procedures.estimation.channel import copied, smallest_step
from procedures.estimation.flags import counted
from procedures.nine_axis_calibration.dataset import ALWAYS_NEW, AXES, Mask
from procedures.nine_axis_calibration.means import good_samples, rounding_u
from station.findings import Flag

from .stands import FIELD, FORCE, Array, OtherAxes

OUTLIER = 5.0
MAX_AT_LIMIT = 0.01
"""A record of which more samples are at the limit is left out: its mean is wrong."""
PILED_UP, FEW = 3.0, 5
"""A limit holds three times as many samples as the level before it, and five more. The crest of a
sine in coarse steps holds 2.4 times as many; normal noise fewer."""
MOVES = 0.5
"""Of a channel whose noise moves it more samples differ from the one before."""
SHORT_OF_GRAVITY = 0.9
BLURRED = 0.3
"""Noise of a smaller standard deviation, in steps, does not blur them."""
NEARLY_ALIKE = 1e-9
SENSORS = {FORCE: ("accelerometer", "g"), FIELD: ("magnetometer", "nT")}


@dataclass(frozen=True)
class Steps:
    """Of three channels: `step` (3,), what it leaves in the mean of a record that stands still as
    a standard uncertainty, `rounding` (3,), and whether noise leaves it sharp, `coarse`."""

    step: Array
    rounding: Array
    coarse: tuple[bool, ...]

    def flags(self, what: str) -> Iterator[Flag]:
        """Yield a flag for each axis of `FORCE` or `FIELD` whose steps its noise does not blur."""
        sensor, unit = SENSORS[what]
        for axis in np.flatnonzero(self.coarse):
            step, rounding = float(self.step[axis]), float(self.rounding[axis])
            message = (
                f"The output of the {sensor} {AXES[axis]} has steps of {step:.3g} {unit}, larger "
                f"than its noise: each mean may be off by {rounding:.2g} {unit}, however long the "
                "record. That is in the uncertainties. Record with more digits, or in a finer "
                "range."
            )
            yield Flag("coarse-output", message, AXES[axis], {"step": step, "sensor": sensor})


def steps_of(records: Sequence[Array], residuals: Sequence[Array]) -> Steps:
    """Return the steps of three channels from records (n, 3) and what models leave of them."""
    step, rounding, coarse = np.zeros(3), np.zeros(3), [False] * 3
    for channel in range(3):
        columns = [_finite(record[:, channel]) for record in records]
        step[channel] = smallest_step(np.concatenate([np.zeros(0), *columns]))
        variances = []
        for residual in residuals:
            own = residual[:, channel]
            # The steps themselves spread a channel whose median noise is none.
            inside = own[good_samples(own, OUTLIER, BLURRED * step[channel])]
            if len(inside) > 1:
                variances.append(float(np.var(inside, ddof=1)))
        if step[channel] and variances:
            variance = float(np.mean(variances))
            rounding[channel] = rounding_u(columns, variance)
            noise = np.sqrt(max(variance - step[channel] ** 2 / 12.0, 0.0))
            coarse[channel] = bool(noise < BLURRED * step[channel])
    return Steps(step, rounding, tuple(coarse))


def screened(data: OtherAxes) -> tuple[OtherAxes, list[Flag]]:
    """Return the data with NaN for an axis of a record that measured nothing, and the flags of it.

    Such records pile up at a limit, or stand still where others change from sample to sample.
    """
    saturated: list[Flag] = []
    still: list[Flag] = []
    copies: list[Flag] = []
    for what, (sensor, unit) in SENSORS.items():
        records = data.records(what)
        names = [name for name, _, _ in records]
        samples = [samples.copy() for _, _, samples in records]
        for axis, axis_name in enumerate(AXES):
            about: dict[str, object] = {"sensor": sensor}
            columns = [samples[:, axis] for _, _, samples in records]
            for limit in _limits(records, axis, data.gravity_g if what == FORCE else None):
                at = [_at(values, limit) for values in columns]
                places = [n for n, here in enumerate(at) if here.mean() > MAX_AT_LIMIT]
                count = sum(int(here.sum()) for here in at)
                message = (
                    f"The {sensor} {axis_name} stands at {limit:.6g} {unit} in "
                    f"{counted(count, 'sample')}: that is its limit, and not what it felt. Its "
                    f"records of {_listed(names, places) or 'no stand'} are left out. Choose a "
                    "wider range, and measure again."
                )
                details = {"count": count, "limit": limit, **about}
                saturated.append(Flag("saturated", message, axis_name, details))
                for n in places:
                    samples[n][:, axis] = np.nan
            places = _still([own[:, axis] for own in samples], records, axis)
            if places:
                count = sum(len(_finite(columns[n])) for n in places)
                then = f"It is left out of the records of {_listed(names, places)}."
                reading, extent = (
                    f"The output of the {sensor} {axis_name}",
                    counted(count, "sample"),
                )
                details = {"count": count, **about}
                still.append(frozen_flag(reading, extent, "the sensor", then, details, axis_name))
                for n in places:
                    samples[n][:, axis] = np.nan
        for axis, other in combinations(range(3), 2):
            twin = [copied(own[:, axis], own[:, other]) for _, _, own in records]
            if places := np.flatnonzero(twin).tolist():
                copies.append(_copy(sensor, (axis, other), records, places))
            for n in places:
                samples[n][:, [axis, other]] = np.nan
        data = data.with_records(what, samples)
    return data, [*saturated, *still, *copies]


Records = Sequence[tuple[str, bool, Array]]


def _copy(sensor: str, axes: tuple[int, int], records: Records, places: Sequence[int]) -> Flag:
    """Return the flag of two axes that are one in the records at `places`."""
    a, b = (AXES[axis] for axis in axes)
    count = sum(len(records[n][2]) for n in places)
    where = _listed([name for name, _, _ in records], places)
    then = (
        f"It is that of {a}: which of the two was copied is not known, and both are left out of "
        f"the records of {where}."
    )
    details = {"count": count, "sensor": sensor, "copy_of": a}
    return frozen_flag(
        f"The output of the {sensor} {b}", counted(count, "sample"), "the sensor", then, details, b
    )


def _limits(records: Records, axis: int, gravity_g: float | None) -> list[float]:
    """Return the values that one or more records pile up at, at the ends of all of them.

    In steps larger than the noise they all do: there a limit is where no axis ever reads
    `gravity_g` and several stop at the same value.
    """
    columns = [own for _, _, samples in records if len(own := _finite(samples[:, axis])) > 1]
    if not columns:
        return []
    every = np.concatenate(columns)
    at_rest = [samples[:, axis] for _, turned, samples in records if not turned]
    # A channel that stands still in its steps piles up wherever it stands.
    noisy = float(np.median([_moving(own) for own in at_rest or columns])) > MOVES
    limits = []
    for end in (float(every.max()), float(every.min())):
        away = np.abs(every - end)
        away = away[away > NEARLY_ALIKE * max(abs(end), 1e-300)]
        next_to = 1.5 * float(np.min(away, initial=np.inf))
        for values in columns if len(away) else ():
            at = _at(values, end)
            beside = int(np.sum(np.abs(values - end) <= next_to)) - int(at.sum())
            piled = int(at.sum()) > PILED_UP * beside + FEW
            if piled and (noisy or _moving(values[~at]) > MOVES):
                limits.append(end)
                break
    if limits or gravity_g is None:
        return limits
    largest = np.array([_largest(samples) for _, _, samples in records]).max(axis=0)
    limit = float(largest.max())
    half = 0.5 * smallest_step(every)
    alike = np.abs(largest - limit) <= NEARLY_ALIKE * limit
    short = SHORT_OF_GRAVITY * gravity_g <= limit < gravity_g - half
    if not (short and alike.sum() > 1 and alike[axis]):
        return []
    return [end for end in (limit, -limit) if bool(_at(every, end).any())]


def _still(columns: Sequence[Array], records: Records, axis: int) -> list[int]:
    """Return which records (n,) of an axis have a single value, where their like change.

    These are the other records at rest, or on the table where none is at rest; where they all have
    a single value, the other axes of the same records.
    """
    there = [n for n, own in enumerate(columns) if np.isfinite(own).sum() >= IN_A_SHORT_RECORD]
    still = [n for n in there if float(np.ptp(_finite(columns[n]))) == 0.0]
    like = [n for n in there if not records[n][1]] or there
    moving = [_moving(columns[n]) for n in like if n not in still] or [
        _moving(records[n][2][:, other])
        for n in like
        for other in range(3)
        if n in still and other != axis
    ]
    return still if moving and float(np.median(moving)) > ALWAYS_NEW else []


def _largest(samples: Array) -> Array:
    return np.asarray(np.nanmax(np.abs(samples), axis=0, initial=0.0))


def _at(values: Array, limit: float) -> Mask:
    return np.asarray(np.abs(values - limit) <= NEARLY_ALIKE * abs(limit))


def _finite(values: Array) -> Array:
    return np.asarray(values[np.isfinite(values)])


def _moving(values: Array) -> float:
    """Return the share of samples that differ from the one before, NaN aside."""
    changes = np.diff(_finite(values))
    return float(np.mean(changes != 0.0)) if len(changes) else 0.0


def _listed(names: Sequence[str], places: Sequence[int]) -> str:
    return ", ".join(dict.fromkeys(names[n] for n in places))
