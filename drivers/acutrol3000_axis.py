"""What the driver of an ACUTROL3000 knows of one axis, and what the bench file says of all."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum

from drivers.acutrol3000_line import FRAMED, PLAIN
from drivers.acutrol3000_turns import TurnCount
from drivers.roles import Place
from station.errors import InstrumentError
from station.units import parse_as

MOST_AXES = 3
ZEROS = ("absolute", "search")


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


@dataclass(frozen=True)
class Settings:
    """The driver's settings, checked."""

    framing: str
    axes: int
    continuous: Collection[int]
    zero: str
    in_position_deg: float
    at_rest: float
    home_within_s: float


def settings_of(place: Place) -> Settings:
    """Return the settings of a bench file; InstrumentError where they are wrong."""
    given = place.settings
    try:
        axes = int(given.get("axes", MOST_AXES))
        continuous = [int(one) for one in given.get("continuous", range(1, axes + 1))]
        settings = Settings(
            str(given.get("framing", FRAMED)),
            axes,
            continuous,
            str(given.get("zero", ZEROS[0])),
            parse_as(given.get("in_position", "0.001 deg"), "deg"),
            parse_as(given.get("at_rest", "0.01 deg/s"), "deg/s"),
            parse_as(given.get("home_within", "120 s"), "s"),
        )
        if not 1 <= axes <= MOST_AXES or not set(continuous) <= set(range(1, axes + 1)):
            raise ValueError(f"axes {axes}, continuous {continuous}")
        if settings.framing not in (FRAMED, PLAIN) or settings.zero not in ZEROS:
            raise ValueError(f"framing {settings.framing}, zero {settings.zero}")
    except (TypeError, ValueError) as error:
        raise InstrumentError(
            place.name,
            "read the bench file",
            f"its settings are wrong ({error})",
            "write axes as 1 to 3, continuous as a list of axes, framing as framed or line, zero "
            "as absolute or search, in_position, at_rest and home_within with their units",
        ) from error
    return settings
