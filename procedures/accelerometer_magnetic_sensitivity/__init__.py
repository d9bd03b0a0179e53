"""Accelerometer magnetic sensitivity: thirteen coupled coefficients in a strong steady field.

Source: "A magnetic-sensitivity calibration system and method for a linear accelerometer" (Chinese
patent text 36286229, 2023-01-13), paragraphs [0010] to [0018].
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.method.commands import CoilOff, CoilOn, Homing, Power
from station.method.verbs import come_to_rest, record_published, require_off
from station.procedure import LazyImport, Procedure, Prompt, ResultKind, Step, usual_modules
from station.roles import DirectCurrentSupply, Gaussmeter, RotaryStage

from .measuring import Place, finished_points, measure, turn_to
from .parameters import AccelerometerParameters, Point
from .work import (
    DEGAUSS_HOLD_S,
    DEGAUSS_RATIO,
    DEGAUSS_STEPS,
    GAUSSMETER,
    POWER,
    STAGE,
    SUPPLY,
    check,
    field_of,
    first_range,
    group_by_angle,
    instruments,
    records,
    rms_field_mT,
    work,
)

if TYPE_CHECKING:
    from station.method.run import Run

RANGE_HEADROOM = 1.5
MOUNTINGS = {
    "io": "its pendulous axis (PA) along the stage's horizontal axis, its input axis (IA) level at "
    "0 deg and rising with the angle",
    "ip": "its output axis (OA) along the stage's horizontal axis, its input axis (IA) level at "
    "0 deg and rising with the angle",
    "op": "its input axis (IA) along the stage's horizontal axis, its output axis (OA) level at "
    "0 deg and rising with the angle",
    "level": "level, its pendulous axis (PA) up, along the stage's vertical axis",
}
CABLES = Prompt(
    "connect-cables",
    "Connect the accelerometer to its supply and to the voltmeter, its Pt100 to the second meter, "
    "and the coil to its supply; set the field probe beside it, x along the coil's axis.",
)


def mounting(plane: str) -> Prompt:
    """Return the request to mount the accelerometer for a plane."""
    return Prompt(
        f"mount-{plane}",
        f"Mount the accelerometer in the middle of the coil with {MOUNTINGS[plane]}.",
        checklist=("The cables leave the stage room to turn.", "No loose iron is in the coil."),
        then="the coil is driven and the stage turns",
    )


def prompts(parameters: AccelerometerParameters) -> tuple[Prompt, ...]:
    """Return what the operator may be asked to do."""
    return (*(mounting(plane) for plane in parameters.planes), CABLES)


def groups_of(run: Run) -> list[list[Point]]:
    """Return the plan's points in order, a group for each stay at an angle."""
    return group_by_angle(run.parameters.points)


def mount(run: Run) -> None:
    """(1) The accelerometer is mounted on the stage, in the middle of the coil."""
    first = next((p for p in run.parameters.points if not run.is_finished(p.unit)), None)
    run.ask(CABLES)
    if first is not None:
        mount_for(run, first.plane)


def mount_for(run: Run, plane: str) -> None:
    """Have the accelerometer mounted for a plane, the coil at rest and the field off."""
    place = run.state(Place)
    if place.plane == plane:
        return
    if place.plane is not None:
        run.apply(CoilOff(SUPPLY))
    prompt = mounting(plane)
    run.ask(prompt)
    if place.plane is not None:
        energise(run)
    place.plane = plane


def set_up(run: Run) -> None:
    """(2) Range and step of the field, the limits, the voltmeter; power on and warm."""
    parameters: AccelerometerParameters = run.parameters
    if all(run.is_finished(point.unit) for point in parameters.points):
        return
    run.role(SUPPLY, DirectCurrentSupply).programme_limits()
    run.role(STAGE, RotaryStage).programme_limits()
    if run.apply(Homing(STAGE)):
        come_to_rest(run, STAGE, "the stage looks for its zero")
    run.role(GAUSSMETER, Gaussmeter).start(RANGE_HEADROOM * parameters.largest_field_mT)
    run.state(Place).range_V = run.apply(first_range(parameters))
    run.apply(Power(POWER, True))
    run.wait(parameters.warm_up_s, "the accelerometer warms up")
    energise(run)


def energise(run: Run) -> None:
    """Switch the coil on at zero, after an alternating, falling field where the plan wants that."""
    parameters: AccelerometerParameters = run.parameters
    largest_mT, rms_mT = parameters.largest_field_mT, rms_field_mT(parameters)
    run.apply(CoilOn(SUPPLY))
    run.event("field-on", instrument=SUPPLY, largest_field_mT=largest_mT)
    if not parameters.degauss:
        return
    for step in range(DEGAUSS_STEPS):
        run.apply(field_of(largest_mT * (-DEGAUSS_RATIO) ** step, rms_mT))
        run.wait(DEGAUSS_HOLD_S, "an alternating, falling field takes the remanence away")
    run.apply(field_of(0.0, rms_mT))


def do_group(run: Run, group: list[Point]) -> None:
    """Measure the points of one stay at an angle, re-mounting where their plane is another."""
    wanted = run.parameters.points
    for point in group:
        if run.is_finished(point.unit):
            continue
        mount_for(run, point.plane)
        measure(run, point, f"point {wanted.index(point) + 1} of {len(wanted)}")


def first_reading(run: Run) -> None:
    """(3) The voltmeter reads at the first field."""
    do_group(run, groups_of(run)[0][:1])


def further_fields(run: Run) -> None:
    """(4) Step (2) again, to the largest field: one set of data at this angle."""
    do_group(run, groups_of(run)[0][1:])


def rotate(run: Run) -> None:
    """(5) The accelerometer is turned to the next angle."""
    following = groups_of(run)[1:2]
    if following and not all(run.is_finished(point.unit) for point in following[0]):
        point = following[0][0]
        mount_for(run, point.plane)
        turn_to(run, point, "second angle")


def next_angle(run: Run) -> None:
    """(6) Steps (1) to (5) again: a new set of data."""
    for group in groups_of(run)[1:2]:
        do_group(run, group)


def remaining_angles(run: Run) -> None:
    """(7) Angle by angle through 360 deg, in every plane of the plan; then everything off."""
    for group in groups_of(run)[2:]:
        do_group(run, group)
    run.apply(CoilOff(SUPPLY))
    run.event("field-off", instrument=SUPPLY)
    require_off(run, SUPPLY)
    run.apply(Power(POWER, False))


def identify(run: Run) -> None:
    """(8) Finite-memory least squares over the recorded points; the best estimate follows."""
    from .analysis import analyse
    from .evaluate import dataset_of_run

    folder = run.read_back()
    points = finished_points(folder.finished_units(), run.parameters.points)
    if not points:
        return
    analysis = analyse(dataset_of_run(folder, run.parameters, run.bench))
    for published in analysis.published:
        if published.value is not None:
            record_published(run, published.value, published.unit, name=published.name)
    km = {published.name: published for published in analysis.published}["Km"]
    if km.value is not None:
        run.say(f"    as published Km = {km.value:.5g} {km.unit}")


STEPS = (
    Step("(1)", "Mount the accelerometer on the stage", mount),
    Step("(2)", "Set the range and the step of the field; warm up", set_up),
    Step("(3)", "Read the voltmeter at the first field", first_reading),
    Step("(4)", "Repeat (2) and (3) to the largest field", further_fields),
    Step("(5)", "Turn the accelerometer to the next angle", rotate),
    Step("(6)", "Repeat (1) to (5): the next set of data", next_angle),
    Step("(7)", "Repeat for every angle through 360 deg", remaining_angles),
    Step("(8)", "Identify the coefficients by finite-memory least squares", identify),
)


UNITS = {
    **{"K0": "V", "Ki": "V/g", "Kii": "V/g^2", "Kiii": "V/g^3"},
    **dict.fromkeys(("Kio", "Kip", "Koo", "Kpp"), "V/g^2"),
    **{"Km": "V/T", "Kmm": "V/T^2"},
    **dict.fromkeys(("Kim", "Kom", "Kpm"), "V/g/T"),
}
"""As in `model`, which needs NumPy and is not imported until data are there."""


PROCEDURE = Procedure(
    name="accelerometer-magnetic-sensitivity",
    title="Accelerometer: magnetic sensitivity in a strong steady field",
    source="A magnetic-sensitivity calibration system and method for linear accelerometers "
    "(Chinese patent text 36286229, 2023-01-13), steps (1) to (8)",
    parameters=AccelerometerParameters,
    results={name: ResultKind((), unit) for name, unit in UNITS.items()},
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=prompts,
    check=check,
    **usual_modules(__name__),
    work=work,
    outlook=LazyImport(f"{__name__}.outlook:outlook"),
    undetermined=LazyImport(f"{__name__}.outlook:undetermined"),
    assumptions=(
        "At rest the accelerations on the three axes always make 1 g: K0 and the square terms are "
        "distinguished only as far as the combinations say. A centrifuge would separate them.",
        "The field is a scalar in the published model, along the coil's axis. With the coil's "
        "axis along gravity a sensitivity to the direction of the field and the coupling of field "
        "and acceleration (Kim, Kom, Kpm) have the same columns.",
        "The field is measured beside the accelerometer, whose own magnet disturbs the probe; the "
        "gaussmeter's record in the bench file covers that only as far as it says so.",
        "Encoder offset and misalignment of the input axis are fitted wherever the plan separates "
        "them from the coefficients. In one plane they have the same column.",
    ),
)
