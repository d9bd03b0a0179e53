"""What the table's part commands and records.

The sensor stands as in a nine-axis calibration: with all axes at zero X points north along the
inner axis, Y west and Z up along the outer one. A positive turn of the outer axis is clockwise
seen from above; one of the inner axis lets what was west go up, one of the middle what was north.
A navigator stands with x north, y east and z down; its axes are reckoned as X, -Y and -Z.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station import registry
from station.method.commands import Power
from station.method.motion import AxisAtRate, AxisTo
from station.method.set_points import Bounded
from station.method.work import Rows, Work, on_the_way
from station.procedure import Problem, RecordUse
from station.roles.turntable import unnamed_axes

from .parameters import (
    AXES,
    HALF_TURNS,
    HOME,
    TURN_DEG,
    TURNED_UNIT,
    Angles,
    MotionParameters,
    TableTurn,
    level_unit,
)

if TYPE_CHECKING:
    from station.instruments.bench import Bench

TURNTABLE = "turntable"
IMU, NAVIGATOR = "imu", "navigator"
POWER = "dut_power"
ANGLE = (TURNTABLE, "angle", TURN_DEG, "deg")
"""What the table's calibration record states."""
MOTION = ("parameters", "motion")
OVERSHOOT_DEG = 20.0
"""An axis is stopped at the first reading beyond its angle, and brakes from there."""
MOVE_S, SETTLING_S, HOMING_S = 8.0, 3.0, 20.0
NAVIGATOR_HZ = 10.0
ALIGNS_S = 300.0
"""What an alignment usually takes."""


def instruments(parameters: MotionParameters) -> tuple[str, ...]:
    """Return the bench instances that are commissioned."""
    return (TURNTABLE, parameters.device, POWER)


def moves(angles_deg: Angles, text: str) -> tuple[AxisTo, ...]:
    """Return the commands that bring outer, middle and inner axis to angles."""
    return tuple(
        AxisTo(TURNTABLE, axis, text, angle_deg=angle_deg, decided_by=MOTION)
        for axis, angle_deg in zip(AXES, angles_deg, strict=True)
    )


def begin_of(turn: TableTurn) -> tuple[AxisTo, ...]:
    """Return the commands that bring the table where a turn begins."""
    return moves((0.0, turn.middle_deg, 0.0), f"{turn.unit}: where it begins")


def spin(turn: TableTurn, sense: int) -> AxisAtRate:
    """Return the command of a turn in one sense."""
    rate = sense * turn.rate_deg_per_s
    return AxisAtRate(TURNTABLE, turn.axis, turn.unit, None, rate, decided_by=MOTION)


def turn_s(parameters: MotionParameters, turn: TableTurn) -> float:
    """Return the least bench time in s of a turn there and back, with its rests."""
    return 3.0 * parameters.rest_s + 2.0 * turn.angle_deg / turn.rate_deg_per_s


def work(parameters: MotionParameters) -> Iterator[Work]:
    """Yield the turns, then the levels, the last of them with the sensor turned on its plate."""
    aligns_s = ALIGNS_S if parameters.device == NAVIGATOR else 0.0
    begin = (Power(POWER, True), *moves(HOME, "all axes to zero"))
    way, settling = on_the_way(MOVE_S), on_the_way(2.0 * SETTLING_S)
    yield Work("M1", None, begin, (), decided=on_the_way(HOMING_S + aligns_s))
    for turn in parameters.turns:
        certain_s = turn_s(parameters, turn)
        duration_s = certain_s + 2.0 * SETTLING_S
        reach_deg = turn.angle_deg + OVERSHOOT_DEG
        commands = (
            *begin_of(turn),
            *(
                Bounded(
                    TURNTABLE,
                    f"{turn.unit} by {turn.angle_deg:g} deg",
                    within={"angle_deg": angle_deg},
                    decided_by=MOTION,
                )
                for angle_deg in (-OVERSHOOT_DEG, reach_deg)
            ),
            spin(turn, +1),
            spin(turn, -1),
        )
        rows = (
            Rows(parameters.device, duration_s, duration_s * parameters.sample_rate_Hz),
            Rows(TURNTABLE, duration_s, 2.0 * duration_s),
        )
        step = "M1" if turn in parameters.small_turns else "M2"
        yield Work(step, turn.unit, commands, rows, certain_s, decided=way + settling)
    rest_s = parameters.rest_s
    at_rest = (Rows(parameters.device, rest_s, rest_s * parameters.sample_rate_Hz),)
    for angles_deg in HALF_TURNS:
        unit = level_unit(angles_deg)
        yield Work("M3", unit, moves(angles_deg, unit), at_rest, rest_s, decided=way)
    yield Work(
        "M3", None, moves(HOME, "all axes to zero"), (), decided=on_the_way(MOVE_S + aligns_s)
    )
    yield Work("M3", TURNED_UNIT, (), at_rest, rest_s)
    yield Work("M3", None, (Power(POWER, False),))


def records(parameters: MotionParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the uncertainty of an angle."""
    return (RecordUse(*ANGLE, needed=False, corrected=False),)


def check(parameters: MotionParameters, bench: Bench) -> Iterator[Problem]:
    """Yield axes that the bench file does not name, and a rate that the sensor does not have."""
    table, sensor = (bench.instruments.get(name) for name in (TURNTABLE, parameters.device))
    if table is not None:
        for what in unnamed_axes(TURNTABLE, table.settings):
            yield Problem(("parameters", "checks"), f"{what}, or leave out motion")
    if sensor is None or registry.why_not(registry.DRIVERS, sensor.driver):
        return
    if parameters.device == NAVIGATOR and parameters.sample_rate_Hz > NAVIGATOR_HZ:
        yield Problem((*MOTION, "sample_rate"), f"a navigator outputs {NAVIGATOR_HZ:g} Hz at most")
    driver = registry.load(registry.DRIVERS, sensor.driver)
    if refusal := getattr(driver, "rates_said", lambda rate_Hz: "")(parameters.sample_rate_Hz):
        yield Problem((*MOTION, "sample_rate"), refusal)
