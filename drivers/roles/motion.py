"""Roles that turn a device under test."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from drivers.roles.base import Instrument, MadeSafe


@runtime_checkable
class RotaryStage(Instrument, MadeSafe, Protocol):
    """A single-axis table that goes to angles against its own encoder."""

    def programme_limits(self) -> None:
        """Write the bench file's rate and angle limits into the instrument itself."""
        ...

    def is_homed(self) -> bool:
        """Whether the encoder's zero has been found since the stage was switched on."""
        ...

    def home(self) -> None:
        """Begin to look for the encoder's zero; `is_moving` tells when it is found."""
        ...

    def move_to(self, angle_deg: float) -> None:
        """Begin to turn to an absolute angle; returns at once."""
        ...

    def is_moving(self) -> bool:
        """Whether the stage still turns; raises InstrumentError for a fault of the axis."""
        ...

    def angle_deg(self) -> float:
        """Return the encoder's angle in deg."""
        ...
