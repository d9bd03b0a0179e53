"""Run folders of a made-up laser gyro, written block by block as a run writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from procedures.rlg_magnetic_sensitivity.records import PlannedRecord, sensitivity_records
from station.clock import VirtualClock
from station.files.plan import Plan
from station.instruments.bench import Bench
from station.record.folder import RunRecord
from station.runner.execute import head_of

GYRO, GAUSSMETER = "gyro_acquisition", "gaussmeter"
LOOK_S = 1.037
FIELD_S = 0.1
SENSITIVITY = {"IA": 0.05, "NA": -0.02, "LA": 0.001}
AMBIENT_T = np.array([0.021e-3, -0.004e-3, -0.043e-3])
WALK_DEG_PER_SQRT_H = 1e-3
EARTH_DEG_PER_H = 9.6
SPIKE_COUNTS = 500
FIELD_COLUMNS = ("instrument_time_s", "x_T", "y_T", "z_T", "state")
GYRO_ROW = [
    ("sequence", "u2"),
    ("counts", "i8"),
    ("temperature_degC", "f8"),
    ("arrival_time_s", "f8"),
]


def made_run(
    parent: Path, plan: Plan, bench: Bench, *, spikes: float = 1e-5, lost: float = 0.0
) -> Path:
    """Write a run folder with every record of the plan, and return it.

    `spikes` and `lost` are the parts of the samples that are wild or missing.
    """
    clock = VirtualClock()
    record = RunRecord(parent, plan.procedure, "SN-1", clock, head_of(plan, bench, clock))
    for name in (GYRO, GAUSSMETER):
        record.event("identified", instrument=name, maker="", model="", serial="", firmware="")
    began_s = 700.0
    for planned in sensitivity_records(plan.parameters):
        made_record(record, plan.parameters, planned, began_s, spikes, lost)
        record.finish_unit(
            planned.unit,
            drive={axis: vars(sine) for axis, sine in planned.drive.items()},
            field_averaging_s=FIELD_S,
            field_timestamp="interval-end",
            samples=planned.samples,
        )
        began_s += planned.samples * plan.parameters.sample_interval_s + 60.0
    record.event("safe-state", outcomes=[])
    record.close()
    record.seal()
    return record.path


def made_record(
    record: RunRecord,
    parameters: Any,
    planned: PlannedRecord,
    began_s: float,
    spikes: float,
    lost: float,
) -> None:
    """Write the rows of one record, a block at each look."""
    generator = np.random.default_rng([round(began_s), 15])
    interval_s, weight = parameters.sample_interval_s, parameters.pulse_weight_arcsec
    noise = 60.0 * WALK_DEG_PER_SQRT_H / np.sqrt(interval_s)
    slopes = 1e3 * np.array(list(SENSITIVITY.values()))
    end_s = began_s + planned.samples * interval_s
    angle = 0.0
    first, first_field, now_s = 0, 0, began_s
    while now_s < end_s + 2 * LOOK_S:
        now_s += LOOK_S
        last = int((now_s - began_s) / interval_s)
        count = last - first
        time_s = began_s + (np.arange(first, last) + 0.5) * interval_s
        rate = EARTH_DEG_PER_H + field_T(planned, time_s, began_s) @ slopes
        rate += noise * generator.standard_normal(count)
        angles = angle + np.cumsum(rate * interval_s)
        for place in np.flatnonzero(generator.random(count) < spikes):
            angles[place:] += SPIKE_COUNTS * weight
        angle = float(angles[-1])
        rows = np.empty(count, GYRO_ROW)
        rows["sequence"] = np.arange(first + 1, last + 1) % 65536
        rows["counts"] = np.floor(angles / weight)
        rows["temperature_degC"] = 25.0
        late_s = 0.002 + 0.004 * generator.random(count)
        rows["arrival_time_s"] = np.minimum(time_s + 0.5 * interval_s + late_s, now_s)
        there = rows[generator.random(count) >= lost]
        record.block(GYRO, planned.unit, {name: "1" for name, _ in GYRO_ROW[:-1]}, there)
        last_field = int((now_s - began_s) / FIELD_S)
        stamp_s = began_s + np.arange(first_field + 1, last_field + 1) * FIELD_S
        measured_T = field_T(planned, stamp_s - 0.5 * FIELD_S, began_s, FIELD_S)
        measured_T += 4e-7 * generator.standard_normal(measured_T.shape)
        rows = np.zeros(len(stamp_s), [(name, "f8") for name in (*FIELD_COLUMNS, "arrival_time_s")])
        rows["instrument_time_s"] = stamp_s * (1 + 12e-6) + 0.37
        rows["x_T"], rows["y_T"], rows["z_T"] = measured_T.T
        rows["arrival_time_s"] = now_s + 0.002
        record.block(GAUSSMETER, planned.unit, dict.fromkeys(FIELD_COLUMNS, "1"), rows)
        first, first_field = last, last_field


def field_T(planned: PlannedRecord, time_s: Any, began_s: float, averaging_s: float = 0.0) -> Any:
    """Return the field on IA, NA, LA, shape (n, 3)."""
    field = np.tile(AMBIENT_T, (len(time_s), 1))
    for k, axis in enumerate(SENSITIVITY):
        if axis in planned.drive:
            sine = planned.drive[axis]
            size_T = 1e-3 * sine.amplitude_mT * np.sinc(sine.frequency_Hz * averaging_s)
            field[:, k] += size_T * np.sin(2 * np.pi * sine.frequency_Hz * (time_s - began_s))
    return field
