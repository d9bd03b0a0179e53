"""Records of a gyro on a rate table: what the analysis needs, from a folder or from a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from procedures.common.conditions import OfRateOrCounts, OnEarth
from procedures.common.constants import EARTH_RATE_DEG_PER_H, FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.common.gyro_source import GYRO, IMU, NAVIGATOR, Axis
from procedures.estimation.gyro_outputs import outputs_of
from procedures.estimation.turn_encoder import Encoder, unwrap
from procedures.estimation.turn_track import SHORT_S, Track, track
from station.dataset_checks import switch_ons
from station.dataset_reading import Table, refuse
from station.errors import MissingRows
from station.fields import Unit
from station.files.faults import Fault
from station.findings import FlagThresholds

from .parameters import RateTableParameters
from .steps import TURNTABLE, UP_SENSE

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PPM = 1e6


@dataclass(frozen=True)
class Record:
    """One rate in one sense, or the table standing (0 commanded), n samples.

    `time_s` (n,) is the middle of each sample's interval, counted from power-on of the `repeat`;
    gaps are possible. `start_deg` and `end_deg` (n,) are the table's angle at both ends of each
    interval, turns counted, positive counter-clockwise seen from above like the rates; NaN where it
    is not known. `unsteady` (n,) marks samples in which the table was not at its rate;
    `wild_readings` of the encoder did not fit the turn. `angle_u_deg` is the standard uncertainty
    of the angle at each end of the record that the scatter of the samples does not show.
    """

    repeat: int
    commanded_deg_per_s: float
    time_s: Array
    rate_deg_per_s: Array
    start_deg: Array
    end_deg: Array
    unsteady: Mask
    wild_readings: int = 0
    angle_u_deg: float = 0.0

    @property
    def table_deg_per_interval(self) -> Array:
        """How far the table turned in each interval (n,)."""
        return self.end_deg - self.start_deg


@dataclass(frozen=True)
class RateTableDataset:
    """A gyro on a table that turns about the vertical, its input axis up.

    `quantum_deg_per_s` is one count as a rate, 0 for rates; `encoder_accuracy_deg` the standard
    deviation of the encoder's error within a turn. `range_deg_per_s` is the gyro's full scale, None
    where it is not stated. A navigator takes the earth's rate out itself: `earth_in_output` says
    whether it is in the rates.
    """

    latitude_rad: float
    sample_interval_s: float
    quantum_deg_per_s: float
    encoder_accuracy_deg: float
    records: tuple[Record, ...]
    range_deg_per_s: float | None = None
    axis: str = "IA"
    earth_in_output: bool = True

    @property
    def earth_up_deg_per_h(self) -> float:
        """The vertical part of the earth's rate."""
        return float(EARTH_RATE_DEG_PER_H * np.sin(self.latitude_rad)) * self.earth_in_output

    @property
    def earth_level_deg_per_h(self) -> float:
        """The horizontal part of the earth's rate."""
        return float(EARTH_RATE_DEG_PER_H * np.cos(self.latitude_rad)) * self.earth_in_output


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags, in standard uncertainties unless the name says otherwise.

    `part_turns`: part of the turned angle beyond whole turns; `rate_differs`: of the commanded
    rate.
    """

    nonlinearity_not_significant: float = 3.0
    drift_removed: float = 3.0
    part_turns: float = 0.05
    rate_differs: float = 0.01


TO_END = {"interval-start": 1.0, "interval-middle": 0.5, "interval-end": 0.0}
OUTPUTS = {"counts": "counts", "rate": "rate_deg_per_s"}
SLACK, WIDE = 1e-3, 1.5
"""Of a sample interval: what a stamp may be off, and the widest step that an angle is taken in."""
FAR = 0.5
"""Part of the commanded rate by which the encoder may differ before its column is in doubt."""


class Conditions(OnEarth, OfRateOrCounts):
    """The conditions of records on a rate table; what decides a sign has no default."""

    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0)]
    timestamp: Literal["interval-start", "interval-middle", "interval-end"]
    range_deg_per_s: Annotated[float, Unit("deg/s"), Field(gt=0)] | None = None
    clock_ppm: Annotated[float, Unit("ppm"), Field(ge=0)] = 0.0
    alignment_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0
    level_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0
    encoder_accuracy_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0)] = 0.0


def dataset_of_import(raw: RawDataset) -> tuple[RateTableDataset, Conditions]:
    """Return the records of an imported folder; FaultList names file, row and reason."""
    conditions = raw.conditions(Conditions)
    raw.require_files(("samples",))
    output = OUTPUTS[conditions.gyro_output]
    columns = ("repeat", "commanded_deg_per_s", "t_s", output, "encoder_deg")
    table = raw.read_table("samples", columns)
    quantum = 0.0
    if conditions.gyro_output == "counts":
        pulse_deg = (conditions.pulse_weight_arcsec or 0.0) / SECONDS_PER_HOUR
        quantum = pulse_deg / conditions.sample_interval_s
    dataset = RateTableDataset(
        latitude_rad=float(np.deg2rad(conditions.latitude_deg)),
        sample_interval_s=conditions.sample_interval_s,
        quantum_deg_per_s=quantum,
        encoder_accuracy_deg=conditions.encoder_accuracy_arcsec / SECONDS_PER_HOUR,
        records=tuple(_imported(table, table[output] * (quantum or 1.0), conditions)),
        range_deg_per_s=conditions.range_deg_per_s,
    )
    return dataset, conditions


def _imported(table: Table, rate: Array, conditions: Conditions) -> Iterator[Record]:
    interval_s = conditions.sample_interval_s
    switch_ons(table, "repeat", interval_s)
    repeat, commanded, time_s = table["repeat"], table["commanded_deg_per_s"], table["t_s"]
    begins = np.flatnonzero(
        (np.diff(repeat, prepend=np.nan) != 0.0) | (np.diff(commanded, prepend=np.nan) != 0.0)
    )
    faults: list[Fault] = []
    records = []
    for start, stop in zip(begins.tolist(), [*begins[1:].tolist(), len(repeat)], strict=True):
        rows = slice(start, stop)
        nominal = float(commanded[start])
        encoder = unwrap(time_s[rows], table["encoder_deg"][rows], nominal, interval_s)
        faults += _against(table, start, nominal, encoder, float(np.median(rate[rows])))
        end_s = time_s[rows] + TO_END[conditions.timestamp] * interval_s
        start_deg, end_deg = (
            _angle(time_s[rows], encoder.angle_deg, edge_s, interval_s)
            for edge_s in (end_s - interval_s, end_s)
        )
        middle_s, own = end_s - 0.5 * interval_s, rate[rows]
        number = int(repeat[start])
        angles = (start_deg, end_deg, encoder.unsteady, encoder.wild)
        records.append(Record(number, nominal, middle_s, own, *angles))
    refuse(faults)
    yield from records


def _against(
    table: Table, row: int, nominal: float, encoder: Encoder, read: float
) -> Iterator[Fault]:
    """Yield the fault of an encoder that does not turn as the table was commanded to."""
    turned = encoder.mean_rate_deg_per_s
    if not nominal or not np.isfinite(turned):
        return
    if encoder.reversed or abs(turned / nominal - 1.0) > FAR:
        what = (
            f"turns at {turned:.4g} deg/s where {nominal:g} deg/s were commanded and the gyro "
            f"reads {read:.4g} deg/s; angles and rates are positive counter-clockwise seen "
            "from above, in deg and deg/s"
        )
        yield table.fault(row, "encoder_deg", what)


def _angle(read_s: Array, angle_deg: Array, at_s: Array, interval_s: float) -> Array:
    """Return the angle at times (n,), NaN where no reading is near on one of both sides."""
    angle = np.interp(at_s, read_s, angle_deg)
    after = np.clip(np.searchsorted(read_s, at_s - SLACK * interval_s), 0, len(read_s) - 1)
    on = np.abs(read_s[after] - at_s) <= SLACK * interval_s
    before = np.maximum(after - 1, 0)
    around = (read_s[before] < at_s) & (at_s < read_s[after])
    near = around & (read_s[after] - read_s[before] < WIDE * interval_s)
    return np.asarray(np.where(on | near, angle, np.nan))


ARRIVAL = "arrival_time_s"
USUAL = 1.5
"""Readings that took longer than this many usual ones are left out: when they were is unknown."""


def dataset_of_run(
    folder: RunFolder, parameters: RateTableParameters, bench: Bench, axis: Axis = "IA"
) -> RateTableDataset:
    """Return the finished switch-ons of a run with an axis up, times from each switch-on.

    The board's scale and the table's angle are corrected by their records.
    """
    pulse_arcsec = parameters.pulse_weight_arcsec or 0.0
    if parameters.source == GYRO:
        pulse_arcsec *= float(bench.corrected(GYRO, "scale", 1.0, "1"))
    stated = bench.stated(TURNTABLE, "angle", FULL_TURN_DEG, "deg")
    records = [
        record
        for unit, details in folder.finished_units().items()
        if details.get("axis", "IA") == axis
        for record in _recorded(folder, unit, details, parameters, bench, axis, pulse_arcsec)
    ]
    return RateTableDataset(
        latitude_rad=float(np.deg2rad(parameters.latitude_deg)),
        sample_interval_s=parameters.sample_interval_s,
        quantum_deg_per_s=pulse_arcsec / SECONDS_PER_HOUR / parameters.sample_interval_s,
        encoder_accuracy_deg=stated[0] if stated else 0.0,
        records=tuple(records),
        range_deg_per_s=parameters.range_deg_per_s,
        axis=axis,
        earth_in_output=parameters.source != NAVIGATOR,
    )


def _recorded(
    folder: RunFolder,
    unit: str,
    details: Mapping[str, Any],
    parameters: RateTableParameters,
    bench: Bench,
    axis: Axis,
    pulse_arcsec: float,
) -> Iterator[Record]:
    interval_s = parameters.sample_interval_s
    rows = folder.rows(parameters.source, unit)
    if len(rows) < 2:
        raise MissingRows(unit, "the gyro's output did not come")
    outputs = outputs_of(rows, interval_s, [axis], pulse_arcsec)
    rate = outputs.rate_deg_per_h[:, 0] / SECONDS_PER_HOUR
    if parameters.source == IMU:
        # A rate counts over the interval by the station's clock, as the table's angle does.
        rate = rate * outputs.clock.rate / interval_s
    starts_s, ends_s = outputs.before_end_s(1.0), outputs.before_end_s(0.0)
    table = folder.rows(TURNTABLE, unit)
    for facts in details["records"]:
        path = _path(unit, table, facts)
        from_s, until_s = path.known(facts["from_s"], facts["until_s"])
        inside = np.flatnonzero((starts_s >= from_s) & (ends_s <= until_s))
        commanded = float(facts["rate_deg_per_s"])
        if commanded and len(inside):
            turns = round(abs(commanded) * parameters.record_s_at(abs(commanded)) / FULL_TURN_DEG)
            whole_s = turns * FULL_TURN_DEG / abs(path.rate_deg_per_s)
            inside = inside[ends_s[inside] < starts_s[inside[0]] + whole_s + 0.5 * interval_s]
        if not len(inside):
            raise MissingRows(unit, f"no sample came while {commanded:g} deg/s were recorded")
        start_deg, end_deg = (
            np.asarray(bench.corrected(TURNTABLE, "angle", path.angle_deg(edge_s[inside]), "deg"))
            for edge_s in (starts_s, ends_s)
        )
        yield Record(
            repeat=int(details["switch_on"]),
            commanded_deg_per_s=commanded,
            time_s=0.5 * (starts_s + ends_s)[inside] - details["on_s"],
            rate_deg_per_s=np.asarray(rate[inside], dtype=np.float64),
            start_deg=start_deg,
            end_deg=end_deg,
            unsteady=np.zeros(len(inside), dtype=bool),
            angle_u_deg=path.end_u_deg,
        )


def _path(unit: str, table: NDArray[Any], facts: Mapping[str, Any]) -> Track:
    """Return where the table was during a record, angles positive as rates are.

    A reading is taken for one of the middle between question and answer.
    """
    asked_s, answered_s = table["asked_time_s"], table[ARRIVAL]
    inside = (asked_s >= facts["from_s"]) & (answered_s <= facts["until_s"])
    took_s: Array = answered_s - asked_s
    if inside.any():
        inside &= took_s <= USUAL * float(np.median(took_s[inside])) + SHORT_S
    if int(inside.sum()) < 2:
        raise MissingRows(unit, f"the table's angle was not read at {facts['rate_deg_per_s']:g}")
    middle_s = 0.5 * (asked_s + answered_s)
    return track(middle_s[inside], UP_SENSE * table["angle_deg"][inside], took_s[inside])
