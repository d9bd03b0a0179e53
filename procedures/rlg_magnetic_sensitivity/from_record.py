"""From a run's raw rows to the dataset: counts to rates, the instruments' clocks to run time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.common.helmholtz import carried
from procedures.common.homogeneity import at_device
from procedures.estimation.alignment import Alignment, align_pieces, unwrapped
from procedures.estimation.pulses import pulses_of

from . import coils
from .averaged import GyroMeans, averaged, averaged_duration_s, averaged_field, averaged_gyro
from .dataset import Array, Mask, RlgDataset, Segment
from .frequencies import Drive, group_size
from .parameters import RlgParameters
from .records import GAUSSMETER, GYRO

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


LATENCY = "latency_s"
MT_PER_T = 1e3
TO_MIDDLE = {
    "interval-start": 0.5,
    "interval-middle": 0.0,
    "interval-end": -0.5,
    "on-request": -1.0,  # asked for, a reading is half an averaging old in the mean
}


@dataclass(frozen=True)
class GyroRecord:
    """The gyro's output of a unit: middles of intervals in run time (n,), mean rates (n,).

    The intervals are the board's, or `group` of them each; `means` then says what was averaged.
    """

    time_s: Array
    rate_deg_per_h: Array
    interval_s: float
    group: int
    means: GyroMeans | None


def gyro_record(
    folder: RunFolder,
    unit: str,
    parameters: RlgParameters,
    bench: Bench,
    *,
    samples: int | None = None,
    drive: Mapping[str, Drive] | None = None,
) -> GyroRecord:
    """Return each whole sample interval of a unit, or the means over groups of a long record's.

    An interval whose count or that before it was lost is left out, and so is what follows the first
    `samples` intervals. The board's scale is corrected by its record. 1 arcsec/s is 1 deg/h.
    """
    pulse_arcsec = parameters.pulse_weight_arcsec * bench.corrected(GYRO, "scale", 1.0, "1")
    drive, interval_s = drive or {}, parameters.sample_interval_s
    counted = 0

    def arrivals() -> Iterator[tuple[Array, Array]]:
        nonlocal counted
        for number, _, rows in numbered(folder, unit):
            arrival_s = rows["arrival_time_s"]
            if LATENCY in (rows.dtype.names or ()):  # how long each sample was on its way
                arrival_s = arrival_s - rows[LATENCY]
            whole = np.diff(number) == 1
            counted += int((whole if samples is None else whole & (number[1:] <= samples)).sum())
            yield number[-len(rows) :], arrival_s

    aligned = align_pieces(arrivals(), interval_s)

    def rates() -> Iterator[tuple[Array, Array]]:
        for number, counts, _ in numbered(folder, unit):
            pulses = pulses_of(counts)
            whole = np.diff(number) == 1
            if samples is not None:
                whole &= number[1:] <= samples
            rate = pulses * pulse_arcsec / interval_s
            yield number[1:][whole], rate[whole].astype(np.float64)

    highest_Hz = max((driven.frequency_Hz for driven in drive.values()), default=0.0)
    group = group_size(counted, interval_s, highest_Hz)
    if group == 1:
        number, rate = (np.concatenate(parts) for parts in zip(*rates(), strict=True))
        return GyroRecord(aligned.run_time_s(number - 0.5), rate, interval_s, 1, None)
    places = ((number.astype(np.int64) - 1, rate) for number, rate in rates())
    quantum = pulse_arcsec / interval_s
    means = averaged_gyro(places, counted, group, interval_s, quantum, drive)
    time_s = aligned.run_time_s(means.place + 0.5)
    return GyroRecord(time_s, means.rate_deg_per_h, group * interval_s, group, means)


def numbered(
    folder: RunFolder, unit: str
) -> Iterator[tuple[Array, NDArray[np.int64], NDArray[Any]]]:
    """Yield a unit's rows in pieces with their running numbers and counts.

    From the second piece on, number and count of the row before come first.
    """
    before: NDArray[Any] | None = None
    last = 0.0
    for rows in folder.pieces(GYRO, unit):
        joined = rows if before is None else np.concatenate((before, rows))
        number = unwrapped(joined["sequence"]) + last
        yield number, joined["counts"].astype(np.int64), rows
        before, last = rows[-1:], float(number[-1])


@dataclass(frozen=True)
class FieldRecord:
    """What is known of a unit's field record before its values are: its clock, what is missing.

    `readings` is their number, `step_s` the usual time between two of them, `overloaded` how many
    were; `unseen` (3,) marks the components that the gaussmeter never saw.
    """

    aligned: Alignment
    readings: int
    step_s: float
    overloaded: int
    unseen: Mask


def field_record(folder: RunFolder, unit: str) -> FieldRecord:
    """Return what is known of a unit's field record; it is gone through once."""
    return folder.once(("field", unit), lambda: look_through_field(folder, unit))


def look_through_field(folder: RunFolder, unit: str) -> FieldRecord:
    """Go through a unit's field record."""
    readings = overloaded = 0
    step_s: float | None = None
    unseen = np.ones(3, dtype=bool)

    def arrivals() -> Iterator[tuple[Array, Array]]:
        nonlocal readings, overloaded, step_s, unseen
        for rows in folder.pieces(GAUSSMETER, unit):
            time_s = rows["instrument_time_s"]
            if step_s is None and len(rows) > 1:
                step_s = float(np.median(np.diff(time_s)))
            readings += len(rows)
            overloaded += int((rows["state"] != 0).sum())
            unseen &= coils.unseen(coils.components_T(rows))
            yield time_s, rows["arrival_time_s"]

    aligned = align_pieces(arrivals(), 1.0)
    return FieldRecord(aligned, readings, step_s or 1.0, overloaded, unseen)


def segment_of_unit(
    folder: RunFolder,
    name: str,
    parameters: RlgParameters,
    bench: Bench,
    facts: Mapping[str, Any] | None = None,
) -> Segment:
    """Return the record of a unit, in run time and on the gyro's axes.

    The probe's x, y, z stand along the coils' normals, which S1 makes parallel to IA, NA, LA. The
    gaussmeter's calibration corrections of the bench file are applied here; a component that it did
    not see is zero. Where the bench states its coils' geometry, the field is that at the gyro.
    `facts` are those of a unit that is not finished yet. A record that is too long
    for the memory is averaged.
    """
    unit = folder.finished_units()[name] if facts is None else facts
    averaging_s = float(unit["field_averaging_s"])
    shift_s = TO_MIDDLE[unit["field_timestamp"]] * averaging_s
    drive = {
        axis: Drive(float(sine["frequency_Hz"]), float(sine["amplitude_mT"]))
        for axis, sine in unit["drive"].items()
    }
    known, gyro_place = field_record(folder, name), at_device(bench, "three_axis")

    def readings() -> Iterator[tuple[Array, Array]]:
        for rows in folder.pieces(GAUSSMETER, name):
            field_mT = coils.components_T(rows) * MT_PER_T
            field_mT = bench.corrected(GAUSSMETER, "field", field_mT, "mT")
            field_mT[:, known.unseen] = 0.0
            if gyro_place is not None:
                field_mT = carried(field_mT, gyro_place.matrix)
            usable = rows["state"] == 0
            time_s = known.aligned.run_time_s(rows["instrument_time_s"]) + shift_s
            yield time_s[usable], field_mT[usable]

    highest_Hz = max((driven.frequency_Hz for driven in drive.values()), default=0.0)
    field_group = group_size(known.readings, known.step_s, highest_Hz)
    rejected = 0
    if field_group == 1:
        field_time_s, field_mT = (np.concatenate(parts) for parts in zip(*readings(), strict=True))
    else:
        whole = ((t[fit], b[fit]) for t, b in readings() for fit in [np.isfinite(b).all(axis=1)])
        field_time_s, field_mT, rejected = averaged_field(whole, field_group, known.step_s, drive)
        averaging_s = averaged_duration_s(averaging_s, known.step_s, field_group)
    gyro = gyro_record(folder, name, parameters, bench, samples=unit["samples"], drive=drive)
    return Segment(
        drive=drive,
        sample_interval_s=gyro.interval_s,
        time_s=gyro.time_s,
        rate_deg_per_h=gyro.rate_deg_per_h,
        quantum_deg_per_h=parameters.pulse_weight_arcsec / gyro.interval_s,
        field_time_s=field_time_s,
        field_mT=field_mT,
        field_averaging_s=averaging_s,
        averaged=None if gyro.means is None else averaged(gyro.means, gyro.group, rejected),
    )


def dataset_of_run(
    folder: RunFolder, units: Iterable[str], parameters: RlgParameters, bench: Bench
) -> RlgDataset:
    """Return the finished ones of some units of a run as a dataset."""
    finished = folder.finished_units()
    segments = [
        segment_of_unit(folder, unit, parameters, bench) for unit in units if unit in finished
    ]
    return RlgDataset(tuple(segments), at_device(bench, "three_axis"))
