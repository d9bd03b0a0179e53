"""What the analysis of a gyro's bias over temperature needs, and how it is read from a folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from procedures.common.conditions import OfGyros, OverDevice
from procedures.common.gyro_source import GYRO
from procedures.common.places import AtPlaces, at_places, corrected_by, recorded_rows
from procedures.estimation.alignment import align, unwrapped
from procedures.estimation.channel import still
from procedures.estimation.direction import Direction
from procedures.estimation.pulses import pulses_of
from station.dataset_checks import CLOSE
from station.dataset_reading import Table, refuse
from station.fields import InputAxis, Unit
from station.findings import FlagThresholds

from .parameters import RAMP, SOAK, BiasTemperatureParameters
from .steps import CHAMBER

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class TemperatureDataset:
    """A gyro or a triad at rest in a chamber, a row an interval; gaps are possible.

    `time_s` (n,) rises and is the middle of each interval. `rate_deg_per_h` (n, axes) holds the
    earth's rate, `gyro_degC` (n,) is the gyro's own thermometer, None without one; `soaking` says
    that the set-point stands. `switch_on` (n,) counts the switch-ons of a run that was resumed,
    None where there is one only. `sensor_lag_prior_s` is the standard uncertainty of how far the
    thermometer runs ahead of what the bias follows. `places` has what a thermometer with places
    read at the end of each soak, none where there was none.
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
    switch_on: Index | None = None
    places: tuple[AtPlaces, ...] = ()

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
PHASES = (SOAK, RAMP)
OWN = "gyro_temperature_degC"
COLUMNS = ("t_s", "phase", "set_point_degC", "chamber_temperature_degC")
FEWEST_ROWS = 60


class Conditions(OverDevice, OfGyros):
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
        directions=directions_of(conditions.input_axis),
        latitude_rad=float(np.deg2rad(conditions.latitude_deg)),
        sample_interval_s=conditions.sample_interval_s,
        reference_degC=conditions.reference_temperature_degC,
        sensor_lag_prior_s=conditions.sensor_lag_prior_s,
        time_s=table["t_s"] + TO_MIDDLE[conditions.timestamp] * conditions.sample_interval_s,
        soaking=table["phase"] == SOAK,
        set_point_degC=table["set_point_degC"],
        rate_deg_per_h=np.column_stack([table[name] for name in rates]),
        gyro_degC=own,
        chamber_degC=table["chamber_temperature_degC"],
    )
    return dataset, conditions


def directions_of(axes: Mapping[Any, InputAxis]) -> dict[str, Direction]:
    """Return where the input axes point, by their names."""
    return {
        name: Direction(np.deg2rad(axis.azimuth_deg), np.deg2rad(axis.elevation_deg))
        for name, axis in axes.items()
    }


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


FILLED = 0.9
"""Part of a row's samples that it must have."""


@dataclass(frozen=True)
class Samples:
    """Samples (n,) of one switch-on: `time_s` the middle of each, `leg` its unit's number."""

    switch_on: int
    time_s: Array
    rate_deg_per_h: Array
    gyro_degC: Array
    leg: Index


def dataset_of_run(
    folder: RunFolder, parameters: BiasTemperatureParameters, bench: Bench
) -> TemperatureDataset:
    """Return the finished ramps and soaks of a run as rows, means of the board's samples.

    An interval whose count or that before it was lost is left out; a row of which a tenth is
    missing is none. The set-point of a soak is the commanded one, on a ramp as it was read back.
    """
    units = folder.finished_units()
    if not units:
        none = np.empty(0)
        return _dataset(parameters, none, none > 0.0, none, none, none, none, none.astype(np.int64))
    pulse = parameters.pulse_weight_arcsec * float(bench.corrected(GYRO, "scale", 1.0, "1"))
    samples = list(_samples(folder, pulse, parameters.sample_interval_s))
    time_s = np.concatenate([of_one.time_s for of_one in samples])
    leg = np.concatenate([of_one.leg for of_one in samples])
    number = np.concatenate([np.full(len(s.time_s), s.switch_on) for s in samples])
    row_s, begin_s = parameters.row_interval_s, time_s[0] - 0.5 * parameters.sample_interval_s
    row = ((time_s - begin_s) / row_s).astype(np.int64)
    counts = np.bincount(row)
    full = counts >= FILLED * row_s / parameters.sample_interval_s
    middle_s = (begin_s + row_s * (np.arange(len(counts)) + 0.5))[full]

    def means(name: str) -> Array:
        values = np.concatenate([getattr(of_one, name) for of_one in samples])
        return np.bincount(row, values)[full] / counts[full]

    nearest = np.minimum(np.searchsorted(time_s, middle_s), len(time_s) - 1)
    facts = list(units.values())
    soaking = np.array([facts[at]["phase"] == SOAK for at in leg[nearest]])
    commanded = np.array([float(facts[at]["set_point_degC"]) for at in leg[nearest]])
    chamber = np.concatenate([folder.rows(CHAMBER, unit) for unit in units])
    read_s = chamber["arrival_time_s"]
    on_ramp = np.interp(middle_s, read_s, chamber["set_point_degC"])
    dataset = _dataset(
        parameters,
        middle_s,
        soaking,
        np.where(soaking, commanded, np.round(on_ramp, 3)),
        means("rate_deg_per_h"),
        means("gyro_degC"),
        np.interp(middle_s, read_s, chamber["process_value_degC"]),
        number[nearest],
    )
    return replace(dataset, places=tuple(_places(folder, bench)))


def _places(folder: RunFolder, bench: Bench) -> Iterator[AtPlaces]:
    """Yield what a thermometer with places read at the end of each soak."""
    corrected, units = corrected_by(bench), folder.finished_units()
    for unit, recorded in recorded_rows(folder, units, still).items():
        if units[unit]["phase"] == SOAK:
            read_s = recorded.rows["arrival_time_s"]
            lasts_s = min(AT_THE_END_S, PART * float(read_s[-1] - read_s[0]))
            yield at_places(unit, recorded.only(read_s >= read_s[-1] - lasts_s), corrected)


def _dataset(
    parameters: BiasTemperatureParameters,
    time_s: Array,
    soaking: Mask,
    set_point_degC: Array,
    rate_deg_per_h: Array,
    gyro_degC: Array,
    chamber_degC: Array,
    switch_on: Index,
) -> TemperatureDataset:
    """Return rows (n,) of a run with what the plan says of them."""
    return TemperatureDataset(
        directions=directions_of(parameters.input_axis),
        latitude_rad=float(np.deg2rad(parameters.latitude_deg)),
        sample_interval_s=parameters.row_interval_s,
        reference_degC=parameters.reference_temperature_degC,
        sensor_lag_prior_s=parameters.sensor_lag_prior_s,
        time_s=time_s,
        soaking=soaking,
        set_point_degC=set_point_degC,
        rate_deg_per_h=rate_deg_per_h[:, None],
        gyro_degC=gyro_degC if np.isfinite(gyro_degC).any() else None,
        chamber_degC=chamber_degC,
        switch_on=switch_on,
    )


def _samples(folder: RunFolder, pulse_arcsec: float, interval_s: float) -> Iterator[Samples]:
    """Yield the samples of each switch-on, all its finished units together."""
    units = list(folder.finished_units().items())
    for number in sorted({int(details["switch_on"]) for _, details in units}):
        rows, legs = [], []
        for at, (unit, details) in enumerate(units):
            if details["switch_on"] == number:
                rows.append(folder.rows(GYRO, unit))
                legs.append(np.full(len(rows[-1]), at))
        table = np.concatenate(rows)
        sequence = unwrapped(table["sequence"])
        line = align(sequence, table["arrival_time_s"], interval_s)
        whole = np.diff(sequence) == 1
        # Read at the end of each interval; that of a row is the mean over it.
        read = table["temperature_degC"].astype(np.float64)
        yield Samples(
            number,
            line.run_time_s(sequence[1:] - 0.5)[whole],
            pulses_of(table["counts"])[whole] * pulse_arcsec / line.rate,
            (0.5 * (read[1:] + read[:-1]))[whole],
            np.concatenate(legs)[1:][whole],
        )
