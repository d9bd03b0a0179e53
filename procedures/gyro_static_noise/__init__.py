"""A gyro at rest: its noise, its bias, and what switching it off and on does to the bias.

Numbered as the station does it: mount, warm up, a long record, short ones after each switch-on.
The coefficients are those of IEEE Std 952, annex C; no clause of a standard is quoted.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.method.commands import Power
from station.method.verbs import Follower
from station.procedure import (
    Procedure,
    Prompt,
    ResultKind,
    Step,
    usual_modules,
)
from station.procedure import (
    nothing_undetermined as nothing_undetermined,
)
from station.roles import GyroAcquisition

from .parameters import UNITS, StaticParameters, unit_of
from .work import (
    AGAIN,
    GYRO,
    LATE_S,
    MAIN,
    OFF,
    POWER,
    instruments,
    outlook,
    records,
    sampling,
    undetermined,
    work,
)

if TYPE_CHECKING:
    from station.method.run import Run

MOUNT = Prompt(
    "mount",
    "Mount the gyro on a plate that nothing moves, its input axis as the plan's `input_axis` says.",
    checklist=(
        "The plate stands on the floor, not on a table that people lean on.",
        "The room stays within 1 degC and nobody walks by during the record.",
    ),
    then="cables; the gyro is switched on by the station",
)
CABLES = Prompt("connect-cables", "Connect the gyro to its acquisition board and its supply.")


def mount(run: Run) -> None:
    """1: the gyro on its plate, its cables connected."""
    run.ask(MOUNT)
    run.ask(CABLES)


def main_record(run: Run) -> None:
    """2 and 3: on and warm, then the long record."""
    switch_on_and_record(run, 1)


def repeats(run: Run) -> None:
    """4: off, cool, on, warm, a short record; again and again."""
    for number in range(2, run.parameters.repeats + 2):
        switch_on_and_record(run, number)


def switch_on_and_record(run: Run, number: int) -> None:
    """Switch the gyro on after it has cooled, let it warm up, and record it."""
    parameters: StaticParameters = run.parameters
    unit = unit_of(number)
    if run.is_finished(unit):
        run.say(f"    {unit}: measured before the run was interrupted")
        return
    run.may_pause()
    if number > 1:
        run.apply(Power(POWER, False))
        run.wait(parameters.cool_s, f"{unit}: the gyro cools, switched off")
    run.apply(Power(POWER, True))
    on_s = run.now_s
    run.wait(parameters.warm_up_s, f"{unit}: the gyro warms up")
    run.apply(sampling(parameters))
    board = run.role(GYRO, GyroAcquisition)
    with run.unit(unit, switch_on=number, on_s=on_s):
        until_s = run.now_s + parameters.lengths_s[number - 1] + LATE_S
        Follower(run, {GYRO: board}).follow(until_s, unit, f"{unit}: the gyro is recorded")
    board.stop()


def switch_off(run: Run) -> None:
    """5: the gyro off."""
    run.apply(Power(POWER, False))


STEPS = (
    Step("1", "Mount the gyro on a still plate", mount),
    Step(MAIN, "Switch it on, let it warm up, record it long", main_record),
    Step(AGAIN, "Off, cool, on, warm: a short record each time", repeats),
    Step(OFF, "Switch the gyro off", switch_off),
)

AXES = ("IA", "X", "Y", "Z")

PROCEDURE = Procedure(
    name="gyro-static-noise",
    title="Gyro at rest: noise coefficients, bias, repeatability",
    source="Allan variance of a gyro at rest (IEEE Std 952, annex C; no clause is quoted)",
    parameters=StaticParameters,
    results={name: ResultKind(AXES, unit) for name, unit in UNITS.items()},
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=lambda parameters: (MOUNT, CABLES),
    **usual_modules(__name__),
    work=work,
    outlook=outlook,
    measured_axes=lambda parameters: dict.fromkeys(UNITS, ("IA",)),
    undetermined=undetermined,
    assumptions=(
        "The bias instability B is that of the density B^2/(2 pi f): the Allan deviation's floor "
        "is 0.664 B. The minimum of the curve, often quoted instead, is a result of its own.",
        "The noise is that of one temperature and attitude; the earth's rate is taken off the "
        "bias for the stated input axis.",
        "The repeatability is that of the switch-ons measured, short noise taken off; another set "
        "of switch-ons scatters about it.",
    ),
)
