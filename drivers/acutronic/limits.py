"""The bench's limits in an ACUTROL3000: rates, accelerations, trips and positions, read back."""

from __future__ import annotations

from collections.abc import Collection

from drivers.acutronic.line import AclLine
from drivers.bench_limits import check_written, limit_of
from station.errors import InstrumentError
from station.roles import Place

AGREES = 2e-6
TRIP_ABOVE = 1.1
"""The rate at which an axis trips, in the bench's limit; less where the controller ends before."""

RATE, ACCELERATION, TRIP = 0, 1, 5
"""The places of these in the absolute limits, which are also in the order rate, acceleration, jerk,
lowest and highest position, velocity trip."""


def programme(place: Place, line: AclLine, axis: int, continuous: Collection[int]) -> None:
    """Write the limits of a place into one axis and read them back.

    Raises InstrumentError where the bench allows more than the axis is rated for.
    """
    rated = absolute(line, axis)
    for name, unit, where, header in (
        ("rate", "deg/s", RATE, "Rate"),
        ("acceleration", "deg/s^2", ACCELERATION, "Acceleration"),
    ):
        wanted = limit(place, name)
        if wanted > rated[where] + AGREES:
            raise InstrumentError(
                place.name,
                f"limit the {name} of axis {axis} to {wanted:g} {unit}",
                f"the axis ends at {rated[where]:g} {unit}",
                f"lower limits.{name} in the bench file",
            )
        for mode in ("Position", "Rate"):
            write(place, line, f"Limit:{header}", f"{mode},{axis}", wanted)
    trip = min(TRIP_ABOVE * limit(place, "rate"), rated[TRIP])
    write(place, line, "Limit:VelocityTrip", f"{axis}", trip)
    if axis in continuous:
        return
    for name, header in (("angle_low", "LowPosition"), ("angle_high", "HighPosition")):
        if name in place.limits:
            write(place, line, f"Limit:{header}", f"{axis}", place.limits[name])


def absolute(line: AclLine, axis: int) -> list[float]:
    """Return what the maker allows of an axis, six numbers."""
    message = f":Limit:Absolute? {axis}"
    answer = line.query(message)
    try:
        values = [float(text) for text in answer.split(",")]
    except ValueError:
        values = []
    if len(values) < TRIP + 1:
        raise line.odd(message, answer)
    return values


def write(place: Place, line: AclLine, header: str, which: str, value: float) -> None:
    """Set a value and read it back; InstrumentError where another one comes."""
    line.command(f":{header} {which},{value:.6f}")
    (found,) = line.numbers(f":{header}? {which}")
    check_written(place, f"{header} {which}", value, found, AGREES)


def limit(place: Place, name: str) -> float:
    """Return a limit of the bench file; InstrumentError without one."""
    return limit_of(place, name, "the table does not turn")
