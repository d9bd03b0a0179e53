"""Power of the device under test, switched by the operator's hand on request.

Commands and their sources:
    dut-power-on, dut-power-off - what the operator is asked for - this project's prompts -
        confirmed
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from station.roles import Driver, Identity, Place


class OperatorPower(Driver):
    """A person at the switch; each act is a prompt with a stable id."""

    prompts: ClassVar[Mapping[str, str]] = {
        "dut-power-on": "Switch the device under test on.",
        "dut-power-off": "Switch the device under test off.",
    }
    """Every act this driver may ask for, so that a run can be checked before it begins."""

    def __init__(self, place: Place) -> None:
        self.place = place

    def identify(self) -> Identity:
        """Return that a person stands here; there is no line to ask."""
        return Identity("", "operator", "", "")

    def switch_on(self) -> None:
        """Ask for the device to be switched on."""
        self.place.ask("dut-power-on", self.prompts["dut-power-on"])

    def switch_off(self) -> None:
        """Ask for the device to be switched off; neither safe state nor results wait for it."""
        self.place.ask_at_the_end("dut-power-off", self.prompts["dut-power-off"])

    def close(self) -> None:
        """Do nothing: there is no line."""
