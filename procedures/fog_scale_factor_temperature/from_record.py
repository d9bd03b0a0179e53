"""From a run to the dataset: attitude and temperature before and after each turn."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.common.places import (
    AtPlaces,
    at_places,
    corrected_by,
    has_places,
    judged,
    widest,
)
from procedures.common.stage_and_meter import THERMOMETER
from procedures.estimation.channel import still
from station.errors import MissingRows

from .dataset import AXES, FogDataset, TurnTable
from .following import BETWEEN_TURNS, CHAMBER, NAVIGATOR, PROOF, RAMP, SOAK
from .from_import import PLACE, REFERENCE_PLACE, drive_in
from .parameters import FogParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


Array = NDArray[np.float64]
ARRIVAL = "arrival_time_s"
ATTITUDE = ("heading_deg", "pitch_deg", "roll_deg")
THINNED = 5
"""Of the blocks of outputs between turns, which are many, one of so many is drawn."""
SOAKED_S = 1800.0
"""Of a soak, its end."""
SHORT_OF_MOTION_S = 0.3
"""The last outputs before a turn may already have left when it began; they arrive late."""


def dataset_of_run(folder: RunFolder, parameters: FogParameters, bench: Bench) -> FogDataset:
    """Return all finished turns of a run; those of the verification ramp apart."""
    turns = turn_table(folder, RAMP)
    proof = turn_table(folder, PROOF)
    files = {place: folder.path / place for place in (PLACE, REFERENCE_PLACE)}
    return FogDataset(
        turns=turns,
        turn_sense="heading",
        full_attitude=True,
        gyro_bias_deg_per_h=parameters.gyro_bias_deg_per_h,
        heading_resolution_deg=parameters.heading_resolution_deg,
        angle_random_walk_deg_per_sqrt_h=parameters.angle_random_walk_deg_per_sqrt_h,
        turntable_accuracy_arcsec=parameters.turntable_accuracy_arcsec,
        reference_temperature_degC=parameters.reference_temperature_degC,
        initial_order=parameters.initial_order,
        temperature_range_degC=parameters.temperature_range_degC,
        verification=proof if len(proof) else None,
        drive=drive_in(files, parameters),
        history=history(folder),
        places=tuple(places(folder, bench)),
    )


def turn_table(folder: RunFolder, name: str) -> TurnTable:
    """Return the finished turns of one ramp in the order in which they were made.

    Where a turn is left out, so are the others of its set about its axis: only together do they
    cancel the gyro's bias.
    """
    apart = {unit.rpartition(" ")[0] for unit in folder.left_out}
    units = [
        (unit, details)
        for unit, details in folder.finished_units().items()
        if unit.split(" ")[0] == name and unit.rpartition(" ")[0] not in apart
    ]
    rows = [reading(folder, unit, details) for unit, details in units]

    def column(key: str) -> Array:
        return np.array([row[key] for row in rows], dtype=np.float64)

    return TurnTable(
        set_number=np.array([details["set"] for _, details in units], dtype=np.int64),
        before_s=column("before_s"),
        after_s=column("after_s"),
        axis=np.array([details["axis"] for _, details in units], dtype=np.str_),
        commanded_deg=np.array([details["turned_deg"] for _, details in units], dtype=np.float64),
        attitude_before_deg=np.array([row["before"] for row in rows]).reshape(-1, 3),
        attitude_after_deg=np.array([row["after"] for row in rows]).reshape(-1, 3),
        temperature_before_degC=column("temperature_before"),
        temperature_after_degC=column("temperature_after"),
        chamber_degC=np.array([details["chamber_degC"] for _, details in units], dtype=np.float64),
    )


def reading(folder: RunFolder, unit: str, details: dict[str, Any]) -> dict[str, Any]:
    """Return the means of a turn's two rests: attitudes (3,) in deg, temperatures, times."""
    rows = folder.rows(NAVIGATOR, unit)
    arrival_s = rows[ARRIVAL]
    temperature = rows[f"temperature_{details['axis']}_degC"]
    before = arrival_s <= float(details["before_s"]) - SHORT_OF_MOTION_S
    after = (arrival_s >= float(details["rests_s"]) + 1.0) & (arrival_s <= details["after_s"])
    if not before.any() or not after.any():
        raise MissingRows(unit, "the navigator sent nothing while the table rested")
    return {
        "before_s": float(arrival_s[before].mean()),
        "after_s": float(arrival_s[after].mean()),
        "before": mean_attitude_deg(rows[before]),
        "after": mean_attitude_deg(rows[after]),
        "temperature_before": float(temperature[before].mean()),
        "temperature_after": float(temperature[after].mean()),
    }


def mean_attitude_deg(rows: NDArray[Any]) -> Array:
    """Return the mean heading, pitch and roll (3,) of attitudes that differ by their noise alone.

    With an axis up that stands at a pitch of 90 deg, heading and roll turn together and only their
    combination means anything: the attitudes are averaged as rotations.
    """
    from scipy.spatial.transform import Rotation

    angles = np.column_stack([rows[name] for name in ATTITUDE])
    mean = Rotation.from_euler("ZYX", angles, degrees=True).mean()
    return np.asarray(mean.as_euler("ZYX", degrees=True), dtype=np.float64)


def history(folder: RunFolder) -> dict[str, Array]:
    """Return the temperatures of chamber and gyros against time, between the turns."""
    columns = {"chamber": (CHAMBER, "process_value_degC", 1)}
    columns |= {f"gyro {axis}": (NAVIGATOR, f"temperature_{axis}_degC", THINNED) for axis in AXES}
    readings = {}
    for name, (source, column, every) in columns.items():
        blocks = [
            block for unit in BETWEEN_TURNS for block in folder.recorded_blocks(source, unit, every)
        ]
        if blocks:
            rows = np.concatenate(
                [np.column_stack((block[ARRIVAL], block[column])) for block in blocks]
            )
            readings[name] = rows[np.argsort(rows[:, 0])]
    return readings


def places(folder: RunFolder, bench: Bench) -> Iterator[AtPlaces]:
    """Yield what a thermometer with places read at the end of the soak, and where it is widest."""
    corrected = corrected_by(bench)
    read = {unit: recorded_between(folder, unit) for unit in (SOAK, RAMP)}
    recorded = judged({unit: rows for unit, rows in read.items() if rows is not None}, still)
    if (soak := recorded.get(SOAK)) is not None:
        read_s = soak.rows[ARRIVAL]
        yield at_places(SOAK, soak.only(read_s >= read_s[-1] - SOAKED_S), corrected)
    if (ramp := recorded.get(RAMP)) is not None:
        read_s = ramp.rows[ARRIVAL]
        hours = ((read_s - read_s[0]) / SECONDS_PER_HOUR).astype(np.int64)
        each = [
            at_places(f"ramp, hour {hour + 1}", ramp.only(hours == hour), corrected)
            for hour in np.unique(hours).tolist()
        ]
        far = widest(each)
        yield from [] if far is None else [far]


def recorded_between(folder: RunFolder, unit: str) -> NDArray[Any] | None:
    """Return the rows of places that belong to no turn; None where there are none."""
    blocks = folder.recorded_blocks(THERMOMETER, unit)
    if not (blocks and has_places(blocks[0])):
        return None
    rows = np.concatenate(blocks)
    return rows[np.argsort(rows[ARRIVAL], kind="stable")]
