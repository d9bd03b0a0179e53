"""From a run's raw rows to the dataset: pulses to rates, the board's clock to run time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from procedures.estimation.alignment import align, unwrapped
from procedures.estimation.direction import Direction
from procedures.estimation.pulses import pulses_of

from .dataset import Record, StaticDataset
from .parameters import StaticParameters
from .steps import GYRO

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def dataset_of_run(folder: RunFolder, parameters: StaticParameters, bench: Bench) -> StaticDataset:
    """Return the finished switch-ons of a run, times from when each was switched on.

    An interval whose count or that before it was lost is left out. The board's scale is corrected
    by its record.
    """
    pulse = parameters.pulse_weight_arcsec * float(bench.corrected(GYRO, "scale", 1.0, "1"))
    interval_s = parameters.sample_interval_s
    records = []
    for unit, details in folder.finished_units().items():
        rows = folder.rows(GYRO, unit)
        number = unwrapped(rows["sequence"])
        pulses = pulses_of(rows["counts"])
        whole = np.diff(number) == 1
        middle_s = align(number, rows["arrival_time_s"], interval_s).run_time_s(number[1:] - 0.5)
        rate = pulses * pulse / interval_s
        on_s = float(details["on_s"])
        time_s, own = middle_s[whole] - on_s, rate[whole][:, None]
        records.append(Record(int(details["switch_on"]), time_s, own, on_s))
    return StaticDataset(
        directions={
            axis: Direction(np.deg2rad(direction.azimuth_deg), np.deg2rad(direction.elevation_deg))
            for axis, direction in parameters.input_axis.items()
        },
        latitude_rad=float(np.deg2rad(parameters.latitude_deg)),
        sample_interval_s=interval_s,
        pulse_arcsec=pulse,
        output_bandwidth_Hz=None,
        records=tuple(records),
    )
