"""The supply of the device under test."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from station.roles.base import Instrument
from station.roles.role import OUTPUT, Quantity, Role


@runtime_checkable
class DutPower(Instrument, Protocol):
    """The supply of the device under test."""

    def switch_on(self) -> None:
        """Switch the device on."""
        ...

    def switch_off(self) -> None:
        """Switch the device off; where a person does that, ask for it `at_the_end`."""
        ...


DUT_POWER = Role(
    "dut_power",
    DutPower,
    quantities={
        "voltage": Quantity("V", magnitude=True),
        "current": Quantity("A", magnitude=True),
        "output": OUTPUT,
    },
)
