"""A gaussmeter: the field at the device."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, runtime_checkable

from station.roles.base import SampledSource
from station.roles.role import TEMPERATURE, Limit, Quantity, Role, Witness
from station.units import parse_as


@runtime_checkable
class Gaussmeter(SampledSource, Protocol):
    """A field meter; columns `instrument_time_s`, `x_T`, `y_T`, `z_T`, NaN what it cannot see."""

    axes: ClassVar[int]
    """How many components of the field it measures at once: 3, or 1 along which its probe is."""

    keeps_readings: ClassVar[bool]
    """Whether readings wait in it until they are drained; else each look brings the newest one."""

    averaging_s: float
    timestamp: str
    """Which instant of the averaging its time stamp means: interval-start, -middle, -end; or
    on-request: the stamp is when the newest average was asked for, which had ended since."""

    def turn_to(self, axis: str) -> None:
        """Measure along `axis` (x, y, z) from now on; returns once the probe stands so."""
        ...

    def start(self, largest_field_mT: float) -> None:
        """Choose the range, begin to buffer readings, and forget older ones."""
        ...


@runtime_checkable
class SeesField(Protocol):
    """A field meter that can be asked whether a coil is off: the components now, by the probe."""

    def field_now_mT(self) -> tuple[float, float, float]:
        """Return x, y, z in mT; NaN what it cannot see, infinite what is beyond its range."""
        ...


def field_of_source_mT(bounds: Mapping[str, float], settings: Mapping[str, Any]) -> float | None:
    """Return the field that a coil supply makes at the bounds of a command; None where unknown."""
    if bounds.get("field_mT") is not None:
        return abs(bounds["field_mT"])
    if bounds.get("current_A") is None or "coil_constant" not in settings:
        return None
    return abs(bounds["current_A"] * parse_as(str(settings["coil_constant"]), "mT/A"))


GAUSSMETER = Role(
    "gaussmeter",
    Gaussmeter,
    limits={"field": Limit("mT", "largest field amplitude a plan may ask for")},
    quantities={
        # Longer than the pause between two looks of a running record, whose reading then serves.
        "field": Quantity("mT", period_s=2.0, magnitude=True, while_on=True),
        "temperature": TEMPERATURE,
    },
    start_samples=lambda source: source.start(largest_field_mT=1.0),
    witness=Witness("mT", "field_now_mT", ("x_T", "y_T", "z_T"), 1e3, field_of_source_mT),
)
