"""What a run of a plan commands and records, and why a plan cannot run on a bench.

The steps apply the commands that are declared here; forecast, limits and durations come from them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

from station import registry
from station.method.commands import Angle, CoilOff, Homing, MeterRange, Power, SteadyField
from station.method.work import Duration, Rows, Work, on_the_way
from station.procedure import Problem, RecordUse

from .parameters import AccelerometerParameters, Point

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.roles import Multimeter

SUPPLY = "coil_supply.dc"
GAUSSMETER = "gaussmeter"
MULTIMETER = "multimeter"
THERMOMETER = "thermometer"
STAGE = "rotary_stage"
POWER = "dut_power"
LARGEST_FIELD = ("parameters", "largest_field")
ANGLES = ("parameters", "angles")
LARGEST_G = 1.1
"""What the voltmeter's first range must hold, in the scale factor's units of 1 g."""
FULL_TURN_DEG = 360.0
LOOK_S = 0.25
FIELD_LOOK_S = 0.5
MAX_RANGES = 3
MAX_LOOK_S = 2.0
HOMING_S, TURN_S, RAMP_S = 10.0, 0.75, 0.4
RAMP_MT_PER_S, TURN_DEG_PER_S = 25.0, 20.0
"""A supply of 5 A/s at a coil of 5 mT/A; a stage of the usual rate."""
DEGAUSS_STEPS, DEGAUSS_RATIO, DEGAUSS_HOLD_S = 12, 0.65, 0.5
FIELD_ROWS_S = 1.0
"""So much longer than a burst the field is recorded."""


def instruments(parameters: AccelerometerParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    needed = (SUPPLY, GAUSSMETER, MULTIMETER, STAGE, POWER)
    return (*needed, THERMOMETER) if parameters.temperature else needed


def first_range(parameters: AccelerometerParameters) -> MeterRange:
    """Return how the voltmeter is read until it is overloaded."""
    largest_V = LARGEST_G * parameters.scale_factor_V_per_g
    return MeterRange(MULTIMETER, largest_V, parameters.nplc, parameters.readings)


def angle_of(point: Point) -> Angle:
    """Return the angle of a point."""
    return Angle(STAGE, point.angle_deg, point.plane, decided_by=ANGLES)


def rms_field_mT(parameters: AccelerometerParameters) -> float:
    """Return the field whose current heats the coil: it takes many minutes to warm."""
    levels_mT = parameters.field_levels_mT
    return float((sum(level**2 for level in levels_mT) / len(levels_mT)) ** 0.5)


def field_of(field_mT: float, rms_mT: float) -> SteadyField:
    """Return a field at the device, heating the coil as the whole plan does."""
    return SteadyField(SUPPLY, field_mT, rms_mT, decided_by=LARGEST_FIELD)


def work(parameters: AccelerometerParameters) -> Iterator[Work]:
    """Yield the set-up, each point with its angle and field, and the end.

    Steps (3) and (4) are one set of data, declared with the first; (5) turns to the second.
    """
    rms_mT = rms_field_mT(parameters)
    setting_up = (Homing(STAGE), first_range(parameters), Power(POWER, True))
    setting_up_s = parameters.warm_up_s + degauss_s(parameters)
    way = on_the_way(HOMING_S + degauss_ramps_s(parameters))
    yield Work("(2)", None, setting_up, duration_s=setting_up_s, decided=way)
    if parameters.degauss and parameters.largest_field_mT > max(
        abs(level) for level in parameters.field_levels_mT
    ):  # no point goes as far as what takes the remanence away
        yield Work("(2)", None, (field_of(parameters.largest_field_mT, rms_mT),))
    before: Point | None = None
    for number, group in enumerate(group_by_angle(parameters.points)):
        declared = ("(3)", "(6)", "(7)")[min(number, 2)]
        for place, point in enumerate(group):
            turning_s = turn_s(before, point)
            still_s, measuring = point_s(parameters, before, point)
            measuring_s = still_s + measuring.expected_s
            commands = (field_of(point.field_mT, rms_mT),)
            yield Work(
                declared,
                point.unit,
                commands if place else (angle_of(point), *commands),
                rows_of(parameters, turning_s + measuring_s),
            )
            turning = "(5)" if number == 1 else declared
            yield Work(turning, point.unit, decided=on_the_way(turning_s))
            measured = "(4)" if number == 0 and place else declared
            yield Work(measured, point.unit, duration_s=still_s, decided=measuring)
            before = point
    off = (CoilOff(SUPPLY), Power(POWER, False))
    largest_mT = max(abs(level) for level in parameters.field_levels_mT)
    yield Work("(7)", None, off, decided=on_the_way(RAMP_S + largest_mT / RAMP_MT_PER_S))


def rows_of(parameters: AccelerometerParameters, whole_s: float) -> tuple[Rows, ...]:
    """Return the rows of a point that takes `whole_s`."""
    rows = (
        Rows(MULTIMETER, whole_s, parameters.readings),
        Rows(STAGE, whole_s, 1),
        Rows(GAUSSMETER, whole_s, read_s=burst_s(parameters) + FIELD_ROWS_S),
    )
    return (*rows, Rows(THERMOMETER, whole_s, 1)) if parameters.temperature else rows


def burst_s(parameters: AccelerometerParameters) -> float:
    """Return the bench time in s of one burst: auto-zero doubles the integration time."""
    return 2.0 * parameters.readings * parameters.nplc / 50.0


def point_s(
    parameters: AccelerometerParameters, before: Point | None, point: Point
) -> tuple[float, Duration]:
    """Return the time of a point beside the turn, dwell and burst, and what is decided on the way.

    The field settles when its readings agree, and a burst is taken again where it was overloaded.
    `before` is the point before it; None where the bench stands at its zeros.
    """
    still_s, way_mT = parameters.dwell.at_least_s + burst_s(parameters), abs(point.field_mT)
    way_s = RAMP_S
    if before is not None and before.plane == point.plane:
        way_mT = abs(point.field_mT - before.field_mT)
    elif before is not None:
        still_s += degauss_s(parameters)
        way_s += abs(before.field_mT) / RAMP_MT_PER_S + degauss_ramps_s(parameters)
    waits_s = parameters.dwell.at_most_s - parameters.dwell.at_least_s
    bursts_s = (MAX_RANGES - 1) * burst_s(parameters) + MAX_RANGES * MAX_LOOK_S
    looks = Duration(FIELD_LOOK_S + LOOK_S, 0.0, waits_s + 2.0 * FIELD_LOOK_S + bursts_s)
    return still_s, looks + on_the_way(way_s + way_mT / RAMP_MT_PER_S)


def degauss_s(parameters: AccelerometerParameters) -> float:
    """Return how long the alternating, falling field is held that takes the remanence away."""
    return DEGAUSS_STEPS * DEGAUSS_HOLD_S if parameters.degauss else 0.0


def degauss_ramps_s(parameters: AccelerometerParameters) -> float:
    """Return how long the ramps between its steps are expected to take, and that back to zero."""
    if not parameters.degauss:
        return 0.0
    shares = [0.0, *((-DEGAUSS_RATIO) ** step for step in range(DEGAUSS_STEPS)), 0.0]
    way = sum(abs(after - before) for before, after in pairwise(shares))
    return way * parameters.largest_field_mT / RAMP_MT_PER_S + RAMP_S * (DEGAUSS_STEPS + 1)


def turn_s(before: Point | None, point: Point) -> float:
    """Return the expected time of the turn from a point to the next; none where both are alike."""
    way_deg = abs(point.angle_deg - (before.angle_deg if before else 0.0))
    return TURN_S + way_deg / TURN_DEG_PER_S if way_deg else 0.0


def group_by_angle(points: tuple[Point, ...]) -> list[list[Point]]:
    """Return the points in their order, in groups without a turn of the stage between them."""
    stays = groupby(points, key=lambda point: (point.plane, point.angle_deg))
    return [list(group) for _, group in stays]


def records(parameters: AccelerometerParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records.

    Angle and temperature are corrected; their uncertainties are in no budget yet.
    """
    apart = {"in_budget": False, "needed": False}
    return (
        RecordUse(GAUSSMETER, "field", parameters.largest_field_mT, "mT"),
        RecordUse(MULTIMETER, "voltage", parameters.scale_factor_V_per_g, "V"),
        RecordUse(STAGE, "angle", 0.0, "deg", **apart),
        RecordUse(STAGE, "graduation", FULL_TURN_DEG, "deg", needed=False, corrected=False),
        RecordUse(THERMOMETER, "temperature", 20.0, "degC", **apart),
    )


def check(parameters: AccelerometerParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the voltmeter cannot do, and fields that the gaussmeter's record leaves out."""
    if MULTIMETER in bench.instruments:
        driver = registry.load(registry.DRIVERS, bench.instruments[MULTIMETER].driver)
        yield from meter_problems(parameters, driver)
    states = ("uncertainty", "field") in bench.statements(GAUSSMETER)
    for field_mT in parameters.field_levels_mT if states else ():
        if bench.stated(GAUSSMETER, "field", field_mT, "mT") is None:
            yield Problem(
                LARGEST_FIELD,
                f"the gaussmeter's calibration record states no uncertainty at {field_mT:g} mT",
            )


def meter_problems(
    parameters: AccelerometerParameters, driver: type[Multimeter]
) -> Iterator[Problem]:
    """Yield integration time, range and burst that the voltmeter's driver says it cannot do."""
    if parameters.nplc not in driver.integration_cycles:
        known = ", ".join(f"{cycles:g}" for cycles in driver.integration_cycles)
        yield Problem(
            ("parameters", "nplc"),
            f"the {MULTIMETER} cannot integrate over {parameters.nplc:g} power-line cycles; it can "
            f"do {known}",
        )
    if parameters.readings > driver.most_readings:
        yield Problem(
            ("parameters", "readings"),
            f"the {MULTIMETER} takes {driver.most_readings} readings in a burst at most",
        )
    largest_V = first_range(parameters).largest_V
    if largest_V > driver.highest_V:
        yield Problem(
            ("parameters", "scale_factor"),
            f"the {MULTIMETER} must hold {largest_V:g} V, its highest range ends at "
            f"{driver.highest_V:g} V",
        )
