"""An axis of an Ideal Aerosmith rate table as a rotary stage, which goes to angles alone.

Commands and their sources:
    PPO, HOM, STO, ACL50 - angle, search for the zero, stop, acceleration - the rows of
        ideal-aerosmith - confirmed
    RMO10, VEL20, PVE, SRV1, SRV? - move, rate, measured rate, motor - the rows of ideal-aerosmith -
        not confirmed
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from pydantic import Field, ValidationInfo, field_validator

from drivers.generic.table_axis import MAX_AXES
from drivers.ideal_aerosmith.axes import AtlSettings
from drivers.ideal_aerosmith.rate_table import IdealAerosmithTable
from drivers.transport.exchanges import Repeatable
from station.roles import Driver, Identity, Place, SafetyReading, need_axis

Look = Callable[[Any], float | str | None]


def through(read: Look) -> Look:
    """Return what reads a quantity of the table for its stage."""
    return lambda stage: read(stage._of)


class IdealAerosmithStage(Driver):
    """A rotary stage that turns to absolute angles once its encoder's zero was found.

    Limits: `rate` deg/s and `acceleration` deg/s^2; `angle_low` and `angle_high` deg, which the
    driver alone holds.
    """

    class Settings(AtlSettings):
        """The table, and which axis of it is the stage."""

        axis: int = Field(1, ge=1, le=MAX_AXES, description="the axis that is the stage")

        @field_validator("axis")
        @classmethod
        def is_there(cls, axis: int, info: ValidationInfo) -> int:
            """Refuse an axis that the table does not have."""
            need_axis(axis, info.data.get("axes"))
            return axis

    without_limits = "the stage does not turn"
    identifies_on: ClassVar[str] = "socket"
    repeatable: ClassVar[Repeatable] = IdealAerosmithTable.repeatable

    def __init__(self, place: Place) -> None:
        self.place = place
        self._axis = self.Settings.of(place).axis
        self._of = IdealAerosmithTable(place)
        self._line = self._of._line

    def identify(self) -> Identity:
        """Return that a table answers; see there."""
        return self._of.identify()

    def programme_limits(self) -> None:
        """Write acceleration and rate into the controller, and read them back."""
        self._of.programme_limits()

    def is_homed(self) -> bool:
        """Whether the encoder's zero was found, and the motor has been on ever since."""
        return self._of.is_homed(self._axis)

    def home(self) -> None:
        """Switch the motor on and begin to look for the encoder's zero."""
        self._of.home(self._axis)

    def move_to(self, angle_deg: float) -> None:
        """Begin to turn to an absolute angle of the encoder; returns at once."""
        self._of.move_to(self._axis, angle_deg)

    def is_moving(self) -> bool:
        """Whether the stage still turns; raises InstrumentError for a fault of the axis."""
        return self._of.is_moving(self._axis)

    def angle_deg(self) -> float:
        """Return the encoder's angle; raises where it stands elsewhere than it was sent."""
        return self._of.angle_deg(self._axis)

    def make_safe(self, deadline_s: float) -> None:
        """Brake with the programmed acceleration, and wait for rest; the motor stays on."""
        self._of.make_safe(deadline_s)

    def last_attempt(self) -> None:
        """Stop every axis, whatever comes back."""
        self._of.last_attempt()

    def await_rest(self, deadline_s: float) -> None:
        """Wait until the stage has braked, if it heard."""
        self._of.await_rest(deadline_s)

    def read_safety(self) -> SafetyReading:
        """Read back that it does not turn, by rate and by two angles."""
        return self._of.read_safety()

    quantities: ClassVar[Mapping[str, Look]] = {
        name: through(read) for name, read in IdealAerosmithTable.quantities.items()
    }
