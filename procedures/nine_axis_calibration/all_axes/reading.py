"""The columns of an imported dataset that the other six axes need."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.nine_axis_calibration.dataset import StaticRecord
from procedures.nine_axis_calibration.parameters import AllAxesPrior, EarthField, Gravity
from procedures.nine_axis_calibration.pose import ATTITUDES
from station.dataset_reading import Table, refuse
from station.fields import StrictModel
from station.files.faults import Fault

from .stands import Array, CoilRecord, Mounted, OtherAxes, Rest, Turned, direction

if TYPE_CHECKING:
    from procedures.nine_axis_calibration.parameters import NineAxisParameters
    from station.dataset_reading import RawDataset

ACCELEROMETERS = ("ax_g", "ay_g", "az_g")
MAGNETOMETER = ("mx_nT", "my_nT", "mz_nT")
POSE_COLUMNS = ("pose", "t_s")
GAUSSMETER = ("bx_nT", "by_nT", "bz_nT")


class OtherConditions(StrictModel):
    """What is known of gravity and of the earth's field."""

    prior: AllAxesPrior
    local_gravity_g: Gravity = 1.0
    earth_field: EarthField | None = None


def columns_of(table: Table, names: Sequence[str]) -> Array | None:
    """Return columns (n, 3), None where the table has none of them; refuse some without others."""
    there = [name for name in names if name in table]
    if not there:
        return None
    lacking = [name for name in names if name not in table]
    refuse([Fault(str(table.path), 1, 1, name, "the column is missing") for name in lacking])
    return np.column_stack([np.asarray(table[name], dtype=np.float64) for name in names])


def poses_of(raw: RawDataset) -> Table | None:
    """Return the table of poses, None without such a file; refuse a direction that is none."""
    if "poses" not in raw.files:
        return None
    table = raw.read_table("poses", POSE_COLUMNS, (*ACCELEROMETERS, *MAGNETOMETER), ("pose",))
    if not any(name in table for name in (*ACCELEROMETERS, *MAGNETOMETER)):
        lacking = Fault(str(table.path), 1, 1, "ax_g", "neither accelerometers nor magnetometer")
        refuse([lacking])
    refuse(unknown_directions(table, "pose"))
    return table


def coil_of(raw: RawDataset, prior: AllAxesPrior) -> CoilRecord | None:
    """Return the record in the coil, None without such a file."""
    if "coil" not in raw.files:
        return None
    table = raw.read_table("coil", ("t_s", *GAUSSMETER, *MAGNETOMETER), rising="t_s")
    applied, output = columns_of(table, GAUSSMETER), columns_of(table, MAGNETOMETER)
    assert applied is not None
    assert output is not None
    alignment_rad = math.radians(prior.coil_alignment_deg)
    return CoilRecord(
        applied, output, prior.gaussmeter_gain, prior.gaussmeter_zero_nT, alignment_rad
    )


def unknown_directions(table: Table, column: str) -> list[Fault]:
    """Return a fault for each row whose direction is none."""
    text = "'{}' is no direction; write what points up: X, -X, X+Y, -X-Y-Z"
    words = table[column].tolist()
    bad = {word for word in set(words) if direction(str(word)) is None}
    return [table.fault(n, column, text.format(w)) for n, w in enumerate(words) if w in bad]


def other_axes(
    conditions: OtherConditions | NineAxisParameters,
    latitude_deg: float,
    static: Sequence[StaticRecord],
    static_field: Sequence[Array | None],
    turned: Sequence[tuple[str, Turned]],
    poses: Sequence[Rest],
    coil: CoilRecord | None,
    source: str = "the dataset's conditions",
) -> OtherAxes | None:
    """Return what the other axes are calibrated by; None where nothing of them was recorded."""
    mountings = tuple(_mounted(conditions.prior, turned))
    if (
        not poses
        and coil is None
        and not any(
            record.acceleration_g is not None or record.field_nT is not None
            for mounting in mountings
            for record in mounting.records
        )
    ):
        return None
    tilt_rad = math.radians(conditions.prior.tilt_arcmin / 60.0)
    rests = [
        Rest(
            f"position {record.position}",
            np.array(ATTITUDES[record.position])[:, 2],
            tilt_rad,
            record.time_s,
            record.acceleration_g,
            field,
        )
        for record, field in zip(static, static_field, strict=True)
    ]
    prior, field = conditions.prior, conditions.earth_field
    inclination = field.inclination_deg if field else None
    return OtherAxes(
        _with_own_names([*rests, *poses]),
        mountings,
        latitude_deg,
        tilt_rad,
        conditions.local_gravity_g,
        prior.local_gravity_g,
        field.magnitude_nT if field else None,
        prior.earth_field_magnitude_nT,
        None if inclination is None else math.radians(inclination),
        math.radians(prior.earth_field_inclination_deg),
        prior.accelerometer_second_order_ug_per_g2 * 1e-6,
        coil,
        source,
    )


def pose(prior: AllAxesPrior, word: str, time_s: Array, force: Array, field: Array | None) -> Rest:
    """Return a pose: one axis up is known as a position's tilt, what is between axes as `edge`."""
    up = direction(word)
    assert up is not None
    return Rest(f"pose {word}", up, lean_rad(prior, up, prior.tilt_arcmin), time_s, force, field)


def lean_rad(prior: AllAxesPrior, up: Array, arcmin: float) -> float:
    """Return how well a direction is known, by the prior of one axis up in arcmin, or of edges."""
    one_axis = np.count_nonzero(np.abs(up) > 1e-9) == 1
    return math.radians(arcmin / 60.0 if one_axis else prior.edge_deg)


def _mounted(prior: AllAxesPrior, turned: Sequence[tuple[str, Turned]]) -> Iterator[Mounted]:
    """Yield successive records of one direction as one mounting."""
    mounting = prior.tilt_arcmin if prior.mounting_arcmin is None else prior.mounting_arcmin
    groups: list[tuple[str, list[Turned]]] = []
    for word, record in turned:
        if not groups or groups[-1][0] != word:
            groups.append((word, []))
        groups[-1][1].append(record)
    for number, (word, records) in enumerate(groups, 1):
        up = direction(word)
        assert up is not None
        name = f"mounting {number}, {word} up"
        yield Mounted(name, up, lean_rad(prior, up, mounting), tuple(records))


def _with_own_names(rests: Sequence[Rest]) -> tuple[Rest, ...]:
    """Return stands of which no two have one name."""
    names = [rest.name for rest in rests]
    return tuple(
        replace(rest, name=f"{rest.name} ({n})") if names.count(rest.name) > 1 else rest
        for n, rest in enumerate(rests, 1)
    )
