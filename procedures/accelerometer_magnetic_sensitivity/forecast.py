"""What a run will command and record, point by point; no instrument is opened to say so."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.method.set_points import SetPoint
from station.method.work import Forecast, Recording
from station.units import UnitError, parse_as

from .check import ANGLES, GAUSSMETER, LARGEST_FIELD, MULTIMETER, POWER, STAGE, SUPPLY, THERMOMETER
from .durations import points_s
from .measuring import burst_s, group_by_angle
from .parameters import AccelerometerParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench

DEFAULT_AVERAGING_S = 0.1


def forecast(parameters: AccelerometerParameters, bench: Bench) -> Forecast:
    """Return the set-points of steps (2) to (7) and the rows of every source."""
    return Forecast(
        tuple(set_points(parameters, bench)),
        recordings(parameters, bench),
        {SUPPLY: LARGEST_FIELD, STAGE: ANGLES},
    )


def set_points(parameters: AccelerometerParameters, bench: Bench) -> Iterator[SetPoint]:
    """Yield what is commanded of each instrument, in order; the fields once for each angle."""
    constant = str(bench.instruments[SUPPLY].settings["coil_constant"])
    mT_per_A = parse_as(constant, "mT/A")
    yield SetPoint("(2)", STAGE, "look for the encoder's zero")
    yield SetPoint("(2)", MULTIMETER, f"{parameters.readings} readings of {parameters.nplc:g} NPLC")
    yield SetPoint("(2)", POWER, "on")
    # The coil takes many minutes to warm: what heats it is the mean over all points.
    levels_mT = parameters.field_levels_mT
    rms_mT = (sum(field**2 for field in levels_mT) / len(levels_mT)) ** 0.5
    for number, group in enumerate(group_by_angle(parameters.points)):
        step = ("(3)", "(6)", "(7)")[min(number, 2)]
        fields_mT = [point.field_mT for point in group]
        largest_mT = max(fields_mT, key=abs)
        angle_deg = group[0].angle_deg
        words = f"{group[0].plane}: turn to {angle_deg:g} deg"
        yield SetPoint(step, STAGE, words, angle_deg=angle_deg)
        yield SetPoint(
            step,
            SUPPLY,
            f"{', '.join(f'{field:g}' for field in fields_mT)} mT, "
            f"up to {abs(largest_mT) / mT_per_A:.3g} A",
            field_mT=abs(largest_mT),
            current_A=abs(largest_mT) / mT_per_A,
            rms_current_A=rms_mT / mT_per_A,
        )
    yield SetPoint("(7)", SUPPLY, "0 A, output off")
    yield SetPoint("(7)", POWER, "off")


def recordings(parameters: AccelerometerParameters, bench: Bench) -> tuple[Recording, ...]:
    """Return the rows of voltmeter, thermometer, stage and gaussmeter."""
    points = len(parameters.points)
    whole_s = points_s(parameters, parameters.points)
    try:
        averaging_s = parse_as(bench.instruments[GAUSSMETER].settings.get("averaging"), "s")
    except UnitError:
        averaging_s = DEFAULT_AVERAGING_S
    field_rows = round(points * (burst_s(parameters) + 1.0) / averaging_s)
    rows = [
        Recording(MULTIMETER, points * parameters.readings, whole_s),
        Recording(STAGE, points, whole_s),
        Recording(GAUSSMETER, field_rows, whole_s),
    ]
    if parameters.temperature:
        rows.append(Recording(THERMOMETER, points, whole_s))
    return tuple(rows)
