"""M1 to M3: a table's senses, whole turns, encoder zeros and axes, by a sensor on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from station import registry
from station.errors import ConditionNotReached
from station.fields import StrictModel, Unit
from station.findings import InputQuantity
from station.method.commands import Power
from station.method.duration import exactly, on_the_way
from station.method.motion import AxisAtRate, AxisTo
from station.method.run import Run
from station.method.set_points import Bounded, Bounds
from station.method.verbs import Recording, axis_of, come_to_rest, keep_row
from station.procedure import LazyImport, Problem, Prompt, RecordUse, Step
from station.roles import Driver, Imu, Navigator, Turntable
from station.roles.turntable import table_axes, unnamed_axes

from .part import Cause, Figure, Part, ask_at_rest

if TYPE_CHECKING:
    from station.instruments.bench import Bench

TABLE_AXES = ("outer", "middle", "inner")
ZEROED = ("middle", "inner")
"""Axes that are level at their zeros. That of the outer one is a heading, which no level shows."""
TURN_RATIO = Figure("turn_ratio", axes=TABLE_AXES, limit=0.005, nominal=1.0, drift=0.003)
"""Relative. A gyro's scale factor is within 0.1 % (k = 1), wrong counts per turn are not; two gyros
of one model differ by 0.14 %."""
RATE_RATIO = Figure("rate_ratio", axes=TABLE_AXES, limit=0.002, nominal=1.0, drift=0.001)
"""Relative. A controller's clock is within 0.01 %; its noise at slow rates adds to that."""
ENCODER_ZERO = Figure(
    "encoder_zero",
    "deg",
    ZEROED,
    limit=0.025,
    drift=0.025,
    cause=Cause(
        "table-zero-off",
        "At zero of the {axis} axis' encoder the plate is {value:+.2g} deg off the level: set the "
        "encoder's zero anew.",
    ),
)
"""Half of 0.05 deg, which a calibration at rest feels as 0.9 mg; a reversal decides it to 0.008 deg
(k = 2). Two placings of a navigator, each with an alignment, differ by 0.0095 deg (k = 1)."""
AXIS_LEAN = Figure("axis_lean", "deg", TABLE_AXES, limit=0.05, drift=0.03)
"""Half of 0.1 deg, by which a turn tilts a device that should stay level; what a navigator takes
for the vertical differs from one alignment to the next by 0.011 deg (k = 1)."""
OFF_SQUARE = Figure(
    "axes_off_square",
    "deg",
    limit=0.08,
    drift=0.06,
    cause=Cause(
        "table-axes-not-square",
        "Middle and inner axis of the table are {value:+.2g} deg off square: one of them leans "
        "within the plate's plane, or the gyros of the sensor are askew.",
    ),
)
"""A gyro's own misalignment is within 0.015 deg (k = 1); 0.15 deg are decided by it. By the gyros
of two sensors it differs by 0.03 deg."""
Angles = tuple[float, float, float]
TURN_DEG = 360.0
HALF_TURNS: tuple[Angles, ...] = (
    (0.0, 0.0, 0.0),
    (0.0, 0.0, 180.0),
    (0.0, 180.0, 180.0),
    (0.0, 180.0, 0.0),
    (180.0, 180.0, 0.0),
    (180.0, 180.0, 180.0),
    (180.0, 0.0, 180.0),
    (180.0, 0.0, 0.0),
)
"""Outer, middle and inner angle: every axis at its zero and reversed, one moves at a time."""
HOME: Angles = (0.0, 0.0, 0.0)
TURNTABLE = "turntable"
IMU, NAVIGATOR = "imu", "navigator"
POWER = "dut_power"
ANGLE = (TURNTABLE, "angle", TURN_DEG, "deg")
"""What the table's calibration record states."""
MOTION = ("parameters", "motion")
MOVE_S, HOMING_S = 8.0, 20.0
ALIGNS_S = 300.0
"""What an alignment usually takes."""
ALIGN_LOOK_S = 5.0
THERE_DEG = 0.003
"""An axis in position reads its angle nearer than this."""
MOUNT = {
    IMU: Prompt(
        "mount-table",
        "Mount the nine-axis sensor on the turntable, its X along the inner and its Z along the "
        "outer axis: with all axes at zero X points north, Y west and Z up. Connect its cable "
        "with enough slack for a whole turn of each axis.",
    ),
    NAVIGATOR: Prompt(
        "mount",
        "Mount the navigator on the turntable: with all axes at zero x points north along the "
        "inner axis, y east and z down. Connect its cables with enough slack for a whole turn of "
        "each axis.",
    ),
}
TURN = {
    IMU: Prompt(
        "mount-table-turned",
        "The table stands at its zeros. Turn the sensor on its plate by half a turn about Z, "
        "against the same stops: X points south, Y east and Z up.",
    ),
    NAVIGATOR: Prompt(
        "mount-turned",
        "The table stands at its zeros. Turn the navigator on its plate by half a turn about z, "
        "against the same stops: x points south, y west and z down.",
    ),
}
OVERSHOOT_DEG, SETTLING_S = 20.0, 3.0
"""An axis is stopped at the first reading beyond its angle, and brakes from there."""
LOOK_S = 0.5
LATE, LATE_S = 1.5, 10.0
"""A turn that takes so many times longer, and so many seconds more, is held by something."""
REST, AT_RATE = 0.0, 1.0
TABLE_COLUMNS = {
    "angle_deg": "deg, the encoder of the axis that turns, turns counted",
    "rate_deg_per_s": "deg/s, read back",
    "commanded_deg_per_s": "deg/s, set-point",
    "at_rate": "1, 1 while the controller says that the axis has its rate, 0 at rest",
}
PLACING, SCALE, ENCODER = "placing_deg", "gyro_scale", "encoder_deg"
VERTICAL, MISALIGNMENT = "navigator_level_deg", "gyro_misalignment_deg"
NAVIGATOR_HZ = 10.0


@dataclass(frozen=True)
class TableTurn:
    """A unit of work: an axis turns by an angle in the positive sense and back, between rests."""

    unit: str
    axis: str
    angle_deg: float
    rate_deg_per_s: float
    middle_deg: float = 0.0
    """Where the middle axis stands meanwhile; the two that do not turn are at zero else."""


class MotionParameters(StrictModel):
    """What the engineer chooses of the table's checks.

    `device` is what stands on the table; a navigator aligns at `latitude_deg`.
    """

    device: Literal["imu", "navigator"] = "imu"
    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)] = 39.9
    align_at_most_s: Annotated[float, Unit("s"), Field(ge=10, le=7200)] = 1800.0
    small_turn_deg: Annotated[float, Unit("deg"), Field(ge=5, le=45)] = 20.0
    small_rate_deg_per_s: Annotated[float, Unit("deg/s"), Field(ge=1, le=20)] = 5.0
    whole_turns: bool = True
    whole_rate_deg_per_s: Annotated[float, Unit("deg/s"), Field(ge=1, le=30)] = 10.0
    rest_s: Annotated[float, Unit("s"), Field(ge=2, le=600)] = 5.0
    sample_rate_Hz: Annotated[float, Unit("Hz"), Field(ge=5, le=100)] = 10.0
    placing_deg: Annotated[float, Unit("deg"), Field(ge=0, le=1)] = 0.005
    navigator_level_deg: Annotated[float, Unit("deg"), Field(ge=0, le=1)] = 0.008
    gyro_misalignment_deg: Annotated[float, Unit("deg"), Field(ge=0, le=1)] = 0.015
    gyro_scale: Annotated[float, Unit("1"), Field(ge=0, le=0.1)] = 0.001

    @property
    def small_turns(self) -> tuple[TableTurn, ...]:
        """The turns that decide the senses: each axis, and the outer one with the plate upright."""
        return (
            *(self._small(f"small turn {axis}", axis) for axis in TABLE_AXES),
            self._small("small turn outer upright", "outer", 90.0),
        )

    @property
    def turns(self) -> tuple[TableTurn, ...]:
        """All turns, in order."""
        rate = self.whole_rate_deg_per_s
        whole = [TableTurn(f"whole turn {axis}", axis, TURN_DEG, rate) for axis in TABLE_AXES]
        return (*self.small_turns, *(whole if self.whole_turns else ()))

    def _small(self, unit: str, axis: str, middle_deg: float = 0.0) -> TableTurn:
        return TableTurn(unit, axis, self.small_turn_deg, self.small_rate_deg_per_s, middle_deg)


def level_unit(angles_deg: Angles) -> str:
    """Return the name of the unit of work at rest at outer, middle and inner angles."""
    return f"level at {', '.join(f'{angle_deg:g}' for angle_deg in angles_deg)} deg"


TURNED_UNIT = "level, sensor turned on its plate"
"""At the axes' zeros, the sensor turned by half a turn."""


def senses(run: Run) -> None:
    """M1: each axis by a small slow turn there and back; the outer one with the plate upright."""
    walk_turns(run, run.parameters.motion.small_turns)


def whole_turns(run: Run) -> None:
    """M2: each axis by a whole turn there and back."""
    parameters: MotionParameters = run.parameters.motion
    walk_turns(run, parameters.turns[len(parameters.small_turns) :])


def levels(run: Run) -> None:
    """M3: the sensor's level with every axis at 0 and 180 deg; then with the sensor turned."""
    for angles_deg in run.unfinished(HALF_TURNS, level_unit):
        make_ready(run)
        go_to(run, moves(angles_deg, level_unit(angles_deg)))
        record_level(run, level_unit(angles_deg))
    for unit in run.unfinished([TURNED_UNIT]):
        make_ready(run)
        go_to(run, moves(HOME, "all axes to zero"))
        turn_device(run)
        record_level(run, unit)
    if run.state(TableState).is_ready:
        # Switched off it could not be asked for what it keeps.
        run.role(run.parameters.motion.device, Driver).kept.put_back()
        run.apply(Power(POWER, False))


def walk_turns(run: Run, turns: Sequence[TableTurn]) -> None:
    """Measure turns that no earlier process of the run has finished."""
    for turn in run.unfinished(turns, lambda turn: turn.unit):
        make_ready(run)
        record_turn(run, turn)


def begin_of(turn: TableTurn) -> tuple[AxisTo, ...]:
    """Return the commands that bring the table where a turn begins."""
    return moves((0.0, turn.middle_deg, 0.0), f"{turn.unit}: where it begins")


def spin(turn: TableTurn, sense: int) -> AxisAtRate:
    """Return the command of a turn in one sense."""
    rate = sense * turn.rate_deg_per_s
    return AxisAtRate(TURNTABLE, turn.axis, turn.unit, None, rate, decided_by=MOTION)


class Sensing(Recording):
    """The sensor's stream for one unit of work."""

    def __init__(self, run: Run, unit: str) -> None:
        parameters: MotionParameters = run.parameters.motion
        device = parameters.device
        self._sensor: Imu | Navigator = (
            run.role(device, Imu) if device == IMU else run.role(device, Navigator)
        )
        self._sensor.start(parameters.sample_rate_Hz)
        super().__init__(run, unit, {device: parameters.sample_rate_Hz})

    def rest(self, seconds: float) -> None:
        """Record for a time."""
        self.follow(seconds, self.unit, every_s=LOOK_S)

    def stop(self) -> None:
        """End the output and record the rest of it."""
        self._sensor.stop()
        self._run.read(self.take)


def record_level(run: Run, unit: str) -> None:
    """Record the sensor at rest."""
    parameters: MotionParameters = run.parameters.motion
    with run.unit(unit):
        sensing = Sensing(run, unit)
        sensing.rest(parameters.rest_s)
        sensing.stop()


def record_turn(run: Run, turn: TableTurn) -> None:
    """Record a turn: rest, there, rest, back, rest. Its event holds the run times between them."""
    parameters: MotionParameters = run.parameters.motion
    go_to(run, begin_of(turn))
    text = f"{turn.unit} by {turn.angle_deg:g} deg"
    for angle_deg in (-OVERSHOOT_DEG, turn.angle_deg + OVERSHOOT_DEG):
        within: Bounds = {"angle_deg": angle_deg}
        run.declare(Bounded(TURNTABLE, text, within=within, decided_by=MOTION))
    with run.unit(turn.unit) as facts:
        sensing = Sensing(run, turn.unit)
        marks_s = [run.now_s]
        rest(run, turn, sensing, parameters.rest_s)
        for sense in (+1, -1):
            marks_s.append(run.now_s)
            go(run, turn, sense, sensing)
            marks_s.append(run.now_s)
            rest(run, turn, sensing, parameters.rest_s)
        marks_s.append(run.now_s)
        sensing.stop()
        facts.update(marks_s=marks_s)


def rest(run: Run, turn: TableTurn, sensing: Sensing, seconds: float) -> None:
    """Record at rest, and the encoder once."""
    read(run, turn, 0.0, REST)
    sensing.rest(seconds)


def go(run: Run, turn: TableTurn, sense: int, sensing: Sensing) -> None:
    """Turn in one sense until the encoder has the turn's angle, or zero again; then come to rest.

    Raises ConditionNotReached where it takes far longer than it should.
    """
    command = spin(turn, sense)
    axis, table = axis_of(run, command), run.role(TURNTABLE, Turntable)
    run.apply(command)
    takes = exactly(turn.angle_deg / turn.rate_deg_per_s) + on_the_way(SETTLING_S)
    rates = {**sensing.rates, TURNTABLE: 1.0 / LOOK_S}
    run.read(partial(turn_over, run, turn, sense, sensing, table, axis), takes=takes, rates=rates)


def turn_over(
    run: Run, turn: TableTurn, sense: int, sensing: Sensing, table: Turntable, axis: int
) -> None:
    """Record until an axis that turns has its angle, stop it and wait until it rests."""
    began_s, rate = run.now_s, turn.rate_deg_per_s
    gives_up_s = began_s + LATE * turn.angle_deg / rate + LATE_S
    end_deg = turn.angle_deg if sense > 0 else 0.0
    left_deg = sense * (end_deg - table.angle_deg(axis))
    while left_deg > 0.0:
        sensing.rest(min(LOOK_S, max(left_deg / rate, LOOK_S / 5.0)))
        if table.is_at_rate(axis):
            read(run, turn, sense * rate, AT_RATE)
        left_deg = sense * (end_deg - table.angle_deg(axis))
        if run.now_s > gives_up_s:
            raise ConditionNotReached(
                f"the {turn.axis} axis of {TURNTABLE} has {left_deg:.2f} deg of {turn.unit} left "
                f"after {run.now_s - began_s:.0f} s at {rate:g} deg/s; look whether "
                "something holds it"
            )
    table.stop(axis)
    while table.is_moving(axis):
        sensing.rest(LOOK_S)


def read(run: Run, turn: TableTurn, commanded_deg_per_s: float, at_rate: float) -> None:
    """Record what encoder and rate read back."""
    table, axis = run.role(TURNTABLE, Turntable), axis_of(run, spin(turn, +1))
    read_back = table.angle_deg(axis), table.rate_deg_per_s(axis)
    keep_row(run, turn.unit, TURNTABLE, TABLE_COLUMNS, *read_back, commanded_deg_per_s, at_rate)


@dataclass
class TableState:
    """What this process of a run has done: whether the table has its limits and its zeros."""

    is_ready: bool = False


def moves(angles_deg: Angles, text: str) -> tuple[AxisTo, ...]:
    """Return the commands that bring outer, middle and inner axis to angles."""
    return tuple(
        AxisTo(TURNTABLE, axis, text, angle_deg=angle_deg, decided_by=MOTION)
        for axis, angle_deg in zip(TABLE_AXES, angles_deg, strict=True)
    )


def make_ready(run: Run) -> None:
    """Have the sensor mounted and on, limits in the table, all axes homed and at zero; once."""
    state = run.state(TableState)
    if state.is_ready:
        return
    ask_at_rest(run, MOUNT[run.parameters.motion.device])
    run.apply(Power(POWER, True))
    table = run.role(TURNTABLE, Turntable)
    table.programme_limits()
    to_zero = moves(HOME, "all axes to zero")
    for move in to_zero:
        axis = axis_of(run, move)
        if not run.read(partial(table.is_homed, axis), assumed=True):
            table.home(axis)
            doing = "the table looks for its zeros"
            come_to_rest(run, TURNTABLE, doing, axis=axis, every_s=LOOK_S)
    go_to(run, to_zero, HOMING_S)
    align(run)
    state.is_ready = True


def turn_device(run: Run) -> None:
    """Have the device turned by half a turn on its plate, and the axes at zero after that."""
    ask_at_rest(run, TURN[run.parameters.motion.device])
    go_to(run, moves(HOME, "all axes to zero"), 0.0)
    align(run)


def align(run: Run) -> None:
    """Let a navigator find its attitude."""
    parameters: MotionParameters = run.parameters.motion
    if parameters.device == NAVIGATOR:
        navigator = run.role(NAVIGATOR, Navigator)
        navigator.align(parameters.latitude_deg)
        run.read(partial(await_alignment, run, navigator), takes=on_the_way(ALIGNS_S))


def await_alignment(run: Run, navigator: Navigator) -> None:
    """Wait until a navigator is aligned; ConditionNotReached where it never is."""
    parameters: MotionParameters = run.parameters.motion
    until_s = run.now_s + parameters.align_at_most_s
    while not navigator.status().aligned:
        run.wait(ALIGN_LOOK_S, "the navigator aligns")
        if run.now_s > until_s:
            raise ConditionNotReached(
                f"{NAVIGATOR} was not aligned within {parameters.align_at_most_s / 60.0:g} min; "
                "look at what it reports, and that nothing shakes the table"
            )


def go_to(run: Run, commands: Sequence[AxisTo], takes_s: float = MOVE_S) -> None:
    """Bring axes to angles, each at rest before the next moves; one that is there stays."""
    table = run.role(TURNTABLE, Turntable)
    takes = on_the_way(takes_s / len(commands))
    for command in commands:
        axis = axis_of(run, command)
        if run.read(partial(is_there, table, axis, command), assumed=False):
            continue
        run.apply(command)
        come_to_rest(run, TURNTABLE, command.text, axis=axis, every_s=LOOK_S, takes=takes)


def is_there(table: Turntable, axis: int, command: AxisTo) -> bool:
    """Return whether an axis is where a command brings it."""
    return abs(table.angle_deg(axis) - command.angle_deg) < THERE_DEG


def units(parameters: MotionParameters) -> Iterator[str]:
    """Yield the units of work of a plan."""
    yield from (turn.unit for turn in parameters.turns)
    yield from map(level_unit, HALF_TURNS)
    yield TURNED_UNIT


def inputs(parameters: MotionParameters, bench: Bench) -> list[InputQuantity]:
    """Return the type B inputs: an angle of the table, and what the plan states of the sensor."""
    level_deg = parameters.navigator_level_deg if parameters.device == NAVIGATOR else 0.0
    by_plan = (
        (PLACING, "placing of the sensor", parameters.placing_deg, "deg"),
        (VERTICAL, "level of the navigator", level_deg, "deg"),
        (MISALIGNMENT, "misalignment of the gyros", parameters.gyro_misalignment_deg, "deg"),
        (SCALE, "scale factors of the sensor's gyros", parameters.gyro_scale, "1"),
    )
    return [
        *bench.stated_input(ANGLE, ENCODER, "angle of the table"),
        *(InputQuantity(*quantity, "the plan") for quantity in by_plan),
    ]


def has_axes(bench: Bench) -> bool:
    """Return whether a bench has a table of three named axes, and a sensor or a navigator."""
    known = table_axes(bench.instruments[TURNTABLE].settings) is not None
    return known and bool({IMU, NAVIGATOR} & set(bench.instruments))


def fits(bench: Bench) -> Iterator[str]:
    """Yield that a navigator stands in for a sensor that a bench does not have."""
    if IMU not in bench.instruments:
        yield f"parameters.motion.device={NAVIGATOR}"


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


PART = Part(
    name="motion",
    steps=(
        Step("M1", "Table: sense of each axis by small slow turns", senses),
        Step("M2", "Table: whole turns against the sensor's gyros, rate read-back", whole_turns),
        Step("M3", "Table: encoder zeros and axes, by reversal against gravity", levels),
    ),
    figures=(TURN_RATIO, RATE_RATIO, ENCODER_ZERO, AXIS_LEAN, OFF_SQUARE),
    needs=(TURNTABLE, POWER),
    has=has_axes,
    units=units,
    dataset=LazyImport("procedures.commissioning.motion_figures:dataset"),
    inputs=inputs,
    analyse=LazyImport("procedures.commissioning.motion_figures:analyse"),
    records=lambda parameters, bench: (RecordUse(*ANGLE, needed=False, corrected=False),),
    check=check,
    fits=fits,
    short=("parameters.motion.whole_turns=false", "parameters.motion.rest=3 s"),
)
