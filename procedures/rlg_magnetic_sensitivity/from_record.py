"""From a run's raw rows to the dataset: counts to rates, the instruments' clocks to run time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.alignment import Alignment, align, unwrapped
from procedures.rlg_magnetic_sensitivity import one_axis
from procedures.rlg_magnetic_sensitivity.dataset import Drive, RlgDataset, Segment
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters

if TYPE_CHECKING:
    from station.bench import Bench
    from station.record.folder import RunFolder

GYRO = "gyro_acquisition"
GAUSSMETER = "gaussmeter"
LATENCY = "latency_s"
MT_PER_T = 1e3
TO_MIDDLE = {
    "interval-start": 0.5,
    "interval-middle": 0.0,
    "interval-end": -0.5,
    "on-request": -1.0,  # asked for, a reading is half an averaging old in the mean
}


def gyro_rates(
    folder: RunFolder, unit: str, parameters: RlgParameters, *, samples: int | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middle of each whole sample interval in run time (s) and its mean rate (deg/h).

    Both have shape (samples,). An interval whose count or that before it was lost is left out, and
    so is what follows the first `samples` intervals. 1 arcsec/s is 1 deg/h.
    """
    rows = folder.rows(GYRO, unit)
    number = unwrapped(rows["sequence"])
    arrival_s = rows["arrival_time_s"]
    if LATENCY in (rows.dtype.names or ()):  # the board says how long each sample was on its way
        arrival_s = arrival_s - rows[LATENCY]
    aligned = align(number, arrival_s, parameters.sample_interval_s)
    counts = np.diff(rows["counts"].astype(np.int64))
    counts = np.mod(counts + 2**31, 2**32) - 2**31  # the board's counter is 32 bits wide
    whole = np.diff(number) == 1
    if samples is not None:
        whole &= number[1:] <= samples
    rate = counts * parameters.pulse_weight_arcsec / parameters.sample_interval_s
    return aligned.run_time_s(number[1:] - 0.5)[whole], rate[whole].astype(np.float64)


def field_alignment(folder: RunFolder, unit: str) -> Alignment:
    """Return the map from the gaussmeter's clock to run time during a unit."""
    rows = folder.rows(GAUSSMETER, unit)
    return align(rows["instrument_time_s"], rows["arrival_time_s"], 1.0)


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
    not see is zero. `facts` are those of a
    unit that is not finished yet.
    """
    unit = folder.finished_units()[name] if facts is None else facts
    rows = folder.rows(GAUSSMETER, name)
    averaging_s = float(unit["field_averaging_s"])
    shift_s = TO_MIDDLE[unit["field_timestamp"]] * averaging_s
    field_mT = one_axis.components_T(rows) * MT_PER_T
    unseen = one_axis.unseen(field_mT)
    calibration = bench.instruments[GAUSSMETER].calibration
    if calibration is not None:
        field_mT = calibration.corrected("field", field_mT, "mT")
    field_mT[:, unseen] = 0.0
    usable = rows["state"] == 0
    time_s, rate_deg_per_h = gyro_rates(folder, name, parameters, samples=unit["samples"])
    quantum = parameters.pulse_weight_arcsec / parameters.sample_interval_s
    field_time_s = field_alignment(folder, name).run_time_s(rows["instrument_time_s"]) + shift_s
    return Segment(
        drive={
            axis: Drive(float(sine["frequency_Hz"]), float(sine["amplitude_mT"]))
            for axis, sine in unit["drive"].items()
        },
        sample_interval_s=parameters.sample_interval_s,
        time_s=time_s,
        rate_deg_per_h=rate_deg_per_h,
        quantum_deg_per_h=quantum,
        field_time_s=field_time_s[usable],
        field_mT=field_mT[usable],
        field_averaging_s=averaging_s,
    )


def dataset_of_run(
    folder: RunFolder, units: Iterable[str], parameters: RlgParameters, bench: Bench
) -> RlgDataset:
    """Return the finished ones of some units of a run as a dataset."""
    finished = folder.finished_units()
    segments = [
        segment_of_unit(folder, unit, parameters, bench) for unit in units if unit in finished
    ]
    return RlgDataset(tuple(segments))
