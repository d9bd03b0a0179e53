"""Claims 1 and 2 of the source step by step; letters divide a claim in the order of its text."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from procedures.common.switch_ons import switch_off
from station.method.commands import Power
from station.method.verbs import record_published
from station.procedure import Step

from .in_coil import measure_in_coil
from .measuring import measure_at_rest, need_sensor_well, stands_of, turn
from .parameters import NineAxisParameters
from .placing import MOUNT_TABLE, ask_to_put, make_table_ready, on_table, place

if TYPE_CHECKING:
    from station.method.run import Run

POWER = "dut_power"


def mount(run: Run) -> None:
    """Claim 1: the sensor on its tooling; switched on and warm."""
    parameters: NineAxisParameters = run.parameters
    missing = [unit for unit in parameters.units if not run.is_finished(unit)]
    if not missing:
        return
    coil_only = set(missing) <= {level.unit for level in parameters.coil_fields}
    table = parameters.positioning == "table" and not coil_only
    if table:
        ask_to_put(run, MOUNT_TABLE)
    elif missing[0] in (stands := stands_of(parameters)):
        place(run, stands[missing[0]].target)
    run.apply(Power(POWER, True))
    run.wait(parameters.warm_up_s, "the gyros warm up")
    if table:
        make_table_ready(run)


def rest(run: Run) -> None:
    """Claim 1: in each position the output at rest for the first preset time."""
    stands = stands_of(run.parameters)
    for unit in run.unfinished(list(stands)):
        need_sensor_well(run)
        measure_at_rest(run, unit, stands[unit])


def biases(run: Run) -> None:
    """Claim 1: each axis' bias is the mean of its rate where it faced east."""
    run.read(partial(say_published, run, "bias"))


def rotate(run: Run) -> None:
    """Claim 2: on the turntable, each axis up in turn, N rates in both senses."""
    turns = run.parameters.all_turns
    for word in run.parameters.all_turned:
        own = [
            record for record in turns if record.axis == word and not run.is_finished(record.unit)
        ]
        if not own:
            continue
        make_table_ready(run)
        place(run, on_table(word))
        need_sensor_well(run)
        for record in run.unfinished(own, lambda record: record.unit):
            turn(run, record, f"record {turns.index(record) + 1} of {len(turns)}, {record.unit}")


def scale_factors(run: Run) -> None:
    """Claim 2: K from the mean outputs and the rates; then the device off, unless a coil waits."""
    run.read(partial(say_published, run, "scale_factor"))
    if run.parameters.magnetometer_in_coil is None:
        switch_off(run)


def coil(run: Run) -> None:
    """Beside the claims: the magnetometer in the three-axis coil; then the device off."""
    if run.parameters.magnetometer_in_coil is not None:
        measure_in_coil(run)
        switch_off(run)


STEPS = (
    Step("1a", "Mount the sensor, switch it on, let it warm up", mount),
    Step("1b", "At rest in each position, one axis after the other facing east", rest),
    Step("1c", "Biases: means of the axes that faced east", biases),
    Step("2a", "Each axis up, N rates in both senses, whole turns", rotate),
    Step("2b", "Scale factors from outputs and rates; then off", scale_factors),
    Step("2c", "Where the plan says so: the magnetometer in the three-axis coil", coil),
)


def say_published(run: Run, name: str) -> None:
    """Say and record what the source's own rule gives for a result, from what is recorded."""
    from .evaluate import POSITION, TURN, dataset_of_run
    from .findings import UNITS, published_values

    kinds = (POSITION,) if name == "bias" else (TURN,)
    dataset = dataset_of_run(run.read_back(), run.parameters, run.bench, kinds)
    turned = sorted({record.axis for record in dataset.turns})
    values = []
    for published in published_values(dataset, turned):
        if published.name != name or published.value is None:
            continue
        unit = UNITS[name]
        axis = str(published.axis)
        record_published(run, published.value, unit, name=name, axis=axis)
        values.append(f"{axis} {published.value:.7g}{'' if unit == '1' else f' {unit}'}")
    if values:
        run.say(f"    as published, {name}: {', '.join(values)}")
