"""From an imported dataset folder to the dataset of the analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from procedures.common.conditions import OverDevice
from station.dataset_reading import Table, refuse
from station.fields import Unit
from station.files.faults import FaultList

from .dataset import AccelerometerDataset
from .model import PLANES

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

COLUMNS = ("t_s", "plane", "theta_deg", "field_commanded_T", "field_T", "output_V")
TEMPERATURE = "temperature_degC"
EVEN = 0.01
MOSTLY = 0.6
LARGEST_FIELD_T = 3.0
"""No Helmholtz coil comes near: such a number is in mT or G."""
FINEST = 720
NEAR_DEG = 0.02
NEAR_PART = 0.02
MAX_OFF = 0.1
LARGEST_OFFSET_DEG = 1.0

Array = NDArray[np.float64]


class Conditions(OverDevice):
    """The conditions of an accelerometer dataset."""

    # On the ground it is 0.9957 g to 1.0028 g.
    local_gravity_g: Annotated[float, Unit("g"), Field(ge=0.99, le=1.01)] = 1.0
    local_gravity_uncertainty_g: Annotated[float, Unit("g"), Field(ge=0, le=0.01)] = 0.0
    mounting_rad: Annotated[float, Unit("rad"), Field(gt=0, le=0.1)] | None = None
    thermometer_uncertainty_degC: Annotated[float, Unit("degC", True), Field(ge=0)] | None = None
    probe_angle_rad: Annotated[float, Unit("rad"), Field(ge=0, le=0.1)] | None = None
    ambient_field_T: Annotated[float, Unit("T"), Field(ge=0)] | None = None


def dataset_of_import(raw: RawDataset) -> AccelerometerDataset:
    """Return the rows of an imported folder; FaultList names file, row and reason."""
    conditions = raw.conditions(Conditions)
    raw.require_files(("samples",))
    table = raw.read_table("samples", COLUMNS, (TEMPERATURE,), text=("plane",), rising="t_s")
    refuse(table.unknown_words("plane", PLANES))
    _check_fields(table)
    plane = np.array([str(name).strip() for name in table["plane"]])
    time_s = np.asarray(table["t_s"], dtype=np.float64)
    return AccelerometerDataset(
        time_s=time_s,
        plane=plane,
        theta_deg=table["theta_deg"],
        theta_commanded_deg=plan_angles(plane, table["theta_deg"]),
        field_T=table["field_T"],
        field_commanded_T=table["field_commanded_T"],
        output_V=table["output_V"],
        temperature_degC=table.get(TEMPERATURE),
        evenly_timed=_even(time_s),
        gravity_g=conditions.local_gravity_g,
        mounting_rad=conditions.mounting_rad,
    )


def plan_angles(plane: NDArray[Any], theta_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the plan's angles, each plane's own; where the axis is vertical they mean nothing."""
    nominal_deg = theta_deg.copy()
    for name in np.unique(plane):
        inside = plane == name
        nominal_deg[inside] = 0.0 if name == "level" else nominal_angles(theta_deg[inside])
    return nominal_deg


def _even(time_s: NDArray[np.float64]) -> bool:
    steps_s = np.diff(time_s)
    if len(steps_s) < 2:
        return False
    usual_s = float(np.median(steps_s))
    return float(np.mean(np.abs(steps_s - usual_s) <= EVEN * usual_s)) >= MOSTLY


def _check_fields(table: Table) -> None:
    commanded_T = np.abs(table["field_commanded_T"])
    wrong = np.flatnonzero(commanded_T > LARGEST_FIELD_T)
    if len(wrong):
        row = int(wrong[0])
        what = f"{commanded_T[row]:g} T is no field of a coil; the column is in T"
        raise FaultList([table.fault(row, "field_commanded_T", what)])


def nominal_angles(theta_deg: Array) -> Array:
    """Return the commanded angle of each reading (n,), in deg; NaN for one off the plan's grid.

    What a plan determines is judged on its commanded angles: an encoder that stops 0.3 arcsec
    beside each would make dependent columns look independent. Plans change the angle evenly, so the
    coarsest even division of the circle, from 0 deg, is taken whose marks lie within 0.02 deg (and
    a fiftieth of the division) of nine readings in ten. Where there is none, the same with the
    encoder's zero off by up to 1 deg; where there is none even so, the readings themselves stand.
    """
    for with_offset in (False, True):
        for parts in range(1, FINEST + 1):
            marks_deg = _on_marks(theta_deg, 360.0 / parts, with_offset)
            if marks_deg is not None:
                return marks_deg
    return theta_deg


def _on_marks(theta_deg: Array, step_deg: float, with_offset: bool) -> Array | None:
    """Return the marks of a division that the readings stand for, None where too few do."""
    turn = np.mod(theta_deg, 360.0)
    if with_offset:
        off = np.mod(turn + 0.5 * step_deg, step_deg) - 0.5 * step_deg
        offset = float(np.median(off))
        if abs(offset) > min(LARGEST_OFFSET_DEG, 0.25 * step_deg):
            return None
        turn = turn - offset
    mark = np.rint(turn / step_deg) * step_deg
    near = np.abs(turn - mark) <= min(NEAR_DEG, NEAR_PART * step_deg)
    if float(np.mean(near)) < 1.0 - MAX_OFF:
        return None
    return np.where(near, np.round(np.mod(mark, 360.0), 12), np.nan)
