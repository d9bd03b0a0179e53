"""From an imported dataset folder to the dataset of the analysis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from procedures.common.conditions import OfRateOrCounts, OnEarth
from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.turn_encoder import Encoder, unwrap
from station.dataset_checks import switch_ons
from station.dataset_reading import Table, refuse
from station.fields import Unit
from station.files.faults import Fault

from .dataset import Array, RateTableDataset, Record

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

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
        records=tuple(_records(table, table[output] * (quantum or 1.0), conditions)),
        range_deg_per_s=conditions.range_deg_per_s,
    )
    return dataset, conditions


def _records(table: Table, rate: Array, conditions: Conditions) -> Iterator[Record]:
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
