"""The commands by which a supply proves itself: beyond a limit of its own, and cut off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from station.method.set_points import Bounds, Command, Station
from station.roles import ProvesItself

if TYPE_CHECKING:
    from station.instruments.bench import Bench


@dataclass(frozen=True)
class BeyondOwnLimit(Command[float]):
    """More current than a limit that the supply is given for it; the current in A that flows."""

    limit_A: float
    asked_A: float

    def words(self, bench: Bench) -> str:
        """Return limit and current."""
        return f"{self.asked_A:g} A asked for at a limit of its own of {self.limit_A:g} A"

    def bounds(self, bench: Bench) -> Bounds:
        """Return what flows where the limit does not act."""
        return {"current_A": self.asked_A}

    def apply(self, station: Station, prepared: float | None) -> float:
        """Ask for it and return to zero."""
        supply = station.role(self.instrument, ProvesItself)
        return supply.current_beyond_limit_A(self.limit_A, self.asked_A)


@dataclass(frozen=True)
class CutOff(Command[None]):
    """The output off at once while a small current flows: no ramp hides one that stays on."""

    at_A: float

    def words(self, bench: Bench) -> str:
        """Return the current at which it is cut off."""
        return f"cut off at {self.at_A:g} A"

    def bounds(self, bench: Bench) -> Bounds:
        """Return the current."""
        return {"current_A": self.at_A}

    def apply(self, station: Station, prepared: None) -> None:
        """Go to the current within the slew limit, then switch the output off."""
        supply = station.role(self.instrument, ProvesItself)
        supply.switch_on()
        supply.ramp_to(self.at_A)
        supply.cut_off()
