"""What a run will command and record, record by record; no instrument is opened to say so."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.method.set_points import SetPoint
from station.method.work import Forecast, Recording

from .check import IMU, POSES_DEG, POWER, RATES, STANDS, TURNTABLE, UP_DEG, axes_of
from .parameters import AXES, NineAxisParameters
from .steps import rest_s, rotate_s, turn_s

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def forecast(parameters: NineAxisParameters, bench: Bench) -> Forecast:
    """Return the set-points of all steps and the rows of sensor and table."""
    return Forecast(
        tuple(set_points(parameters, bench)), recordings(parameters), {TURNTABLE: RATES}
    )


def set_points(parameters: NineAxisParameters, bench: Bench) -> Iterator[SetPoint]:
    """Yield what is commanded of each instrument, in order."""
    by_table = parameters.positioning == "table" and axes_of(bench) is not None
    yield SetPoint("1a", POWER, "on")
    for position in parameters.all_positions:
        if by_table:
            angles_deg = POSES_DEG[position]
            said = ", ".join(f"{one:g} deg" for one in angles_deg)
            words = f"position {position}: outer, middle and inner axis to {said}"
            for angle_deg in dict.fromkeys(angles_deg):
                yield SetPoint("1b", TURNTABLE, words, angle_deg=angle_deg)
        yield SetPoint("1b", IMU, f"position {position}, {STANDS[position]}: record")
    for axis in AXES:
        if by_table:
            middle_deg, inner_deg = UP_DEG[axis]
            words = f"{axis} up: middle and inner axis to {middle_deg:g} deg, {inner_deg:g} deg"
            yield SetPoint("2a", TURNTABLE, words, angle_deg=max(middle_deg, inner_deg))
        for one in parameters.all_turns:
            if one.axis == axis:
                turns = f"{one.turns} turn{'s' if one.turns > 1 else ''}"
                yield SetPoint(
                    "2a", TURNTABLE, f"{one.unit}: {turns}", rate_deg_per_s=abs(one.rate_deg_per_s)
                )
    yield SetPoint("2b", POWER, "off")


def recordings(parameters: NineAxisParameters) -> tuple[Recording, ...]:
    """Return the rows of the sensor and of the table's encoder."""
    turning_s = sum(turn_s(parameters, one) for one in parameters.all_turns)
    recorded_s = rest_s(parameters) + turning_s
    readings = sum(one.dwell_s / one.reading_interval_s for one in parameters.all_turns)
    return (
        Recording(IMU, round(recorded_s * parameters.sample_rate_Hz), recorded_s),
        Recording(TURNTABLE, round(readings), rotate_s(parameters)),
    )
