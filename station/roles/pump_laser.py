"""The pump light of a vapour cell, and its shutter."""

from __future__ import annotations

from typing import Annotated, Protocol, runtime_checkable

from pydantic import Field

from station.fields import Unit
from station.roles.base import DriverSettings, Instrument, MadeSafe
from station.roles.role import OUTPUT, TEMPERATURE, Role, SafeState


class LightSettings(DriverSettings):
    """What a bench file says of the pump light, whatever shuts it off."""

    trigger_to_dark_s: Annotated[float | None, Unit("s")] = Field(
        None, ge=0, description="from the trigger's edge until no light passes; by a photodiode"
    )


@runtime_checkable
class PumpLaser(Instrument, MadeSafe, Protocol):
    """The shutter of the pump light: closed is safe."""

    def open_shutter(self) -> None:
        """Let the light through, and prove it."""
        ...

    def close_shutter(self) -> None:
        """Block the light, and prove it."""
        ...

    def follow_trigger(self) -> None:
        """Let the light through until the bench's trigger, and again when the trigger goes off."""
        ...

    def is_open(self) -> bool:
        """Whether the light passes."""
        ...


PUMP_LASER = Role(
    "pump_laser",
    PumpLaser,
    settings=LightSettings,
    quantities={"temperature": TEMPERATURE, "output": OUTPUT},
    safe_state=SafeState("the shutter closed", "the blade's own sensor", rank=50),
)
