"""From an imported dataset folder to the dataset of the analysis, and a plan's drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from procedures.common.conditions import OverDevice
from station.dataset_reading import Table, check_ascending, read_table, refuse
from station.fields import Celsius, Degree, Second, Unit
from station.files.faults import Fault, FaultList
from station.files.lookup import find

from .dataset import AXES, Array, Drive, FogDataset, Trajectory, TurnTable
from .parameters import PUBLISHED_ORDER, USUAL_REFERENCE_DEGC, Departure, FogParameters

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

TURNS, VERIFICATION, DRIVE, REFERENCE = "turns", "verification", "drive", "reference"
SIDES = ("before", "after")
CHAMBER = "chamber_temperature_degC"
REFERENCE_HEADING = "heading_deg"
DRIVE_COLUMNS = (
    "t_s",
    *(f"rate_{axis}_deg_per_s" for axis in AXES),
    *(f"temperature_{axis}_degC" for axis in AXES),
)
SPECIFIC_FORCE = tuple(f"specific_force_{axis}_m_per_s2" for axis in AXES)
VELOCITY = tuple(f"velocity_{direction}_m_per_s" for direction in ("north", "east", "down"))
REFERENCE_COLUMNS = ("t_s", "latitude_deg", "longitude_deg", "height_m", *VELOCITY)
PLACE, REFERENCE_PLACE = "inputs/drive.csv", "inputs/reference.csv"
"""Where a run folder keeps the drive and its reference, byte by byte as they were at its start."""
FEWEST_FIXES, MAX_LATITUDE_DEG = 4, 89.0
DRIVES, SUFFIX = "drives", ".csv"


class Conditions(OverDevice, Departure):
    """The conditions of a dataset of turns over temperature."""

    attitude_output: Literal["heading", "heading-pitch-roll"]
    turn_sense: Literal["heading", "about-up"]
    heading_resolution_deg: Annotated[float, Unit("deg"), Field(ge=0)] = 0.0
    turntable_accuracy_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0)] | None = None
    angle_random_walk_deg_per_sqrt_h: Annotated[float, Unit("deg/sqrt(h)"), Field(ge=0)] | None = (
        None
    )
    temperature_range_degC: tuple[Celsius, Celsius] | None = None
    soak_s: Annotated[Second, Field(gt=0)] | None = None
    gyro_bias_deg_per_h: Annotated[float, Unit("deg/h"), Field(ge=0)] | None = None
    initial_order: Annotated[int, Field(ge=0, le=14)] = PUBLISHED_ORDER
    reference_temperature_degC: Celsius = USUAL_REFERENCE_DEGC
    thermometer_uncertainty_degC: Annotated[float, Unit("degC", True), Field(ge=0)] | None = None
    latitude_deg: Annotated[Degree, Field(ge=-90, le=90)] | None = None
    latitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] | None = None

    @field_validator("temperature_range_degC")
    @classmethod
    def low_to_high(
        cls, between: tuple[float, float] | None, info: ValidationInfo
    ) -> tuple[float, float] | None:
        """Require a range that rises."""
        if between is not None and between[1] <= between[0]:
            raise ValueError("must go from the lowest to the highest temperature")
        return between


def dataset_of_import(raw: RawDataset, conditions: Conditions) -> FogDataset:
    """Return the turns of an imported folder; FaultList names file, row and reason."""
    raw.require_files((TURNS,), (VERIFICATION, DRIVE, REFERENCE))
    if REFERENCE in raw.files and DRIVE not in raw.files:
        what = "is the trajectory of a drive, and there is no file drive"
        raise FaultList([raw.document.fault(("files", REFERENCE), what)])
    full = conditions.attitude_output == "heading-pitch-roll"
    turns = read_turns(raw, TURNS, full)
    verification = read_turns(raw, VERIFICATION, full) if VERIFICATION in raw.files else None
    drive = None
    if DRIVE in raw.files:
        if conditions.latitude_deg is None:
            what = "is missing: a drive turns with the earth, whose rate depends on it"
            raise FaultList([raw.document.fault(("conditions", "latitude"), what)])
        reference = raw.file(REFERENCE) if REFERENCE in raw.files else None
        drive = read_drive(raw.file(DRIVE), reference, conditions.latitude_deg, conditions)
    return FogDataset(
        turns=turns,
        turn_sense=conditions.turn_sense,
        full_attitude=full,
        gyro_bias_deg_per_h=conditions.gyro_bias_deg_per_h,
        heading_resolution_deg=conditions.heading_resolution_deg,
        angle_random_walk_deg_per_sqrt_h=conditions.angle_random_walk_deg_per_sqrt_h,
        turntable_accuracy_arcsec=conditions.turntable_accuracy_arcsec,
        reference_temperature_degC=conditions.reference_temperature_degC,
        initial_order=conditions.initial_order,
        temperature_range_degC=conditions.temperature_range_degC,
        verification=verification,
        drive=drive,
        history=history_of(turns),
    )


def inputs(parameters: FogParameters) -> dict[str, Path]:
    """Return the files that the plan names, by place in a run; FaultList where there is none."""
    test = parameters.drive
    if test is None:
        return {}
    names = {PLACE: test.file, REFERENCE_PLACE: test.reference}
    return {place: find(DRIVES, name, SUFFIX) for place, name in names.items() if name is not None}


def drive_in(files: Mapping[str, Path], parameters: FogParameters) -> Drive | None:
    """Return the drive in files, by place, with what the plan says of it, None where it names none.

    FaultList names file, row and reason.
    """
    test = parameters.drive
    if test is None:
        return None
    latitude_deg = parameters.latitude_deg if test.latitude_deg is None else test.latitude_deg
    reference = None if test.reference is None else files[REFERENCE_PLACE]
    return read_drive(files[PLACE], reference, latitude_deg, test)


def read_turns(raw: RawDataset, name: str, full_attitude: bool) -> TurnTable:
    """Return the table of turns in one of the files; FaultList names each row that cannot be."""
    angles = ("heading", "pitch", "roll") if full_attitude else ("heading",)
    wanted = ["set", "t_before_s", "t_after_s", "axis", "commanded_deg"]
    wanted += [f"{angle}_{side}_deg" for side in SIDES for angle in angles]
    wanted += [f"gyro_temperature_{side}_degC" for side in SIDES]
    table = raw.read_table(name, wanted, (CHAMBER,), text=("axis",), rising="t_before_s")
    _check_rows(table)
    nothing = np.full(len(table.lines), np.nan)

    def attitude(side: str) -> Array:
        names = [f"{angle}_{side}_deg" for angle in ("heading", "pitch", "roll")]
        return np.column_stack([table.get(name, nothing) for name in names])

    return TurnTable(
        set_number=np.rint(table["set"]).astype(np.int64),
        before_s=table["t_before_s"],
        after_s=table["t_after_s"],
        axis=table["axis"],
        commanded_deg=table["commanded_deg"],
        attitude_before_deg=attitude("before"),
        attitude_after_deg=attitude("after"),
        temperature_before_degC=table["gyro_temperature_before_degC"],
        temperature_after_degC=table["gyro_temperature_after_degC"],
        chamber_degC=table.get(CHAMBER, nothing),
    )


def read_drive(path: Path, reference: Path | None, latitude_deg: float, began: Departure) -> Drive:
    """Return the drive in a CSV file, and its reference; FaultList names file, row and reason."""
    table = read_table(path, DRIVE_COLUMNS, (REFERENCE_HEADING, *SPECIFIC_FORCE))
    lacking = [name for name in SPECIFIC_FORCE if name not in table]
    if 0 < len(lacking) < len(SPECIFIC_FORCE):
        what = "is missing: specific force has three axes"
        raise FaultList([Fault(str(path), 1, 1, lacking[0], what)])
    check_ascending(path, table, "t_s")
    if len(table.lines) < 2:
        what = "a drive needs at least two rows"
        raise FaultList([table.fault(0, "file", what)])
    return Drive(
        time_s=table["t_s"],
        rate_deg_per_s=np.column_stack([table[f"rate_{axis}_deg_per_s"] for axis in AXES]),
        temperature_degC=np.column_stack([table[f"temperature_{axis}_degC"] for axis in AXES]),
        latitude_deg=latitude_deg,
        heading_deg=table.get(REFERENCE_HEADING),
        first_heading_deg=began.initial_heading_deg or 0.0,
        first_heading_known=began.initial_heading_deg is not None,
        first_pitch_deg=began.initial_pitch_deg,
        first_roll_deg=began.initial_roll_deg,
        specific_force_m_per_s2=None if lacking else _side_by_side(table, SPECIFIC_FORCE),
        reference=None if reference is None else read_trajectory(reference),
    )


def read_trajectory(path: Path) -> Trajectory:
    """Return the reference trajectory in a CSV file; FaultList names file, row and reason."""
    table = read_table(path, REFERENCE_COLUMNS)
    check_ascending(path, table, "t_s")
    faults = []
    if len(table.lines) < FEWEST_FIXES:
        faults.append(table.fault(0, "file", "a reference trajectory needs at least four rows"))
    beyond = np.flatnonzero(np.abs(table["latitude_deg"]) > MAX_LATITUDE_DEG)
    what = "lies at a pole or beyond it"
    faults += [table.fault(int(row), "latitude_deg", what) for row in beyond]
    refuse(faults)
    return Trajectory(
        time_s=table["t_s"],
        latitude_deg=table["latitude_deg"],
        longitude_deg=table["longitude_deg"],
        height_m=table["height_m"],
        velocity_m_per_s=_side_by_side(table, VELOCITY),
    )


def _side_by_side(table: Table, names: Sequence[str]) -> Array:
    return np.column_stack([table[name] for name in names])


def history_of(turns: TurnTable) -> dict[str, Array]:
    """Return the temperatures against time that a table of turns holds."""
    history = {}
    if bool(np.isfinite(turns.chamber_degC).all()):
        history["chamber"] = np.column_stack((turns.middle_s, turns.chamber_degC))
    for axis in AXES:
        own = turns.axis == axis
        if bool(own.any()):
            readings = np.column_stack((turns.middle_s[own], turns.temperature_degC[own]))
            history[f"gyro {axis}"] = readings
    return history


def _check_rows(table: Table) -> None:
    faults = table.unknown_words("axis", AXES)
    for n, number in enumerate(table["set"]):
        before, after = table["t_before_s"][n], table["t_after_s"][n]
        if after <= before:
            what = f"{after:.10g} is not after t_before_s, {before:.10g}"
            faults.append(table.fault(n, "t_after_s", what))
        if abs(number - round(number)) > 1e-9:
            faults.append(table.fault(n, "set", f"{number:g} is not a whole number"))
    refuse(sorted(faults, key=lambda fault: fault.line))
