"""The drive of a plan: where its file is, and its copy in a run's folder."""

from __future__ import annotations

from pathlib import Path

from procedures.fog_scale_factor_temperature.dataset import Drive
from procedures.fog_scale_factor_temperature.parameters import FogParameters

PLACE = "inputs/drive.csv"
"""Where a run folder keeps the file, byte by byte as it was when the run began."""

DRIVES = "drives"
SUFFIX = ".csv"


def inputs(parameters: FogParameters) -> dict[str, Path]:
    """Return the file that the plan names, by its place in a run; FaultList where there is none."""
    from station.files.lookup import find

    if parameters.drive is None:
        return {}
    return {PLACE: find(DRIVES, parameters.drive.file, SUFFIX)}


def drive_in(path: Path, parameters: FogParameters) -> Drive | None:
    """Return the drive in a file by what the plan says of it, None where the plan names none.

    FaultList names file, row and reason.
    """
    from procedures.fog_scale_factor_temperature.from_import import read_drive

    test = parameters.drive
    if test is None:
        return None
    latitude_deg = parameters.latitude_deg if test.latitude_deg is None else test.latitude_deg
    return read_drive(path, latitude_deg, test.initial_heading_deg)
