"""The supply of the device under test."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from station.roles.base import Instrument
from station.roles.role import OUTPUT, Limit, Quantity, Role, SafeState


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
    limits={
        "current": Limit("A", "largest current of the device, at which its supply cuts it off"),
        "voltage": Limit("V", "largest voltage of the device, above which its supply cuts it off"),
    },
    quantities={
        "voltage": Quantity("V", magnitude=True, limit="voltage"),
        "current": Quantity("A", period_s=0.2, magnitude=True, while_on=True, limit="current"),
        "output": OUTPUT,
    },
    safe_state=SafeState(
        "the device off, where a supply with an output of its own feeds it",
        "the output state and the measured current",
        rank=80,
    ),
)
