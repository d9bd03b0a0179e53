"""The nine-axis calibration step by step, numbered by the claims that the source divides it into.

Source: "A calibration method and device for a nine-axis sensor" (Chinese patent text 19276906,
2018-10-30), claims 1 and 2; letters divide a claim in the order of its text. Claims 3 and 4 give
the rates and the positions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.procedure import Step

from .check import POWER, TURNTABLE, axes_of, axes_to_close
from .parameters import AXES, NineAxisParameters, Turn, position_unit

if TYPE_CHECKING:
    from station.runner.run import Run

READY = "the table is ready"
CLOSE_S, MOVE_S, SETTLING_S = 10.0, 10.0, 3.0
HOMING_LOOK_S = 0.5
USUAL_ACCELERATION_DEG_PER_S2 = 50.0


def mount(run: Run) -> None:
    """Claim 1: the sensor on its tooling; switched on and warm."""
    from station.roles import DutPower

    from .measuring import ask_to_place

    parameters: NineAxisParameters = run.parameters
    missing = [unit for unit in parameters.units if not run.is_finished(unit)]
    if not missing:
        return
    ask_to_place(run, missing[0])
    run.role(POWER, DutPower).switch_on()
    run.wait(parameters.warm_up_s, "the gyros warm up")
    if parameters.positioning == "table":
        make_table_ready(run)


def make_table_ready(run: Run) -> None:
    """Close the servos of the table's axes, once in a process; the others than the vertical at 0.

    The axes' zeros are looked for where the table does not know them.
    """
    from station.roles import Turntable

    from .measuring import go_to

    if run.handed_on.get(READY):
        return
    table = run.role(TURNTABLE, Turntable)
    table.programme_limits()
    for axis in axes_to_close(run.bench, run.parameters):
        if table.is_homed(axis):
            continue
        table.home(axis)
        while table.is_moving(axis):
            run.clock.sleep(HOMING_LOOK_S)
            run.say_progress("the table looks for its zeros")
    axes = axes_of(run.bench)
    for axis in () if axes is None else (axes.middle, axes.inner):
        go_to(run, axis, 0.0, "the table goes to zero")
    run.handed_on[READY] = True


def rest(run: Run) -> None:
    """Claim 1: in each position the output at rest for the first preset time."""
    from .measuring import need_sensor_well, stand

    positions = run.parameters.all_positions
    for number, position in enumerate(positions, 1):
        if not run.is_finished(position_unit(position)):
            need_sensor_well(run)
        stand(run, position, f"position {position}, {number} of {len(positions)}")


def biases(run: Run) -> None:
    """Claim 1: each axis' bias is the mean of its rate where it faced east."""
    say_published(run, "bias")


def rotate(run: Run) -> None:
    """Claim 2: on the turntable, each axis up in turn, N rates in both senses."""
    from .measuring import need_sensor_well, turn, turn_up

    turns = run.parameters.all_turns
    for axis in AXES:
        own = [one for one in turns if one.axis == axis and not run.is_finished(one.unit)]
        if not own:
            continue
        make_table_ready(run)
        turn_up(run, axis)
        need_sensor_well(run)
        for one in own:
            turn(run, one, f"record {turns.index(one) + 1} of {len(turns)}, {one.unit}")


def scale_factors(run: Run) -> None:
    """Claim 2: K from the mean outputs and the rates; then the device off."""
    from station.roles import DutPower

    say_published(run, "scale_factor")
    run.role(POWER, DutPower).switch_off()


def say_published(run: Run, name: str) -> None:
    """Say and record what the source's own rule gives for a result, from what is recorded."""
    from .evaluate import POSITION, TURN, dataset_of_run
    from .findings import UNITS, published_values

    kinds = (POSITION,) if name == "bias" else (TURN,)
    dataset = dataset_of_run(run.read_back(), run.parameters, run.bench, kinds)
    turned = sorted({one.axis for one in dataset.turns})
    said = []
    for one in published_values(dataset, turned):
        if one.name != name or one.value is None:
            continue
        unit = UNITS[name]
        run.record.event("published-value", name=name, axis=one.axis, value=one.value, unit=unit)
        said.append(f"{one.axis} {one.value:.7g}{'' if unit == '1' else f' {unit}'}")
    if said:
        run.progress.say(f"    as published, {name}: {', '.join(said)}")


def mount_s(parameters: NineAxisParameters) -> float:
    """Return the expected bench time in s of step 1a."""
    return parameters.warm_up_s + (CLOSE_S if parameters.positioning == "table" else 0.0)


def rest_s(parameters: NineAxisParameters) -> float:
    """Return the expected bench time in s of step 1b, a person's own time aside."""
    moves_s = MOVE_S if parameters.positioning == "table" else 0.0
    one_s = parameters.static_time_s + parameters.static_settle_s + moves_s
    return len(parameters.all_positions) * one_s


def turn_s(parameters: NineAxisParameters, one: Turn) -> float:
    """Return the expected bench time in s of one record on the table."""
    ramps_s = 2.0 * abs(one.rate_deg_per_s) / USUAL_ACCELERATION_DEG_PER_S2
    return one.dwell_s + parameters.settle_s + ramps_s + SETTLING_S


def rotate_s(parameters: NineAxisParameters) -> float:
    """Return the expected bench time in s of step 2a."""
    moves_s = len(AXES) * MOVE_S if parameters.positioning == "table" else CLOSE_S
    return moves_s + sum(turn_s(parameters, one) for one in parameters.all_turns)


def unit_durations_s(parameters: NineAxisParameters) -> dict[str, float]:
    """Return the expected bench time in s of each unit of work: a rest, or a record in turning."""
    rests = dict.fromkeys(
        [position_unit(one) for one in parameters.all_positions],
        rest_s(parameters) / max(len(parameters.all_positions), 1),
    )
    return rests | {one.unit: turn_s(parameters, one) for one in parameters.all_turns}


STEPS = (
    Step("1a", "Mount the sensor, switch it on, let it warm up", mount, mount_s),
    Step("1b", "At rest in each position, one axis after the other facing east", rest, rest_s),
    Step("1c", "Biases: means of the axes that faced east", biases, lambda _: 0.0),
    Step("2a", "Each axis up, N rates in both senses, whole turns", rotate, rotate_s),
    Step("2b", "Scale factors from outputs and rates; then off", scale_factors, lambda _: 0.0),
)
