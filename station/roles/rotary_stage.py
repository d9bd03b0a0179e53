"""A rotary stage of one axis."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from station.roles.base import Instrument, MadeSafe
from station.roles.role import Limit, Quantity, Role, SafeState


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
        """Begin to look for the encoder's zero; `is_moving` says when it is reached."""
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


ROTARY_STAGE = Role(
    "rotary_stage",
    RotaryStage,
    limits={
        "rate": Limit("deg/s", "largest rate", needed=True),
        "acceleration": Limit("deg/s^2", "largest angular acceleration", needed=True),
        "angle_low": Limit("deg", "lowest angle", signed=True),
        "angle_high": Limit("deg", "highest angle", signed=True),
    },
    quantities={
        "rate": Quantity("deg/s", period_s=0.2, magnitude=True, while_on=True, limit="rate"),
        "angle": Quantity("deg", period_s=0.2, while_on=True),
        "motion": Quantity(states=("moving", "at-rest"), energised="moving"),
    },
    safe_state=SafeState(
        "decelerated to rest; the motor stays on and holds a load that may be out of balance",
        "motion done, and two readings of the encoder that agree",
        rank=30,
    ),
)
