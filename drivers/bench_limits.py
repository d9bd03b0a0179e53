"""What a driver does with the limits of the bench file, whatever it programmes them into."""

from __future__ import annotations

from station.errors import InstrumentError
from station.roles import Place


def limit_of(place: Place, name: str, without_it: str) -> float:
    """Return a limit; InstrumentError, which says what is not done without it, where none is."""
    if name not in place.limits:
        raise InstrumentError(
            place.name,
            "read the bench file",
            f"it gives no limits.{name}",
            f"write it there; {without_it} without it",
        )
    return place.limits[name]


def check_written(place: Place, what: str, value: float, found: float, agrees: float) -> None:
    """Raise InstrumentError where another value reads back than was written."""
    if abs(found - value) > agrees:
        raise InstrumentError(
            place.name,
            f"set {what} to {value:g}",
            f"{found:g} reads back",
            "check that nobody else talks to the controller, then run again",
        )
