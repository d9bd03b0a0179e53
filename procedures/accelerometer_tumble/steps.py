"""The steps, by the numbers of the station's own account of the multipoint tumble: 1 to 5."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from procedures.common.stage_and_meter import (
    POWER,
    STAGE,
    AtStage,
    find_zero,
    first_range,
    record_angle,
    record_output,
    turn_to,
)
from station.method.commands import Power
from station.method.run import Run
from station.procedure import Prompt, Step
from station.roles import RotaryStage

from .parameters import Position, Setting, TumbleParameters

POSITIONS = ("parameters", "positions")
MOUNTINGS = {
    "io": "its pendulous axis (PA) along the stage's axis",
    "io-reversed": "its pendulous axis (PA) along the stage's axis, turned by 180 deg about its "
    "input axis",
    "ip": "its output axis (OA) along the stage's axis",
    "ip-reversed": "its output axis (OA) along the stage's axis, turned by 180 deg about its input "
    "axis",
}
CABLES = Prompt(
    "connect-cables",
    "Connect the accelerometer to its supply and to the voltmeter, and its Pt100 to the second "
    "meter.",
)


@dataclass
class Mounted:
    """How the accelerometer stands; None while this process of a run has not asked for it."""

    setting: Setting | None = None


def mounting(setting: Setting) -> Prompt:
    """Return the request to mount the accelerometer for a setting."""
    how = MOUNTINGS[setting.mounting]
    text = (
        f"Mount the accelerometer in the fixture on the rotary stage, {how}; its input axis (IA) "
        "is level at 0 deg of the fixture and rises with the angle."
    )
    if setting.head_deg:
        text = f"Turn the fixture to {setting.head_deg:g} deg on the stage's head. {text}"
    return Prompt(
        f"mount-{setting.name.replace(' ', '-')}",
        text,
        checklist=(
            "The stage's axis is level to 10 arcsec.",
            "The seats are clean, and the screws are tight.",
            "The cables leave the stage room to turn.",
        ),
        picture="mounting.svg",
        then="the stage turns through the positions",
    )


def mount(run: Run) -> None:
    """1: the accelerometer on the rotary stage, in the first mounting."""
    left = [point for point in run.parameters.points if not run.is_finished(point.unit)]
    if left:
        run.ask(CABLES)
        mount_for(run, left[0].setting)


def warm_up(run: Run) -> None:
    """2: limits and zero of the stage, range of the voltmeter; the accelerometer on and warm."""
    parameters: TumbleParameters = run.parameters
    if all(run.is_finished(point.unit) for point in parameters.points):
        return
    run.role(STAGE, RotaryStage).programme_limits()
    find_zero(run)
    run.state(AtStage).range_V = run.apply(first_range(parameters))
    run.apply(Power(POWER, True))
    run.wait(parameters.warm_up_s, "the accelerometer warms up")


def first_mounting(run: Run) -> None:
    """3: the positions of the first mounting, upwards and downwards."""
    measure_all(run, run.parameters.settings[:1])


def further_mountings(run: Run) -> None:
    """4: the same for each further mounting."""
    parameters: TumbleParameters = run.parameters
    measure_all(run, parameters.settings[1 : len(parameters.mountings)])


def further_heads(run: Run) -> None:
    """5: all of it with the fixture turned on the head; then the accelerometer is off."""
    parameters: TumbleParameters = run.parameters
    measure_all(run, parameters.settings[len(parameters.mountings) :])
    run.apply(Power(POWER, False))


STEPS = (
    Step("1", "Mount the accelerometer on the rotary stage, its axis level", mount),
    Step("2", "On, warm", warm_up),
    Step(
        "3", "The positions up, then down: dwell, voltmeter, encoder, thermometer", first_mounting
    ),
    Step("4", "Again for each further mounting", further_mountings),
    Step("5", "Again with the fixture turned on the head; then off", further_heads),
)


def measure_all(run: Run, settings: Sequence[Setting]) -> None:
    """Measure the positions of settings that are not finished."""
    parameters: TumbleParameters = run.parameters
    numbered = [pair for pair in enumerate(parameters.points, 1) if pair[1].setting in settings]
    for number, point in run.unfinished(numbered, unit_of):
        doing = f"position {number} of {len(parameters.points)}, {point.unit}"
        mount_for(run, point.setting)
        measure(run, point, doing)


def unit_of(numbered: tuple[int, Position]) -> str:
    """Return the name of the unit of work of a numbered position."""
    return numbered[1].unit


def mount_for(run: Run, setting: Setting) -> None:
    """Have the accelerometer mounted, the stage at 0 deg where it has turned."""
    place = run.state(Mounted)
    if place.setting == setting:
        return
    if place.setting is not None:
        turn_to(run, 0.0, "for a person", f"to be mounted as {setting.name}")
    run.ask(mounting(setting))
    place.setting = setting


def measure(run: Run, point: Position, doing: str) -> None:
    """Go to a position, let it settle, and read voltmeter, encoder and thermometer."""
    parameters: TumbleParameters = run.parameters
    turn_to(run, point.angle_deg, point.setting.name, doing, POSITIONS)
    run.wait(parameters.dwell_s, doing)
    with run.unit(point.unit, **details_of(point)):
        record_angle(run, point.unit, point.angle_deg)
        record_output(run, point.unit, doing)


def details_of(point: Position) -> dict[str, object]:
    """Return what the log says of a position."""
    setting = point.setting
    return {
        "plane": setting.plane,
        "reversed": setting.reversed,
        "head_deg": setting.head_deg,
        "angle_deg": point.angle_deg,
        "way": point.way,
    }
