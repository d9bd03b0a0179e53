"""From an imported dataset folder to the dataset of the analysis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from procedures.estimation.turn_encoder import unwrap
from station.dataset_reading import Table, refuse
from station.fields import Unit
from station.files.faults import Fault, listed

from .all_axes.reading import (
    ACCELEROMETERS,
    MAGNETOMETER,
    OtherConditions,
    coil_of,
    columns_of,
    other_axes,
    pose,
    poses_of,
    unknown_directions,
)
from .all_axes.stands import OtherAxes, Rest, Turned, direction
from .dataset import AXES, Array, NineAxisDataset, StaticRecord, TurnRecord
from .means import interval_of
from .outlook import prior_of
from .parameters import AllAxesPrior
from .pose import ATTITUDES

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

GYROS = ("gx_deg_per_h", "gy_deg_per_h", "gz_deg_per_h")
STATIC_COLUMNS = ("position", "t_s", *GYROS, *ACCELEROMETERS)
RATE = "rate_deg_per_s"
ENCODER = "encoder_deg"
RATE_COLUMNS = ("axis", "commanded_deg_per_s", "t_s", ENCODER)
ALL_THREE = ("gx_deg_per_s", "gy_deg_per_s", "gz_deg_per_s")
HARDLY_TURNED = 0.1


class Conditions(OtherConditions):
    """The conditions of a nine-axis dataset."""

    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    latitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0
    range_deg_per_s: Annotated[float, Unit("deg/s"), Field(gt=0)] | None = None


def dataset_of_import(raw: RawDataset) -> tuple[NineAxisDataset, OtherAxes | None]:
    """Return the records of an imported folder; FaultList names file, row and reason.

    The second is what accelerometers and magnetometer are calibrated by, None where nothing is.
    """
    conditions = raw.conditions(Conditions)
    raw.require_files(("static", "rate"), ("poses", "coil"))
    static = raw.read_table("static", STATIC_COLUMNS, MAGNETOMETER)
    more = (RATE, *ALL_THREE, *ACCELEROMETERS, *MAGNETOMETER)
    rate = raw.read_table("rate", RATE_COLUMNS, more, text=("axis",))
    poses = poses_of(raw)
    _check_positions(static)
    _check_turns(rate)
    at_rest = tuple(_static_records(static))
    turned = list(_turned(rate))
    dataset = NineAxisDataset(
        latitude_deg=conditions.latitude_deg,
        prior=prior_of(conditions.prior),
        static=at_rest,
        turns=tuple(record.turn for word, record in turned if word in AXES),
        largest_rate_deg_per_s=conditions.range_deg_per_s,
    )
    stands = () if poses is None else tuple(_poses(poses, conditions.prior))
    fields = list(_fields(static))
    coil = coil_of(raw, conditions.prior)
    latitude_deg = conditions.latitude_deg
    return dataset, other_axes(conditions, latitude_deg, at_rest, fields, turned, stands, coil)


def _fields(table: Table) -> Iterator[Array | None]:
    """Yield the magnetometer's samples of each position, None where it was not recorded."""
    field = columns_of(table, MAGNETOMETER)
    for rows in _stretches(table, ("position",)):
        yield None if field is None else field[rows]


def _poses(table: Table, prior: AllAxesPrior) -> Iterator[Rest]:
    """Yield each pose; a channel that was not recorded is NaN, or None."""
    force, field = columns_of(table, ACCELEROMETERS), columns_of(table, MAGNETOMETER)
    for rows in _stretches(table, ("pose",)):
        time_s = _numbers(table, "t_s", rows)
        felt = np.full((len(time_s), 3), np.nan) if force is None else force[rows]
        word = str(table["pose"][rows.start])
        yield pose(prior, word, time_s, felt, None if field is None else field[rows])


def _static_records(table: Table) -> Iterator[StaticRecord]:
    for rows in _stretches(table, ("position",)):
        yield StaticRecord(
            position=round(float(table["position"][rows.start])),
            time_s=_numbers(table, "t_s", rows),
            rate_deg_per_h=np.column_stack([_numbers(table, column, rows) for column in GYROS]),
            acceleration_g=np.column_stack(
                [_numbers(table, column, rows) for column in ACCELEROMETERS]
            ),
        )


def _turned(table: Table) -> Iterator[tuple[str, Turned]]:
    """Yield each record of turns, and what pointed up in it."""
    faults: list[Fault] = []
    records = []
    force, field = columns_of(table, ACCELEROMETERS), columns_of(table, MAGNETOMETER)
    for rows in _stretches(table, ("axis", "commanded_deg_per_s")):
        word = str(table["axis"][rows.start])
        up = direction(word)
        axis = int(np.argmax(np.abs(up))) if up is not None else 0
        time_s = _numbers(table, "t_s", rows)
        rate = np.full((len(time_s), 3), np.nan)
        if ALL_THREE[0] in table:
            rate[:] = np.column_stack([_numbers(table, column, rows) for column in ALL_THREE])
        if RATE in table and word in AXES:
            rate[:, axis] = _numbers(table, RATE, rows)
        commanded = float(table["commanded_deg_per_s"][rows.start])
        record = TurnRecord(axis, commanded, time_s, rate, _numbers(table, ENCODER, rows))
        faults += _against(table, rows.start, record)
        felt = None if force is None else force[rows]
        records.append((word, Turned(record, felt, None if field is None else field[rows])))
    refuse(faults)
    yield from records


def _against(table: Table, row: int, record: TurnRecord) -> Iterator[Fault]:
    """Yield the fault of an encoder that does not turn as the table was commanded to."""
    if len(record.time_s) < 2:
        return
    nominal = record.commanded_deg_per_s
    interval_s = interval_of([record.time_s])
    encoder = unwrap(record.time_s, record.encoder_deg, nominal, interval_s)
    turned = encoder.mean_rate_deg_per_s / nominal
    if encoder.reversed or turned < HARDLY_TURNED:
        what = (
            f"turns at {encoder.mean_rate_deg_per_s:.4g} deg/s where "
            f"{nominal:g} deg/s were commanded; angles are positive "
            "counter-clockwise seen from above, as rates are"
        )
        yield table.fault(row, ENCODER, what)


def _numbers(table: Table, column: str, rows: slice) -> Array:
    return np.asarray(table[column][rows], dtype=np.float64)


def _stretches(table: Table, keys: tuple[str, ...]) -> Iterator[slice]:
    """Yield each stretch of rows in which the keys stay the same; times rise within each."""
    count = len(table["t_s"])
    changed = np.zeros(count, dtype=bool)
    changed[0] = True
    for key in keys:
        changed[1:] |= table[key][1:] != table[key][:-1]
    starts = np.flatnonzero(changed).tolist()
    time_s = np.asarray(table["t_s"], dtype=np.float64)
    late = (np.flatnonzero(np.diff(time_s) <= 0.0) + 1).tolist()
    text = "{:.10g} is not after {:.10g} of the row above; times must rise"
    refuse(
        [
            table.fault(n, "t_s", text.format(time_s[n], time_s[n - 1]))
            for n in late
            if not changed[n]
        ]
    )
    for start, stop in zip(starts, [*starts[1:], count], strict=True):
        yield slice(start, stop)


def _check_positions(table: Table) -> None:
    known = [str(position) for position in ATTITUDES]
    text = f"there is no position {{:g}}; there are {listed(known)}"
    refuse(
        [
            table.fault(row, "position", text.format(value))
            for row, value in enumerate(table["position"].tolist())
            if value not in ATTITUDES
        ]
    )


def _check_turns(table: Table) -> None:
    faults = []
    gyros = [column for column in ALL_THREE if column in table]
    if RATE not in table and not gyros:
        what = f"the column is missing; give it, or all of {listed(ALL_THREE)}"
        faults.append(Fault(str(table.path), 1, 1, RATE, what))
    elif gyros and len(gyros) < len(ALL_THREE):
        lacking = next(column for column in ALL_THREE if column not in table)
        faults.append(Fault(str(table.path), 1, 1, lacking, "the column is missing"))
    what = "a record at rest determines no scale factor"
    at_rest = np.flatnonzero(table["commanded_deg_per_s"] == 0.0).tolist()
    faults += [table.fault(row, "commanded_deg_per_s", what) for row in at_rest]
    refuse([*faults, *unknown_directions(table, "axis")])
