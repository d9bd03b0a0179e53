"""From an imported dataset folder to the dataset of the analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from station.dataset_reading import Table
from station.fields import StrictModel, Unit
from station.files.faults import FaultList

from .dataset import SerfDataset, Shot
from .parameters import NuclearSpin, ProbeAxis
from .shots import GAMMA_HZ_PER_NT, Axis, Wanted, why_without_signal

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

TIME = "t_s"
RATE_TOLERANCE = 0.01
MIN_SAMPLES = 16


class ImportedShot(StrictModel):
    """A column of the file, and the field that was commanded along the coils x, y, z."""

    id: Annotated[str, Field(min_length=1)]
    field_nT: tuple[
        Annotated[float, Unit("nT")], Annotated[float, Unit("nT")], Annotated[float, Unit("nT")]
    ]

    @field_validator("id")
    @classmethod
    def not_the_time(cls, name: str) -> str:
        """Refuse the name of the column of times."""
        if name == TIME:
            raise ValueError(f"'{TIME}' is the column of times; give the shot another name")
        return name

    @field_validator("field_nT")
    @classmethod
    def some_field(cls, field_nT: tuple[float, float, float]) -> tuple[float, float, float]:
        """Refuse a shot without a field."""
        if not any(field_nT):
            raise ValueError("all fields are zero; the spins precess only in a field")
        return field_nT


class Conditions(StrictModel):
    """The conditions of a dataset of shots; what decides the geometry has no default."""

    sample_rate_Hz: Annotated[float, Unit("Hz"), Field(gt=0)]
    gyromagnetic_ratio_Hz_per_nT: Annotated[float, Unit("Hz/nT"), Field(gt=0)] = GAMMA_HZ_PER_NT
    nuclear_spin: NuclearSpin
    pump_axis: Axis
    probe_axis: ProbeAxis
    coil_constants: Literal["known", "nominal"]
    mains_frequency_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = None
    shots: Annotated[tuple[ImportedShot, ...], Field(min_length=1)] = Field()

    @field_validator("shots")
    @classmethod
    def each_once_and_with_a_signal(
        cls, shots: tuple[ImportedShot, ...], info: ValidationInfo
    ) -> tuple[ImportedShot, ...]:
        """Refuse a name that stands twice, and a field along pump or probe alone."""
        names = [shot.id for shot in shots]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(f"the shot '{twice[0]}' stands twice")
        lights = info.data.get("pump_axis"), info.data.get("probe_axis")
        for shot in shots:
            if why := why_without_signal(Wanted(shot.id, shot.field_nT).coils, *lights):
                raise ValueError(f"the shot '{shot.id}': {why}")
        return shots


def dataset_of_import(raw: RawDataset) -> SerfDataset:
    """Return the shots of an imported folder; FaultList names file, row and reason."""
    conditions = raw.conditions(Conditions)
    raw.require_files(("shots",))
    table = raw.read_table("shots", (TIME, *(shot.id for shot in conditions.shots)), rising=TIME)
    _check_rate(raw, table, conditions.sample_rate_Hz)
    return SerfDataset(
        shots=[
            Shot(shot.id, np.array(shot.field_nT), table[TIME], table[shot.id])
            for shot in conditions.shots
        ],
        pump_axis=conditions.pump_axis,
        probe_axis=conditions.probe_axis,
        nuclear_spin=conditions.nuclear_spin,
        constants_known=conditions.coil_constants == "known",
        sample_rate_Hz=conditions.sample_rate_Hz,
        gamma_Hz_per_nT=conditions.gyromagnetic_ratio_Hz_per_nT,
        mains_Hz=conditions.mains_frequency_Hz,
    )


def _check_rate(raw: RawDataset, table: Table, rate_Hz: float) -> None:
    """Refuse too few rows, and times that contradict the sample rate."""
    if len(table.lines) < MIN_SAMPLES:
        what = f"{len(table.lines)} rows are too few for a fit; at least {MIN_SAMPLES} are needed"
        raise FaultList([table.fault(-1, TIME, what)])
    interval_s = float(np.median(np.diff(table[TIME])))
    if abs(interval_s * rate_Hz - 1.0) > RATE_TOLERANCE:
        what = (
            f"{rate_Hz:g} Hz contradicts the rows of {table.path.name}, which are "
            f"{interval_s:.6g} s apart, {1.0 / interval_s:.6g} Hz"
        )
        raise FaultList([raw.document.fault(("conditions", "sample_rate"), what)])
