"""Steps R1 and R2 of a commissioning: the stage's sense, zero and turn; then its axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import InstrumentError
from station.method.commands import Homing, Power
from station.method.verbs import come_to_rest, fetch_bursts, keep, keep_row
from station.procedure import Prompt, Step
from station.roles import Multimeter, RotaryStage

from .parameters import StageParameters, StageRecord
from .work import METER, POWER, STAGE, angle_of, burst_s, meter_range

if TYPE_CHECKING:
    from station.method.run import Run

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


@dataclass
class StageState:
    """What this process of a run has done: the plane that the accelerometer is mounted for."""

    plane: str = ""


def prompts(parameters: StageParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return tuple(MOUNTS.values())


def turn(run: Run) -> None:
    """R1: the accelerometer's output in quarters of a whole turn, its input axis turning."""
    walk(run, "io")


def axis(run: Run) -> None:
    """R2: the same with its input axis along the stage's axis."""
    walk(run, "op")
    if run.state(StageState).plane:
        run.apply(Power(POWER, False))


def walk(run: Run, plane: str) -> None:
    """Measure the records of a plane that no earlier process of the run has finished."""
    parameters: StageParameters = run.parameters.stage
    for record in parameters.records:
        if record.plane == plane and not run.is_finished(record.unit):
            run.may_pause()
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
            come_to_rest(run, STAGE, "the stage looks for its zero")
        run.apply(meter_range(parameters))
        run.apply(Power(POWER, True))
        run.wait(parameters.warm_up_s, "the accelerometer warms up")
    state.plane = plane


def measure(run: Run, record: StageRecord) -> None:
    """Record the encoder and a burst of the voltmeter at an angle.

    Raises InstrumentError where the output is beyond the voltmeter's range.
    """
    parameters: StageParameters = run.parameters.stage
    run.apply(angle_of(record))
    come_to_rest(run, STAGE, record.unit)
    with run.unit(record.unit):
        angle_deg = run.role(STAGE, RotaryStage).angle_deg()
        keep_row(run, record.unit, STAGE, STAGE_COLUMNS, angle_deg, record.angle_deg)
        meter = run.role(METER, Multimeter)
        meter.start(parameters.readings)
        burst = {METER: meter}
        for _, block in fetch_bursts(run, record.unit, burst, lasts_s=burst_s(parameters)):
            keep(run, record.unit, meter, block)
            if block.columns["overload"].any():
                raise InstrumentError(
                    METER,
                    f"record {record.unit}",
                    f"the output is beyond its range for {parameters.scale_factor_V_per_g:g} V/g",
                    "state scale_factor in the plan, and look at the accelerometer's cable",
                )


STEPS = (
    Step("R1", "Rotary stage: sense, zero and whole turn against gravity", turn),
    Step("R2", "Rotary stage: its axis against the level", axis),
)
