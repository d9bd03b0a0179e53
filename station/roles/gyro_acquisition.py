"""The acquisition of a laser gyro's pulses."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from station.roles.base import SampledSource
from station.roles.role import TEMPERATURE, Role


@runtime_checkable
class GyroAcquisition(SampledSource, Protocol):
    """A pulse counter of laser gyros; columns `sequence`, `counts`, `temperature_degC`."""

    def start(self, sample_interval_s: float, channel: int) -> None:
        """Begin to sample `channel` every `sample_interval_s`."""
        ...

    def stop(self) -> None:
        """End the sampling."""
        ...


GYRO_ACQUISITION = Role(
    "gyro_acquisition",
    GyroAcquisition,
    quantities={"temperature": TEMPERATURE},
    start_samples=lambda source: source.start(sample_interval_s=0.1, channel=1),
    reads_device=True,
)
