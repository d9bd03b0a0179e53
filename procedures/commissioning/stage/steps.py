"""Steps R1 and R2 of a commissioning: the stage's sense, zero and turn; then its axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import InstrumentError
from station.method.commands import Angle, Homing, MeterRange, Power
from station.method.duration import exactly, on_the_way
from station.method.run import Run
from station.method.verbs import come_to_rest, fetch_bursts, keep, keep_row
from station.procedure import Prompt, Step
from station.roles import Multimeter, RotaryStage

from .parameters import WHOLE_DEG, StageParameters, StageRecord

STAGE = "rotary_stage"
METER = "multimeter"
POWER = "dut_power"
ANGLE = (STAGE, "angle", WHOLE_DEG, "deg")
"""What the stage's calibration record states."""
KEY = ("parameters", "stage")
LARGEST_G = 1.1
HOMING_S, TURN_S, MAINS_HZ = 15.0, 8.0, 50.0
AUTO_ZERO = 2.0
"""A reading with auto-zero takes twice its integration time."""
STAGE_COLUMNS = {"angle_deg": "deg, encoder", "commanded_deg": "deg, set-point"}
MOUNTS = {
    "io": Prompt(
        "mount-io",
        "Mount the accelerometer on the rotary stage with its pendulous axis (PA) along the "
        "stage's horizontal axis, its input axis (IA) level at 0 deg and rising with the angle. "
        "Connect it to its supply and to the voltmeter, with enough slack for a whole turn.",
    ),
    "op": Prompt(
        "mount-op",
        "Mount the accelerometer on the rotary stage with its input axis (IA) along the stage's "
        "horizontal axis.",
    ),
}


def turn(run: Run) -> None:
    """R1: the accelerometer's output in quarters of a whole turn, its input axis turning."""
    walk(run, "io")


def axis(run: Run) -> None:
    """R2: the same with its input axis along the stage's axis."""
    walk(run, "op")
    if run.state(StageState).plane:
        run.apply(Power(POWER, False))


STEPS = (
    Step("R1", "Rotary stage: sense, zero and whole turn against gravity", turn),
    Step("R2", "Rotary stage: its axis against the level", axis),
)


@dataclass
class StageState:
    """What this process of a run has done: the plane that the accelerometer is mounted for."""

    plane: str = ""


def meter_range(parameters: StageParameters) -> MeterRange:
    """Return how the voltmeter is read."""
    largest_V = LARGEST_G * parameters.scale_factor_V_per_g
    return MeterRange(METER, largest_V, parameters.nplc, parameters.readings)


def angle_of(record: StageRecord) -> Angle:
    """Return the angle of a record."""
    return Angle(STAGE, record.angle_deg, f"plane {record.plane}", decided_by=KEY)


def burst_s(parameters: StageParameters) -> float:
    """Return the bench time in s of one burst."""
    return AUTO_ZERO * parameters.readings * parameters.nplc / MAINS_HZ


def walk(run: Run, plane: str) -> None:
    """Measure the records of a plane."""
    parameters: StageParameters = run.parameters.stage
    of_plane = [record for record in parameters.records if record.plane == plane]
    for record in run.unfinished(of_plane, lambda record: record.unit):
        make_ready(run, plane)
        measure(run, record)


def make_ready(run: Run, plane: str) -> None:
    """Have the accelerometer mounted for a plane; at first limits, zero, meter, power, warm-up."""
    state, parameters = run.state(StageState), run.parameters.stage
    if state.plane == plane:
        return
    ask_at_rest(run, MOUNTS[plane])
    if not state.plane:
        run.role(STAGE, RotaryStage).programme_limits()
        if run.apply(Homing(STAGE)):
            come_to_rest(run, STAGE, "the stage looks for its zero", takes=on_the_way(HOMING_S))
        run.apply(meter_range(parameters))
        run.apply(Power(POWER, True))
        run.wait(parameters.warm_up_s, "the accelerometer warms up")
    state.plane = plane


def measure(run: Run, record: StageRecord) -> None:
    """Record the encoder and a burst of the voltmeter at an angle."""
    parameters: StageParameters = run.parameters.stage
    run.apply(angle_of(record))
    come_to_rest(run, STAGE, record.unit, takes=on_the_way(TURN_S))
    with run.unit(record.unit):
        angle_deg = run.role(STAGE, RotaryStage).angle_deg()
        keep_row(run, record.unit, STAGE, STAGE_COLUMNS, angle_deg, record.angle_deg)
        act = partial(read_burst, run, record.unit, run.role(METER, Multimeter))
        run.read(act, takes=exactly(burst_s(parameters)))
        run.count_rows(METER, parameters.readings)


def read_burst(run: Run, unit: str, meter: Multimeter) -> None:
    """Record a burst; InstrumentError where the output is beyond the voltmeter's range."""
    parameters: StageParameters = run.parameters.stage
    meter.start(parameters.readings)
    for _, block in fetch_bursts(run, unit, {METER: meter}, lasts_s=burst_s(parameters)):
        keep(run, unit, meter, block)
        if block.columns["overload"].any():
            raise InstrumentError(
                METER,
                f"record {unit}",
                f"the output is beyond its range for {parameters.scale_factor_V_per_g:g} V/g",
                "state scale_factor in the plan, and look at the accelerometer's cable",
            )
