"""What the driver of an ACUTROL3000 knows of one axis, and what the bench file says of all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from drivers.acutronic.turns import TurnCount
from drivers.transport.serial_port import SerialSettings
from station.fields import Degree, DegreePerSecond, Second

MOST_AXES = 3


class Doing(Enum):
    """What an axis was last told."""

    NOTHING = "nothing"
    CLOSING = "close its servo"
    SEARCHING = "find its encoder's zero"
    STOPPING = "stop"
    POSITIONING = "go to an angle"
    TURNING = "turn at a rate"


MOVES = (Doing.SEARCHING, Doing.STOPPING, Doing.POSITIONING, Doing.TURNING)


@dataclass
class AxisState:
    """One axis: its turns, its task and until when it must be done, its mode as last verified."""

    number: int
    count: TurnCount
    homed: bool = False
    doing: Doing = Doing.NOTHING
    target_deg: float | None = None
    step_deg: float = math.nan
    rate_demand: float = 0.0
    at_rate: bool = False
    mode: str = ""
    rate: float = 0.0
    until_s: float = math.inf

    def begins(self, doing: Doing, until_s: float) -> None:
        """Begin a task."""
        self.doing, self.until_s, self.at_rate = doing, until_s, False

    def forgets(self) -> None:
        """Have no task, and no zero that could be relied on."""
        self.homed = self.at_rate = False
        self.doing, self.target_deg, self.mode = Doing.NOTHING, None, ""


class AclSettings(SerialSettings):
    """What the bench file says of a table and its controller."""

    framing: Literal["framed", "line"] = Field(
        "framed", description="whether answers begin with error code and length, or are plain lines"
    )
    axes: int = Field(MOST_AXES, ge=1, le=MOST_AXES, description="how many axes it has")
    continuous: tuple[Annotated[int, Field(ge=1, le=MOST_AXES)], ...] | None = Field(
        None, description="the axes that turn for ever, all unless given"
    )
    zero: Literal["absolute", "search"] = Field(
        "absolute", description="`search` where each encoder has to find its zero"
    )
    in_position_deg: Degree = Field(
        0.001, gt=0, description="how far an axis at rest may be from its angle"
    )
    at_rest_deg_per_s: DegreePerSecond = Field(
        0.01, gt=0, description="the largest rate of an axis that counts as rest"
    )
    home_within_s: Second = Field(120.0, gt=0, description="to find an encoder's zero")

    @field_validator("continuous")
    @classmethod
    def are_there(cls, given: Sequence[int] | None, info: ValidationInfo) -> Sequence[int] | None:
        """Refuse an axis that the table does not have."""
        axes = info.data.get("axes", MOST_AXES)
        if beyond := [one for one in given or () if one > axes]:
            raise ValueError(f"there is no axis {beyond[0]}; the table's axes are 1 to {axes}")
        return given

    @property
    def turns_for_ever(self) -> Sequence[int]:
        """The axes that turn for ever."""
        return range(1, self.axes + 1) if self.continuous is None else self.continuous
