"""The steps, by the numbers of the source: (1) to (8)."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from itertools import chain, groupby

from procedures.common.stage_and_meter import POWER, STAGE, AtStage, find_zero, first_range
from station.method.commands import CoilOff, CoilOn, Power
from station.method.run import Run
from station.method.verbs import record_published, require_off
from station.procedure import Prompt, Step
from station.roles import DirectCurrentSupply, Gaussmeter, RotaryStage

from .measuring import (
    GAUSSMETER,
    SUPPLY,
    BenchState,
    drive,
    measure,
    ramping_to,
    rms_field_mT,
    turn_to,
)
from .parameters import AccelerometerParameters, Point

RANGE_HEADROOM = 1.5
DEGAUSS_STEPS, DEGAUSS_RATIO, DEGAUSS_HOLD_S = 12, 0.65, 0.5
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


def mount(run: Run) -> None:
    """(1) The accelerometer is mounted on the stage, in the middle of the coil."""
    run.ask(CABLES)
    left = (point for point in run.parameters.points if not run.is_finished(point.unit))
    if first := next(left, None):
        mount_for(run, first.plane)


def set_up(run: Run) -> None:
    """(2) Range and step of the field, the limits, the voltmeter; power on and warm."""
    parameters: AccelerometerParameters = run.parameters
    if all(run.is_finished(point.unit) for point in parameters.points):
        return
    run.role(SUPPLY, DirectCurrentSupply).programme_limits()
    run.role(STAGE, RotaryStage).programme_limits()
    find_zero(run)
    run.role(GAUSSMETER, Gaussmeter).start(RANGE_HEADROOM * parameters.largest_field_mT)
    run.state(AtStage).range_V = run.apply(first_range(parameters))
    run.state(BenchState).rms_mT = rms_field_mT(parameters)
    run.apply(Power(POWER, True))
    run.wait(parameters.warm_up_s, "the accelerometer warms up")
    energise(run)


def first_reading(run: Run) -> None:
    """(3) The voltmeter reads at the first field."""
    measure_all(run, stays_of(run)[0][:1])


def further_fields(run: Run) -> None:
    """(4) Step (2) again, to the largest field: one set of data at this angle."""
    measure_all(run, stays_of(run)[0][1:])


def rotate(run: Run) -> None:
    """(5) The accelerometer is turned to the next angle."""
    for stay in stays_of(run)[1:2]:
        for _, point in run.unfinished(stay[:1], unit_of, pauses=False):
            mount_for(run, point.plane)
            turn_to(run, point, "second angle")


def next_angle(run: Run) -> None:
    """(6) Steps (1) to (5) again: a new set of data."""
    measure_all(run, chain.from_iterable(stays_of(run)[1:2]))


def remaining_angles(run: Run) -> None:
    """(7) Angle by angle through 360 deg, in every plane of the plan; then everything off."""
    measure_all(run, chain.from_iterable(stays_of(run)[2:]))
    run.apply(CoilOff(SUPPLY), takes=ramping_to(run, 0.0))
    run.event("field-off", instrument=SUPPLY)
    require_off(run, SUPPLY)
    run.apply(Power(POWER, False))


def identify(run: Run) -> None:
    """(8) Finite-memory least squares over the recorded points; the best estimate follows."""
    run.read(partial(publish, run))


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


def stays_of(run: Run) -> list[list[tuple[int, Point]]]:
    """Return the plan's points in order and numbered, in groups: each a stay at an angle."""
    numbered = enumerate(run.parameters.points, 1)
    stays = groupby(numbered, key=lambda pair: (pair[1].plane, pair[1].angle_deg))
    return [list(stay) for _, stay in stays]


def unit_of(numbered: tuple[int, Point]) -> str:
    """Return the name of the unit of work of a numbered point."""
    return numbered[1].unit


def measure_all(run: Run, points: Iterable[tuple[int, Point]]) -> None:
    """Measure numbered points that are not finished, re-mounting where their plane is another."""
    count = len(run.parameters.points)
    for number, point in run.unfinished(points, unit_of):
        mount_for(run, point.plane)
        measure(run, point, f"point {number} of {count}")


def mount_for(run: Run, plane: str) -> None:
    """Have the accelerometer mounted for a plane, the coil at rest and the field off."""
    place = run.state(BenchState)
    if place.plane == plane:
        return
    if place.plane is not None:
        run.apply(CoilOff(SUPPLY), takes=ramping_to(run, 0.0))
    run.ask(mounting(plane))
    if place.plane is not None:
        energise(run)
    place.plane = plane


def energise(run: Run) -> None:
    """Switch the coil on at zero, after an alternating, falling field where the plan wants that."""
    parameters: AccelerometerParameters = run.parameters
    largest_mT = parameters.largest_field_mT
    run.apply(CoilOn(SUPPLY))
    run.event("field-on", instrument=SUPPLY, largest_field_mT=largest_mT)
    if not parameters.degauss:
        return
    for step in range(DEGAUSS_STEPS):
        drive(run, largest_mT * (-DEGAUSS_RATIO) ** step)
        run.wait(DEGAUSS_HOLD_S, "an alternating, falling field takes the remanence away")
    drive(run, 0.0)


def publish(run: Run) -> None:
    """Record what the source's own formula gives, where there is a finished point."""
    from .analysis import analyse
    from .evaluate import dataset_of_run

    folder = run.read_back()
    if not folder.finished_units():
        return
    analysis = analyse(dataset_of_run(folder, run.parameters, run.bench))
    for published in analysis.published:
        if published.value is not None:
            record_published(run, published.value, published.unit, name=published.name)
    km = {published.name: published for published in analysis.published}["Km"]
    if km.value is not None:
        run.say(f"    as published Km = {km.value:.5g} {km.unit}")
