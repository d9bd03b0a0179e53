"""Records of gyros at rest: what the analysis needs, from a folder or from a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator

from procedures.common.conditions import OfGyros, OfRateOrCounts
from procedures.common.gyro_source import GYRO, NAVIGATOR
from procedures.estimation.direction import Direction
from procedures.estimation.gyro_outputs import outputs_of
from station.dataset_checks import switch_ons
from station.dataset_reading import Table
from station.fields import InputAxis, Unit
from station.findings import FlagThresholds

from .parameters import UNITS, StaticParameters

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

PER_SQRT_H = 60.0
"""deg/h sqrt(s) over deg/sqrt(h), and deg/h/sqrt(h) over deg/h/sqrt(s)."""

COEFFICIENTS = tuple(UNITS)[:4]


@dataclass(frozen=True)
class Record:
    """One switch-on, warm-up left out: `time_s` (n,) the middle of each interval, gaps possible.

    Times count from power-on; `on_s` is when that was on the run's clock, None where nobody knows.
    `rate_deg_per_h` (n, axes) is the mean over the interval, earth's rate in it.
    """

    switch_on: int
    time_s: Array
    rate_deg_per_h: Array
    on_s: float | None = None


@dataclass(frozen=True)
class StaticDataset:
    """A gyro or a triad at rest.

    `pulse_arcsec` is 0 where the output is no counts; samples of an output with a bandwidth are
    not independent up to the highest frequency. `latitude_rad` is north positive. A navigator takes
    the earth's rate out itself: `earth_in_output` says whether it is in the rates.
    """

    directions: Mapping[str, Direction]
    latitude_rad: float
    sample_interval_s: float
    pulse_arcsec: float
    output_bandwidth_Hz: float | None
    records: tuple[Record, ...]
    earth_in_output: bool = True

    @property
    def quantum_deg_per_h(self) -> float:
        """One pulse as a rate."""
        return self.pulse_arcsec / self.sample_interval_s

    def earth_deg_per_h(self, axis: str) -> float:
        """Return the earth's rate in the output of an axis."""
        if not self.earth_in_output:
            return 0.0
        return self.directions[axis].earth_deg_per_h(self.latitude_rad)


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags, in standard uncertainties unless the name says otherwise.

    `periodic_chance`: a line must lower -2 ln L by 2 ln(n/periodic_chance).
    """

    drift_removed: float = 3.0
    periodic_chance: float = 1e-4


TO_MIDDLE = {"interval-start": 0.5, "interval-middle": 0.0, "interval-end": -0.5}
OUTPUTS = {"counts": "counts", "rate": "rate_deg_per_h"}


class Conditions(OfGyros, OfRateOrCounts):
    """The conditions of a record of gyros at rest; what decides a sign has no default."""

    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0)]
    timestamp: Literal["interval-start", "interval-middle", "interval-end"]
    output_bandwidth_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = None
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0)] = 0.0

    @field_validator("input_axis")
    @classmethod
    def counts_of_one(cls, value: dict[str, InputAxis], info: ValidationInfo) -> object:
        """Require IA where the output is counts."""
        if "IA" not in value and info.data.get("gyro_output") == "counts":
            raise ValueError("an output in counts has the input axis IA")
        return value


def dataset_of_import(raw: RawDataset) -> tuple[StaticDataset, Conditions]:
    """Return the records of an imported folder; FaultList names file, row and reason."""
    conditions = raw.conditions(Conditions)
    raw.require_files(("samples",))
    columns = [f"g{axis.lower()}_deg_per_h" for axis in conditions.input_axis]
    if "IA" in conditions.input_axis:
        columns = [OUTPUTS[conditions.gyro_output]]
    table = raw.read_table("samples", ("switch_on", "t_s", *columns))
    counts = conditions.gyro_output == "counts"
    pulse = (conditions.pulse_weight_arcsec or 0.0) if counts else 0.0
    scale = pulse / conditions.sample_interval_s if counts else 1.0
    dataset = StaticDataset(
        directions={
            name: Direction(np.deg2rad(direction.azimuth_deg), np.deg2rad(direction.elevation_deg))
            for name, direction in conditions.input_axis.items()
        },
        latitude_rad=float(np.deg2rad(conditions.latitude_deg)),
        sample_interval_s=conditions.sample_interval_s,
        pulse_arcsec=pulse,
        output_bandwidth_Hz=conditions.output_bandwidth_Hz,
        records=tuple(_records(table, columns, scale, conditions)),
    )
    return dataset, conditions


def _records(
    table: Table, columns: list[str], scale: float, conditions: Conditions
) -> Iterator[Record]:
    number, time_s = table["switch_on"], table["t_s"]
    begins = switch_ons(table, "switch_on", conditions.sample_interval_s)
    rate = np.column_stack([table[column] for column in columns]) * scale
    middle_s = time_s + TO_MIDDLE[conditions.timestamp] * conditions.sample_interval_s
    for start, stop in zip(begins, [*begins[1:], len(number)], strict=True):
        warm = start + np.flatnonzero(middle_s[start:stop] >= conditions.warm_up_s)
        if len(warm):
            yield Record(int(number[start]), middle_s[warm], rate[warm])


def dataset_of_run(folder: RunFolder, parameters: StaticParameters, bench: Bench) -> StaticDataset:
    """Return the finished switch-ons of a run, times from when each was switched on.

    The board's scale is corrected by its record. Of a navigator each switch-on shows one axis, the
    others are NaN.
    """
    pulse = parameters.pulse_weight_arcsec or 0.0
    if parameters.source == GYRO:
        pulse *= float(bench.corrected(GYRO, "scale", 1.0, "1"))
    records, axes = [], list(parameters.input_axis)
    for unit, details in folder.finished_units().items():
        rows = folder.rows(parameters.source, unit)
        outputs = outputs_of(rows, parameters.sample_interval_s, axes, pulse)
        on_s = float(details["on_s"])
        time_s, rate = outputs.before_end_s(0.5) - on_s, outputs.rate_deg_per_h
        if len(parameters.mountings) > 1:
            upright = [axis == details["axis"] for axis in axes]
            rate = np.where(upright, rate, np.nan)
        records.append(Record(int(details["switch_on"]), time_s, rate, on_s))
    return StaticDataset(
        directions={
            axis: Direction(np.deg2rad(direction.azimuth_deg), np.deg2rad(direction.elevation_deg))
            for axis, direction in parameters.input_axis.items()
        },
        latitude_rad=float(np.deg2rad(parameters.latitude_deg)),
        sample_interval_s=parameters.sample_interval_s,
        pulse_arcsec=pulse,
        output_bandwidth_Hz=None,
        records=tuple(records),
        earth_in_output=parameters.source != NAVIGATOR,
    )
