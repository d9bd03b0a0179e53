"""What the analysis of a gyro's bias over temperature needs, and how it is read from a folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from procedures.common.conditions import OfGyros
from procedures.estimation.direction import Direction
from station.dataset_checks import CLOSE
from station.dataset_reading import Table, refuse
from station.fields import Unit
from station.findings import FlagThresholds

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class TemperatureDataset:
    """A gyro or a triad at rest in a chamber, one switch-on, a row an interval; gaps are possible.

    `time_s` (n,) rises and is the middle of each interval. `rate_deg_per_h` (n, axes) holds the
    earth's rate, `gyro_degC` (n,) is the gyro's own thermometer, None without one; `soaking` says
    that the set-point stands. `sensor_lag_prior_s` is the standard uncertainty of how far the
    thermometer runs ahead of what the bias follows.
    """

    directions: Mapping[str, Direction]
    latitude_rad: float
    sample_interval_s: float
    reference_degC: float
    sensor_lag_prior_s: float
    time_s: Array
    soaking: Mask
    set_point_degC: Array
    rate_deg_per_h: Array
    gyro_degC: Array | None
    chamber_degC: Array

    @property
    def temperature_degC(self) -> Array:
        """The temperature that the model follows: the gyro's own, else the chamber's."""
        return self.chamber_degC if self.gyro_degC is None else self.gyro_degC


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags, in standard uncertainties unless the name says otherwise."""


AT_THE_END_S = 1800.0
PART = 0.5
"""Of a soak that is shorter than twice that time."""


@dataclass(frozen=True)
class Soak:
    """The end of a soak: `rows` of the record, the mean temperature there in degC."""

    rows: slice
    temperature_degC: float


def soaks_of(dataset: TemperatureDataset, temperature: Array) -> tuple[Soak, ...]:
    """Return the end of each soak; `temperature` (n,) is that of the rows."""
    moved = np.diff(dataset.set_point_degC, prepend=np.nan) != 0.0
    changed = moved | (np.diff(dataset.soaking.astype(float), prepend=np.nan) != 0.0)
    begins = np.flatnonzero(changed)
    longest = max(1, round(AT_THE_END_S / dataset.sample_interval_s))
    soaks = []
    for start, stop in zip(begins.tolist(), [*begins[1:].tolist(), len(temperature)], strict=True):
        if dataset.soaking[start]:
            rows = slice(stop - min(longest, max(1, int(PART * (stop - start)))), stop)
            soaks.append(Soak(rows, float(np.mean(temperature[rows]))))
    return tuple(soaks)


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
