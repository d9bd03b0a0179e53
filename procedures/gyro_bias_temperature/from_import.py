"""From an imported dataset folder to the dataset of the analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from procedures.common.conditions import OfGyros
from procedures.estimation.direction import Direction
from station.dataset_checks import CLOSE
from station.dataset_reading import Table, refuse
from station.fields import Unit

from .dataset import TemperatureDataset

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

TO_MIDDLE = {"interval-start": 0.5, "interval-middle": 0.0, "interval-end": -0.5}
PHASES = ("soak", "ramp")
OWN = "gyro_temperature_degC"
COLUMNS = ("t_s", "phase", "set_point_degC", "chamber_temperature_degC")
FEWEST_ROWS = 60


class Conditions(OfGyros):
    """The conditions of a record over temperature; what decides a sign has no default."""

    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0)]
    timestamp: Literal["interval-start", "interval-middle", "interval-end"]
    reference_temperature_degC: Annotated[float, Unit("degC")] = 20.0
    sensor_lag_prior_s: Annotated[float, Unit("s"), Field(ge=0)] = 300.0
    thermometer_uncertainty_degC: Annotated[float, Unit("degC", True), Field(ge=0)] = 0.0


def dataset_of_import(raw: RawDataset) -> tuple[TemperatureDataset, Conditions]:
    """Return the record of an imported folder; FaultList names file, row and reason."""
    conditions = raw.conditions(Conditions)
    raw.require_files(("samples",))
    rates = [f"g{axis.lower()}_deg_per_h" for axis in conditions.input_axis]
    if "IA" in conditions.input_axis:
        rates = ["rate_deg_per_h"]
    table = raw.read_table("samples", (*COLUMNS, *rates), (OWN,), text=("phase",), rising="t_s")
    _check(table, conditions.sample_interval_s)
    own = table.get(OWN)
    dataset = TemperatureDataset(
        directions={
            name: Direction(np.deg2rad(direction.azimuth_deg), np.deg2rad(direction.elevation_deg))
            for name, direction in conditions.input_axis.items()
        },
        latitude_rad=float(np.deg2rad(conditions.latitude_deg)),
        sample_interval_s=conditions.sample_interval_s,
        reference_degC=conditions.reference_temperature_degC,
        sensor_lag_prior_s=conditions.sensor_lag_prior_s,
        time_s=table["t_s"] + TO_MIDDLE[conditions.timestamp] * conditions.sample_interval_s,
        soaking=table["phase"] == "soak",
        set_point_degC=table["set_point_degC"],
        rate_deg_per_h=np.column_stack([table[name] for name in rates]),
        gyro_degC=own,
        chamber_degC=table["chamber_temperature_degC"],
    )
    return dataset, conditions


def _check(table: Table, interval_s: float) -> None:
    """Raise FaultList for unknown phases, too few rows, and rows that are not an interval apart."""
    faults = [
        table.fault(row, "phase", f"{word!r} is no phase; write {' or '.join(PHASES)}")
        for row, word in enumerate(table["phase"].tolist())
        if word not in PHASES
    ]
    if len(table["t_s"]) < FEWEST_ROWS:
        what = f"there are {len(table['t_s'])} rows; an analysis needs {FEWEST_ROWS}"
        faults.append(table.fault(0, "t_s", what))
    else:
        usual = float(np.median(np.diff(table["t_s"])))
        if abs(usual - interval_s) > CLOSE * interval_s:
            what = f"rows are {usual:.4g} s apart, the sample interval is {interval_s:g} s"
            faults.append(table.fault(1, "t_s", what))
    refuse(faults[:20])
