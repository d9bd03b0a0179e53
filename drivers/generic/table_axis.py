"""What a turntable's driver knows of one axis, and what the bench file says of all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from drivers.transport.ports import SerialSettings
from station.fields import Degree, DegreePerSecond, Second
from station.roles import need_axis

TURN_DEG = 360.0
LATE_S = 0.6
"""By how much the axis may be earlier or later than the plan: two exchanges and the servo's lag."""

RATE_AGREES = 1e-3
SLACK_DEG = 5.0
MAX_SLACK_DEG = 100.0
"""An angle that is further than this from its plan might be one of another turn."""


class TurnCount:
    """The angle of one axis, counted through every turn, from an encoder that reads the same after.

    Between two readings the axis goes as commanded: at a rate after a ramp, or towards an angle. So
    the turns are known however long nobody looked, as long as the plan is good to half a turn.

    `continuous` False for one that has end stops and no turns to count.

    `lost` says why the turns are no longer known, if so; `reset` begins anew.
    """

    def __init__(self, continuous: bool) -> None:
        self.continuous = continuous
        self.reset()

    def reset(self) -> None:
        """Forget all turns: the next reading is the angle, from -180 deg to 180 deg."""
        self.angle_deg = math.nan
        self.lost = ""
        self._begin_s = self._seen_s = 0.0
        self._from_rate = self._to_rate = 0.0
        self._acceleration, self._brakes_s = 1.0, math.inf
        self._aim_deg: float | None = None
        self._aims_with = 0.0
        self._carried_deg = self._slack_deg = self._fastest = 0.0

    def turns_at(
        self, time_s: float, rate: float, acceleration: float, from_rate: float | None = None
    ) -> None:
        """Go by a plan from now on: to a rate in deg/s, and then at it.

        It begins at the rate of the plan before, unless another one was measured just now.
        """
        self._carry(time_s)
        now_rate = self.planned_rate(time_s) if from_rate is None else from_rate
        self._begin_s, self._from_rate, self._to_rate = time_s, now_rate, rate
        self._acceleration, self._aim_deg, self._brakes_s = acceleration, None, math.inf

    def goes_by(self, time_s: float, by_deg: float, fastest: float, acceleration: float) -> None:
        """Go by an angle from rest: to a rate as fast as may be, and in time to rest again."""
        self._carry(time_s)
        top = math.copysign(min(fastest, math.sqrt(acceleration * abs(by_deg))), by_deg)
        self._begin_s, self._from_rate, self._to_rate = time_s, 0.0, top
        self._acceleration, self._aim_deg = acceleration, None
        self._brakes_s = time_s + (by_deg / top if top else 0.0)

    def aims_at(self, time_s: float, angle_deg: float, fastest: float) -> None:
        """Go towards an angle from now on, less than half a turn away, no faster than a rate."""
        self._carry(time_s)
        self._begin_s, self._from_rate, self._to_rate = time_s, 0.0, 0.0
        self._aim_deg, self._aims_with, self._brakes_s = angle_deg, fastest, math.inf

    def take(self, reading_deg: float, time_s: float) -> float:
        """Return the angle for a reading of the encoder, and remember it."""
        if not self.continuous:
            self.angle_deg = reading_deg
            return reading_deg
        if math.isnan(self.angle_deg):
            self.angle_deg = reading_deg - TURN_DEG * (reading_deg > TURN_DEG / 2)
        else:
            self._carry(time_s)
            expected_deg = self.angle_deg + self._carried_deg
            turns = round((expected_deg - reading_deg) / TURN_DEG)
            self.angle_deg = reading_deg + TURN_DEG * turns
            self._judge(self.angle_deg, expected_deg)
        self._seen_s = time_s
        self._carried_deg = self._slack_deg = self._fastest = 0.0
        return self.angle_deg

    def planned_rate(self, time_s: float) -> float:
        """Return the rate of the plan, in deg/s."""
        if time_s > self._brakes_s:
            rate = self.planned_rate(self._brakes_s)
            lost = min(self._acceleration * (time_s - self._brakes_s), abs(rate))
            return rate - math.copysign(lost, rate)
        change = self._to_rate - self._from_rate
        ramp = min(self._acceleration * max(time_s - self._begin_s, 0.0), abs(change))
        return self._from_rate + math.copysign(ramp, change)

    def _carry(self, time_s: float) -> None:
        """Add what the plan says of the time since the last look."""
        if math.isnan(self.angle_deg):
            self._seen_s = time_s
            return
        if self._aim_deg is None:
            goes_deg = self._travelled(time_s) - self._travelled(self._seen_s)
            rates = [self.planned_rate(self._seen_s), self.planned_rate(time_s)]
            if self._seen_s <= self._brakes_s < math.inf:
                rates.append(self._to_rate)
            self._fastest = max(self._fastest, *map(abs, rates))
            slack_deg = RATE_AGREES * abs(goes_deg)
        else:
            left_deg = self._aim_deg - (self.angle_deg + self._carried_deg)
            most_deg = min(abs(left_deg), self._aims_with * (time_s - self._seen_s))
            goes_deg, slack_deg = math.copysign(most_deg / 2, left_deg), most_deg / 2
        self._carried_deg += goes_deg
        self._slack_deg += slack_deg
        self._seen_s = time_s

    def _travelled(self, time_s: float) -> float:
        """Return how far the plan goes from its begin, deg."""
        if time_s > self._brakes_s:
            rates = self.planned_rate(self._brakes_s), self.planned_rate(time_s)
            braked_s = abs(rates[0] - rates[1]) / self._acceleration
            return self._travelled(self._brakes_s) + 0.5 * sum(rates) * braked_s
        since_s = max(time_s - self._begin_s, 0.0)
        change = self._to_rate - self._from_rate
        ramp_s = min(since_s, abs(change) / self._acceleration)
        ramped = math.copysign(self._acceleration, change) * ramp_s
        return self._from_rate * since_s + ramped * (since_s - 0.5 * ramp_s)

    def _judge(self, angle_deg: float, expected_deg: float) -> None:
        slack_deg = SLACK_DEG + LATE_S * self._fastest + self._slack_deg
        if slack_deg > MAX_SLACK_DEG:
            self.lost = "nobody read the encoder for so long that its turns cannot be counted"
        elif abs(angle_deg - expected_deg) > slack_deg:
            self.lost = (
                f"the encoder reads {angle_deg % TURN_DEG:.3f} deg where about "
                f"{expected_deg % TURN_DEG:.3f} deg was expected, so its turns cannot be counted"
            )


MAX_AXES = 3


class Doing(Enum):
    """What an axis was last commanded."""

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


class AxesSettings(SerialSettings):
    """What the bench file says of a table's axes, and of its controller's line."""

    axes: int = Field(MAX_AXES, ge=1, le=MAX_AXES, description="how many axes it has")
    continuous: tuple[Annotated[int, Field(ge=1, le=MAX_AXES)], ...] | None = Field(
        None, description="the axes that turn for ever, all unless given"
    )
    zero: Literal["absolute", "search"] = Field(
        "absolute", description="`search` where each encoder has to find its zero"
    )
    in_position_deg: Degree = Field(
        0.001, gt=0, le=1, description="how far an axis at rest may be from its angle"
    )
    at_rest_deg_per_s: DegreePerSecond = Field(
        0.01, gt=0, le=1, description="the largest rate of an axis that counts as rest"
    )
    home_within_s: Second = Field(120.0, gt=0, le=3600, description="to find an encoder's zero")

    @field_validator("continuous")
    @classmethod
    def are_there(cls, given: Sequence[int] | None, info: ValidationInfo) -> Sequence[int] | None:
        """Refuse an axis that the table does not have."""
        for axis in given or ():
            need_axis(axis, info.data.get("axes"))
        return given

    @property
    def turns_for_ever(self) -> Sequence[int]:
        """The axes that turn for ever."""
        return range(1, self.axes + 1) if self.continuous is None else self.continuous
