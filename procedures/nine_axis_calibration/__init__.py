"""Nine-axis sensor: bias and scale factor of its three fibre-optic gyros.

The nine-axis calibration step by step, numbered by the claims that the source divides it into.

Source: "A calibration method and device for a nine-axis sensor" (Chinese patent text 19276906,
2018-10-30), claims 1 and 2; letters divide a claim in the order of its text. Claims 3 and 4 give
the rates and the positions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.method.commands import Power
from station.method.verbs import record_published
from station.procedure import LazyImport, Procedure, ResultKind, Step, usual_modules

from .directions import AXES, in_words
from .parameters import NineAxisParameters, pose_unit, position_unit
from .placing import ask_to_place, make_table_ready, turn_up
from .work import POWER, check, instruments, prompts, records, work

if TYPE_CHECKING:
    from station.method.run import Run


def mount(run: Run) -> None:
    """Claim 1: the sensor on its tooling; switched on and warm."""
    parameters: NineAxisParameters = run.parameters
    missing = [unit for unit in parameters.units if not run.is_finished(unit)]
    if not missing:
        return
    ask_to_place(run, missing[0])
    run.apply(Power(POWER, True))
    run.wait(parameters.warm_up_s, "the gyros warm up")
    if parameters.positioning == "table":
        make_table_ready(run)


def rest(run: Run) -> None:
    """Claim 1: in each position the output at rest for the first preset time."""
    from .lying import lie
    from .measuring import measure_position, need_sensor_well

    positions = run.parameters.all_positions
    for number, position in enumerate(positions, 1):
        if not run.is_finished(position_unit(position)):
            need_sensor_well(run)
        measure_position(run, position, f"position {position}, {number} of {len(positions)}")
    poses = run.parameters.poses
    for number, word in enumerate(poses, 1):
        if not run.is_finished(pose_unit(word)):
            need_sensor_well(run)
        lie(run, word, f"{in_words(word)}, {number} of {len(poses)}")


def biases(run: Run) -> None:
    """Claim 1: each axis' bias is the mean of its rate where it faced east."""
    say_published(run, "bias")


def rotate(run: Run) -> None:
    """Claim 2: on the turntable, each axis up in turn, N rates in both senses."""
    from .measuring import need_sensor_well, turn

    turns = run.parameters.all_turns
    for word in run.parameters.all_turned:
        own = [
            record for record in turns if record.axis == word and not run.is_finished(record.unit)
        ]
        if not own:
            continue
        make_table_ready(run)
        turn_up(run, word)
        need_sensor_well(run)
        for record in own:
            turn(run, record, f"record {turns.index(record) + 1} of {len(turns)}, {record.unit}")


def scale_factors(run: Run) -> None:
    """Claim 2: K from the mean outputs and the rates; then the device off."""
    say_published(run, "scale_factor")
    run.apply(Power(POWER, False))


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


STEPS = (
    Step("1a", "Mount the sensor, switch it on, let it warm up", mount),
    Step("1b", "At rest in each position, one axis after the other facing east", rest),
    Step("1c", "Biases: means of the axes that faced east", biases),
    Step("2a", "Each axis up, N rates in both senses, whole turns", rotate),
    Step("2b", "Scale factors from outputs and rates; then off", scale_factors),
)


PAIRS = ("XY", "XZ", "YX", "YZ", "ZX", "ZY")


PROCEDURE = Procedure(
    name="nine-axis-calibration",
    title="Nine-axis sensor: gyro bias and scale factor",
    source="A calibration method and device for a nine-axis sensor (Chinese patent text 19276906, "
    "2018-10-30), claims 1 to 4",
    parameters=NineAxisParameters,
    results={
        "bias": ResultKind(AXES, "deg/h"),
        "scale_factor": ResultKind(AXES, "1"),
        "asymmetry": ResultKind(AXES, "ppm"),
        "nonlinearity": ResultKind(AXES, "ppm"),
        "misalignment": ResultKind(PAIRS, "arcsec"),
        "accelerometer_bias": ResultKind(AXES, "g"),
        "accelerometer_scale_factor": ResultKind(AXES, "1"),
        "accelerometer_nonorthogonality": ResultKind(("XY", "XZ", "YZ"), "arcsec"),
        "accelerometer_second_order": ResultKind(AXES, "ug/g^2"),
        "boresight": ResultKind(AXES, "arcsec"),
        "g_sensitivity": ResultKind(tuple(a + b for a in AXES for b in AXES), "deg/h/g"),
        "magnetometer_offset": ResultKind(AXES, "nT"),
        "magnetometer_scale_factor": ResultKind(AXES, "1"),
        "magnetometer_misalignment": ResultKind(PAIRS, "arcsec"),
    },
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=prompts,
    check=check,
    **usual_modules(__name__),
    work=work,
    outlook=LazyImport(f"{__name__}.outlook:outlook"),
    files=LazyImport(f"{__name__}.calibration:files_of"),
    assumptions=(
        "The three positions and the turns do not determine the accelerometers: none faces down. "
        "`poses` adds directions that do.",
        "A scale factor is that along the table's axis. An input axis tilted by 10 arcmin reads "
        "4 ppm less; with one axis recorded that is not distinguished from K.",
        "Misalignments are towards the axes of the table as the sensor was mounted on it, so they "
        "hold the fixture's own errors; towards the accelerometers where these are determined.",
        "A field that turns with the sensor, as that of the plate it is mounted on, counts as the "
        "magnetometer's offset: one mounting cannot distinguish the two.",
        "The biases are those of the positions 1 to 3: a gyro that feels gravity has it in them.",
        "The bias is that of this switch-on and temperature, with the gyros at rest. It is "
        "taken as the same in all positions; where it is not, the uncertainty is widened.",
    ),
)
