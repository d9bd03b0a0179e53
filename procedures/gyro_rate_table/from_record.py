"""From a run's raw rows to the dataset: pulses to rates, the board's clock to run time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.estimation.alignment import align, unwrapped
from procedures.estimation.pulses import pulses_of
from procedures.estimation.turn_track import SHORT_S, Track, track
from station.errors import MissingRows

from .dataset import Array, RateTableDataset, Record
from .parameters import RateTableParameters
from .steps import GYRO, TURNTABLE, UP_SENSE

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

ARRIVAL = "arrival_time_s"
USUAL = 1.5
"""Readings that took longer than this many usual ones are left out: when they were is unknown."""


def dataset_of_run(
    folder: RunFolder, parameters: RateTableParameters, bench: Bench
) -> RateTableDataset:
    """Return the finished switch-ons of a run, times from when each was switched on.

    The board's scale and the table's angle are corrected by their records.
    """
    pulse_arcsec = parameters.pulse_weight_arcsec * float(bench.corrected(GYRO, "scale", 1.0, "1"))
    quantum = pulse_arcsec / SECONDS_PER_HOUR / parameters.sample_interval_s
    stated = bench.stated(TURNTABLE, "angle", FULL_TURN_DEG, "deg")
    records = [
        record
        for unit, details in folder.finished_units().items()
        for record in _records(folder, unit, details, parameters, bench, quantum)
    ]
    return RateTableDataset(
        latitude_rad=float(np.deg2rad(parameters.latitude_deg)),
        sample_interval_s=parameters.sample_interval_s,
        quantum_deg_per_s=quantum,
        encoder_accuracy_deg=stated[0] if stated else 0.0,
        records=tuple(records),
        range_deg_per_s=parameters.range_deg_per_s,
    )


def _records(
    folder: RunFolder,
    unit: str,
    details: Mapping[str, Any],
    parameters: RateTableParameters,
    bench: Bench,
    quantum: float,
) -> Iterator[Record]:
    interval_s = parameters.sample_interval_s
    rows = folder.rows(GYRO, unit)
    number = unwrapped(rows["sequence"])
    if len(number) < 2:
        raise MissingRows(unit, "the gyro's board said nothing")
    # One line for the whole switch-on: its slope is the board's clock against the station's.
    board = align(number, rows[ARRIVAL], interval_s)
    whole = np.flatnonzero(np.diff(number) == 1) + 1
    rate = pulses_of(rows["counts"])[whole - 1] * quantum
    starts_s, ends_s = board.run_time_s(number[whole] - 1.0), board.run_time_s(number[whole])
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
