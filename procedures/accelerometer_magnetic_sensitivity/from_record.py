"""From a run's raw rows to the dataset: one row for each finished point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from procedures.accelerometer_magnetic_sensitivity.check import (
    GAUSSMETER,
    MULTIMETER,
    STAGE,
    THERMOMETER,
)
from procedures.accelerometer_magnetic_sensitivity.dataset import AccelerometerDataset
from procedures.accelerometer_magnetic_sensitivity.measuring import (
    AXIS_COLUMN,
    T_PER_MT,
    finished_points,
)
from procedures.accelerometer_magnetic_sensitivity.parameters import AccelerometerParameters, Point

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

ARRIVAL = "arrival_time_s"


def dataset_of_run(
    folder: RunFolder, parameters: AccelerometerParameters, bench: Bench
) -> AccelerometerDataset:
    """Return all finished points of a run, in the order in which they were measured.

    Output and field of a point are means over its burst; the calibration corrections of the bench
    file are applied to all that was read. Readings that say overload are left out where a higher
    range gave others; a point without a valid field has NaN there, which the analysis rejects and
    lists.
    """
    units = folder.finished_units()
    points = finished_points(units, parameters.points)
    rows = [row_of_point(folder, point, parameters, bench) for point in points]
    time_s, angle_deg, field_T, output_V, temperature_degC = np.array(rows).reshape(-1, 5).T
    order = np.argsort(time_s, kind="stable")
    ranges = np.array([range_of(folder, point.unit) for point in points])
    _, group = np.unique(ranges, return_inverse=True)

    def commanded(name: str) -> np.ndarray:
        return np.array([getattr(point, name) for point in points])[order]

    return AccelerometerDataset(
        time_s=time_s[order],
        plane=commanded("plane"),
        theta_deg=angle_deg[order],
        theta_commanded_deg=commanded("angle_deg"),
        field_T=field_T[order],
        field_commanded_T=commanded("field_mT") * T_PER_MT,
        output_V=output_V[order],
        temperature_degC=temperature_degC[order] if parameters.temperature else None,
        noise_group=group[order],
    )


def row_of_point(
    folder: RunFolder, point: Point, parameters: AccelerometerParameters, bench: Bench
) -> tuple[float, float, float, float, float]:
    """Return a point's time (s), angle (deg), field (T), output (V) and temperature (degC)."""
    meter = folder.rows(MULTIMETER, point.unit)
    good = meter["overload"] == 0
    usable = meter[good] if good.any() else meter
    field = folder.rows(GAUSSMETER, point.unit)
    valid = field[AXIS_COLUMN][field["state"] == 0]
    field_T = float(valid.mean()) if valid.size else np.nan
    output_V = float(usable["voltage_V"].mean())
    field_T = bench.corrected(GAUSSMETER, "field", field_T / T_PER_MT, "mT") * T_PER_MT
    output_V = bench.corrected(MULTIMETER, "voltage", output_V, "V")
    temperature_degC = np.nan
    if parameters.temperature:
        read_degC = float(folder.rows(THERMOMETER, point.unit)["temperature_degC"].mean())
        temperature_degC = bench.corrected(THERMOMETER, "temperature", read_degC, "degC")
    read_deg = float(folder.rows(STAGE, point.unit)["angle_deg"][-1])
    angle_deg = bench.corrected(STAGE, "angle", read_deg, "deg")
    return float(meter[ARRIVAL].mean()), angle_deg, field_T, output_V, temperature_degC


def range_of(folder: RunFolder, unit: str) -> float:
    """Return the voltmeter's range in V in which a point was measured in the end."""
    wider = [
        float(event.details["next_range_V"])
        for event in folder.events_of("overload")
        if event.details["unit"] == unit
    ]
    return wider[-1] if wider else float(folder.finished_units()[unit]["range_V"])


def overloaded_readings(folder: RunFolder, units: Sequence[str]) -> int:
    """Return how many readings of the voltmeter in these units were overloads."""
    return sum(int((folder.rows(MULTIMETER, unit)["overload"] != 0).sum()) for unit in units)
