"""A gaussmeter: the field at the device."""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

from station.roles.base import SampledSource
from station.roles.role import TEMPERATURE, Quantity, Role


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


GAUSSMETER = Role(
    "gaussmeter",
    Gaussmeter,
    quantities={
        # Longer than the pause between two looks of a running record, whose reading then serves.
        "field": Quantity("mT", period_s=2.0, magnitude=True, while_on=True),
        "temperature": TEMPERATURE,
    },
    start_samples=lambda source: source.start(largest_field_mT=1.0),
)
