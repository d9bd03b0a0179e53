"""What can be seen of a Watlow controller at any time: air, output, door, and its complaints."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from drivers.transport.modbus_line import ModbusLine, RegisterLine
from station.roles import Driver, Place, published, quantity

SENSIBLE_DEGC = (-200.0, 500.0)


class WatlowSight(Driver, ABC):
    """A controller as an interlock sees it; `door_register` is the input of the door, if any."""

    input_on: int
    """What a digital input reads while it is on."""

    def __init__(self, place: Place, line: ModbusLine, door_register: int | None) -> None:
        self.place = place
        self._line = line
        self._door_register = door_register

    def open_contacts(self) -> tuple[str, ...]:
        """Return `door` where it is open, and each alarm and limit that is on."""
        contacts = (
            *(["door"] if self._door_is_closed() is False else ()),
            *self._troubles(self._line.patient),
        )
        self.place.publish("chain", "open" if contacts else "closed")
        return contacts

    @abstractmethod
    def _step(self) -> None:
        """Put the set-point of a ramp where it belongs by now."""

    @abstractmethod
    def _process_degC(self, line: RegisterLine) -> float:
        """Return the process value."""

    @abstractmethod
    def _output(self, line: RegisterLine) -> tuple[bool, float]:
        """Return whether the control is on, and the power in percent."""

    @abstractmethod
    def _troubles(self, line: RegisterLine) -> list[str]:
        """Return what the controller complains of, in words."""

    @quantity("door", states=("closed", "open"))
    def _door_is_closed(self) -> bool | None:
        """Return what is known of the door, None where no input is wired to it."""
        if self._door_register is None:
            return None
        return self._line.patient.read(self._door_register) == [self.input_on]

    @quantity("chain", states=("closed", "open"))
    def _chain_is_closed(self) -> bool:
        return not self.open_contacts()

    @quantity("output", states=("on", "off"))
    def _is_on(self) -> bool:
        return self._output(self._line.patient)[0]

    @published("temperature", "degC")
    def _air(self, line: RegisterLine) -> float:
        air_degC = self._process_degC(line)
        if not SENSIBLE_DEGC[0] <= air_degC <= SENSIBLE_DEGC[1]:
            raise self.error(
                "read the temperature",
                f"its process value reads {air_degC:g} degC",
                "look at the controller's panel, and at the sensor and its cable",
            )
        return air_degC

    @quantity("temperature", "degC")
    def _air_now(self) -> float:
        self._step()
        return self._air(self._line.patient)

    wired_by: ClassVar = {"door": "door"}
