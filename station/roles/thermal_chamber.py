"""A thermal chamber about the device."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol, runtime_checkable

from station.roles.base import Instrument, MadeSafe
from station.roles.role import CONTACT, OUTPUT, TEMPERATURE, Limit, Role, SafeState


@runtime_checkable
class ThermalChamber(Instrument, MadeSafe, Protocol):
    """A chamber with a heater and a compressor; temperatures in degC are those of its air."""

    def programme_limits(self) -> None:
        """Write the bench file's temperature limits into the controller itself."""
        ...

    def switch_on(self) -> None:
        """Let heater and compressor control, with the present temperature as set-point."""
        ...

    def set_temperature(self, temperature_degC: float) -> None:
        """Go to a temperature as fast as the chamber can; returns at once."""
        ...

    def ramp_to(self, temperature_degC: float, rate_K_per_min: float) -> None:
        """Begin a ramp of the set-point from where it stands; returns at once."""
        ...

    def hold(self) -> None:
        """End a ramp and hold the set-point where it stands."""
        ...

    def is_ramping(self) -> bool:
        """Whether the set-point is still on its way; what the driver steps, it steps here."""
        ...

    def temperature_degC(self) -> float:
        """Return the process value."""
        ...

    def set_point_degC(self) -> float:
        """Return the set-point that is controlled to now."""
        ...


THERMAL_CHAMBER = Role(
    "thermal_chamber",
    ThermalChamber,
    limits={
        "temperature_low": Limit("degC", "lowest temperature", needed=True, signed=True),
        "temperature_high": Limit("degC", "highest temperature", needed=True, signed=True),
        "temperature_slew": Limit("degC/min", "fastest change of temperature"),
    },
    quantities={
        "temperature": replace(TEMPERATURE, limit="temperature_high"),
        "door": CONTACT,
        "chain": CONTACT,
        "output": OUTPUT,
    },
    safe_state=SafeState(
        "heater and compressor off", "control mode off, and no power at the output", rank=70
    ),
)
