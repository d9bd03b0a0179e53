"""What a recorder did to accelerometers and magnetometer: limits that cut them off, and steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation.flags import counted, frozen
from procedures.estimation.frozen import IN_A_SHORT_RECORD
from procedures.nine_axis_calibration.dataset import ALWAYS_NEW, AXES, Mask
from procedures.nine_axis_calibration.means import (
    good_samples,
    rounding_u,
    smallest_step,
)
from station.findings import Flag

from .stands import Array, OtherAxes

OUTLIER = 5.0
MAX_AT_LIMIT = 0.01
"""A record of which more samples are at the limit is left out: its mean is wrong."""
PILED_UP, FEW = 3.0, 5
"""A limit holds three times as many samples as the level before it, and five more. The crest of a
sine in coarse steps holds 2.4 times as many; normal noise fewer."""
BLURRED = 0.3
"""Noise of a smaller standard deviation, in steps, does not blur them."""
NEARLY_ALIKE = 1e-9
SAME_STEP = 0.1
"""Of a quiet channel the nearest two records are ten steps apart at most."""
ACCELEROMETER, MAGNETOMETER = "accelerometer", "magnetometer"
UNITS = {ACCELEROMETER: "g", MAGNETOMETER: "nT"}

Named = dict[tuple[str, int], Array]


@dataclass(frozen=True)
class Steps:
    """Of three channels: `step` (3,), what it leaves in the mean of a record that stands still as
    a standard uncertainty, `rounding` (3,), and whether noise leaves it sharp, `coarse`."""

    step: Array
    rounding: Array
    coarse: tuple[bool, bool, bool]

    def of_swing(self, amplitude: Array) -> Array:
        """Return what is left of the rounding (3,) where the output swings by an amplitude (3,).

        The mean over a sine keeps J0(2 pi a/q) of each step's error, at most sqrt(q/a)/pi.
        """
        share = np.sqrt(self.step / np.maximum(amplitude, 1e-300)) / np.pi
        return np.asarray(self.rounding * np.minimum(share, 1.0))


@dataclass(frozen=True)
class Clipped:
    """Samples of an axis of a sensor that stand at its limit, and the records left out for it."""

    sensor: str
    axis: int
    limit: float
    count: int
    records: tuple[str, ...]


def steps_of(records: Sequence[Array], residuals: Sequence[Array]) -> Steps:
    """Return the steps of three channels from records (n, 3) and what models leave of them."""
    step, rounding, coarse = np.zeros(3), np.zeros(3), [False] * 3
    for channel in range(3):
        columns = [_finite(record[:, channel]) for record in records]
        step[channel] = step_of(columns)
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
    return Steps(step, rounding, (coarse[0], coarse[1], coarse[2]))


def step_of(columns: Sequence[Array]) -> float:
    """Return the step of a channel from its records (n,), 0 where there is none.

    A step of 1/4096 that is written with six digits is no multiple of itself: what counts is how
    far values of one record are apart, or where each stands still, those of all.
    """
    step = smallest_step(columns)
    apart = [float(np.diff(levels).min()) for c in columns if len(levels := np.unique(c)) > 1]
    if apart:
        return max(step, min(apart))
    levels = np.unique(np.concatenate(columns)) if columns else np.zeros(0)
    least = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    return step if step > SAME_STEP * least else least


def without_clipped(data: OtherAxes) -> tuple[OtherAxes, tuple[Clipped, ...]]:
    """Return the data with NaN for an axis of a record that its limit cut off, and what that was.

    A limit is a largest or smallest value that the records pile up at, as noise does not. In steps
    larger than the noise they all do: there a limit is where no axis ever reads 1 g, and several
    stop at the same value.
    """
    forces, force = _screened(ACCELEROMETER, _forces(data), data.gravity_g)
    fields, field = _screened(MAGNETOMETER, _fields(data), None)
    if not forces and not fields:
        return data, ()
    return _with(data, force, field), (*forces, *fields)


def without_stuck(data: OtherAxes) -> tuple[OtherAxes, tuple[Flag, ...]]:
    """Return the data with NaN for an axis of a record that stood still, and the flags of it.

    A record is that if it has a single value in five samples and more, where the same axis changes
    from sample to sample in others, or the other axes do where it never does.
    """
    force, stuck = _unstuck(ACCELEROMETER, _forces(data))
    field, also = _unstuck(MAGNETOMETER, _fields(data))
    flags = (*stuck, *also)
    return (_with(data, force, field) if flags else data), flags


def _unstuck(sensor: str, records: Named) -> tuple[Named, list[Flag]]:
    """Return the records without axes that stood still, and a flag for each such axis."""
    cleared, flags = dict(records), []
    for axis in range(3):
        columns = {name: _finite(samples[:, axis]) for name, samples in records.items()}
        columns = {name: own for name, own in columns.items() if len(own) >= IN_A_SHORT_RECORD}
        stuck = [name for name, own in columns.items() if float(np.ptp(own)) == 0.0]
        others = [_moving(own) for name, own in columns.items() if name not in stuck]
        others = others or [
            _moving(_finite(samples[:, other]))
            for name, samples in records.items()
            for other in range(3)
            if name in stuck and other != axis
        ]
        if not stuck or not others or float(np.median(others)) <= ALWAYS_NEW:
            continue
        for name in stuck:
            cleared[name] = cleared[name].copy()
            cleared[name][:, axis] = np.nan
        where = ", ".join(dict.fromkeys(name for name, _ in stuck))
        count = sum(len(columns[name]) for name in stuck)
        then = f"It is left out of the records of {where}."
        details = {"count": count, "sensor": sensor}
        reading, extent = f"The output of the {sensor} {AXES[axis]}", counted(count, "sample")
        flags.append(frozen(reading, extent, "the sensor", then, details, AXES[axis]))
    return cleared, flags


def _with(data: OtherAxes, force: Named, field: Named) -> OtherAxes:
    """Return the data with other samples in the place of its own."""
    rests = tuple(
        replace(
            rest,
            acceleration_g=force[rest.name, -1],
            field_nT=None if rest.field_nT is None else field[rest.name, -1],
        )
        for rest in data.rests
    )
    mountings = tuple(
        replace(
            mounting,
            records=tuple(
                replace(
                    record,
                    acceleration_g=force.get((mounting.name, n)),
                    field_nT=field.get((mounting.name, n)),
                )
                for n, record in enumerate(mounting.records)
            ),
        )
        for mounting in data.mountings
    )
    return replace(data, rests=rests, mountings=mountings)


def _forces(data: OtherAxes) -> Named:
    """Return samples (n, 3) by stand or mounting and number of the record, -1 at rest."""
    named = {(rest.name, -1): rest.acceleration_g for rest in data.rests}
    for mounting in data.mountings:
        for n, record in enumerate(mounting.records):
            if record.acceleration_g is not None:
                named[mounting.name, n] = record.acceleration_g
    return named


def _fields(data: OtherAxes) -> Named:
    named = {(rest.name, -1): rest.field_nT for rest in data.rests if rest.field_nT is not None}
    for mounting in data.mountings:
        for n, record in enumerate(mounting.records):
            if record.field_nT is not None:
                named[mounting.name, n] = record.field_nT
    return named


def _screened(sensor: str, records: Named, least: float | None) -> tuple[list[Clipped], Named]:
    """Return what was cut off, and the records without; `least` is what an axis must reach."""
    screened, clipped = dict(records), []
    for axis in range(3):
        columns = {name: samples[:, axis] for name, samples in records.items()}
        for limit in _limits(columns) or _common_limit(records, axis, least):
            at = {name: _at(values, limit) for name, values in columns.items()}
            names = [name for name, here in at.items() if here.mean() > MAX_AT_LIMIT]
            for name in names:
                screened[name] = screened[name].copy()
                screened[name][:, axis] = np.nan
            count = sum(int(here.sum()) for here in at.values())
            where = tuple(dict.fromkeys(name for name, _ in names))
            clipped.append(Clipped(sensor, axis, limit, count, where))
    return clipped, screened


def _at(values: Array, limit: float) -> Mask:
    return np.asarray(np.abs(values - limit) <= NEARLY_ALIKE * abs(limit))


def _finite(values: Array) -> Array:
    return np.asarray(values[np.isfinite(values)])


def _limits(columns: Mapping[tuple[str, int], Array]) -> list[float]:
    """Return the values that one or more records pile up at, at the ends of all of them."""
    inside = {name: own for name, values in columns.items() if len(own := _finite(values)) > 1}
    if not inside:
        return []
    every = np.concatenate(list(inside.values()))
    quiet = [own for (_, turn), own in inside.items() if turn < 0] or list(inside.values())
    # A channel that stands still in its steps piles up wherever it stands.
    noisy = float(np.median([_moving(own) for own in quiet])) > 0.5
    limits = []
    for end in (float(every.max()), float(every.min())):
        away = np.unique(np.abs(every - end))
        away = away[away > NEARLY_ALIKE * max(abs(end), 1e-300)]
        for values in inside.values() if len(away) else ():
            at = _at(values, end)
            beside = int(np.sum(np.abs(np.abs(values - end) - away[0]) <= 0.5 * away[0]))
            piled = int(at.sum()) > PILED_UP * beside + FEW
            if piled and (noisy or _moving(values[~at]) > 0.5):
                limits.append(end)
                break
    return limits


def _moving(values: Array) -> float:
    """Return the share of samples that differ from the one before."""
    return float(np.mean(np.diff(values) != 0.0)) if len(values) > 1 else 0.0


def _common_limit(records: Named, axis: int, least: float | None) -> list[float]:
    """Return the limits, either way, that no axis exceeds and several stop at, short of `least`."""
    if least is None or not records:
        return []
    every = np.vstack(list(records.values()))
    largest = np.nanmax(np.abs(every), axis=0, initial=0.0)
    limit = float(largest.max())
    half = 0.5 * step_of([_finite(every[:, axis])])
    alike = np.abs(largest - limit) <= NEARLY_ALIKE * limit
    if limit >= least - half or limit < 0.9 * least or int(alike.sum()) < 2 or not alike[axis]:
        return []
    return [end for end in (limit, -limit) if bool(_at(every[:, axis], end).any())]


def clipped_flags(clipped: Sequence[Clipped]) -> Iterator[Flag]:
    """Yield a flag for each axis that its limit cut off."""
    for cut in clipped:
        unit = UNITS[cut.sensor]
        message = (
            f"The {cut.sensor} {AXES[cut.axis]} stands at {cut.limit:.6g} {unit} in "
            f"{counted(cut.count, 'sample')}: that is its limit, and not what it felt. Its records "
            f"of {', '.join(cut.records) or 'no stand'} are left out. Choose a wider range, and "
            "measure again."
        )
        details = {"count": cut.count, "limit": cut.limit, "sensor": cut.sensor}
        yield Flag("saturated", message, AXES[cut.axis], details)


def coarse_flags(sensor: str, steps: Steps) -> Iterator[Flag]:
    """Yield a flag for each axis whose steps its noise does not blur."""
    for axis in range(3):
        if steps.coarse[axis]:
            message = (
                f"The output of the {sensor} {AXES[axis]} has steps of {steps.step[axis]:.3g} "
                f"{UNITS[sensor]}, larger than its noise: each mean may be off by "
                f"{steps.rounding[axis]:.2g} {UNITS[sensor]}, however long the record. That is "
                "in the uncertainties. Record with more digits, or in a finer range."
            )
            details = {"step": float(steps.step[axis]), "sensor": sensor}
            yield Flag("coarse-output", message, AXES[axis], details)
