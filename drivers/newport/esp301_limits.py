"""The bench's limits in a Newport ESP301: rate, acceleration and angles, each read back.

Stages that protect their settings refuse VU and AU (x17) and keep their rating as maximum; what is
used, VA, AC and AG, is the bench's all the same.
"""

from __future__ import annotations

from drivers.bench_limits import check_written, limit_of
from drivers.newport.esp301_line import EspLine
from station.errors import InstrumentError
from station.roles import Place

UNIT_DEGREE = 7
PROTECTED = 17
OUT_OF_RANGE = 1
AGREES = 1e-4
MOVING = (
    ("rate", "deg/s", "VU", ("VA",)),
    ("acceleration", "deg/s^2", "AU", ("AC", "AG")),
)
"""A limit of the bench, its unit, the controller's maximum, and what the controller uses."""


def programme(place: Place, line: EspLine, axis: int) -> None:
    """Write the limits of a place into the controller and read them back.

    Raises InstrumentError where the bench allows more than the stage is rated for.
    """
    line.forget_errors()
    if line.number(f"{axis}SN?") != UNIT_DEGREE:
        write(place, line, axis, "SN", UNIT_DEGREE)
    for name, unit, maximum, headers in MOVING:
        wanted = limit(place, name)
        line.command(f"{axis}{maximum}{wanted:.6g}", but_for=(PROTECTED, OUT_OF_RANGE))
        rating = line.number(f"{axis}{maximum}?")
        if wanted > rating + AGREES:
            raise InstrumentError(
                place.name,
                f"limit the {name} to {wanted:g} {unit}",
                f"the stage ends at {rating:g} {unit}",
                f"lower limits.{name} in the bench file",
            )
        for header in headers:
            write(place, line, axis, header, wanted)
    angles = [
        (header, place.limits[name])
        for header, name in (("SL", "angle_low"), ("SR", "angle_high"))
        if name in place.limits
    ]
    if len(angles) == 2 and angles[0][1] >= line.number(f"{axis}SR?"):
        angles.reverse()  # neither may pass the other on its way
    for header, wanted in angles:
        write(place, line, axis, header, wanted)


def write(place: Place, line: EspLine, axis: int, header: str, value: float) -> None:
    """Set a value and read it back; InstrumentError where another one comes."""
    line.command(f"{axis}{header}{value:.6g}")
    found = line.number(f"{axis}{header}?")
    check_written(place, header, value, found, AGREES)


def limit(place: Place, name: str) -> float:
    """Return a limit of the bench file; InstrumentError without one."""
    return limit_of(place, name, "the stage does not turn")
