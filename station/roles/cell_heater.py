"""The oven of a vapour cell: a temperature controller with its heater and its thermometer."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol, runtime_checkable

from station.roles.base import Instrument, MadeSafe
from station.roles.role import OUTPUT, TEMPERATURE, Limit, Quantity, Role, SafeState


@runtime_checkable
class CellHeater(Instrument, MadeSafe, Protocol):
    """A heater under control; temperatures in degC are those of the sensor at the cell."""

    def programme_limits(self) -> None:
        """Write the bench file's highest temperature into the controller itself."""
        ...

    def switch_on(self) -> None:
        """Let the heater control, with the present temperature as set-point."""
        ...

    def ramp_to(self, temperature_degC: float, rate_K_per_min: float) -> None:
        """Begin a ramp of the set-point from where it stands; returns at once."""
        ...

    def is_ramping(self) -> bool:
        """Whether the set-point is still on its way."""
        ...

    def temperature_degC(self) -> float:
        """Return the temperature of the cell."""
        ...

    def set_point_degC(self) -> float:
        """Return the set-point that is controlled to now."""
        ...

    def power_percent(self) -> float:
        """Return the heater's output, in percent of the most that its range gives."""
        ...


CELL_HEATER = Role(
    "cell_heater",
    CellHeater,
    limits={
        "temperature_low": Limit("degC", "lowest temperature", signed=True),
        "temperature_high": Limit("degC", "highest temperature", needed=True, signed=True),
        "temperature_slew": Limit("degC/min", "fastest change of temperature", needed=True),
    },
    quantities={
        "temperature": replace(TEMPERATURE, limit="temperature_high"),
        "power": Quantity("%", period_s=10.0),
        "output": OUTPUT,
    },
    safe_state=SafeState("the heater off", "its range off, and no power at the output", rank=65),
)
