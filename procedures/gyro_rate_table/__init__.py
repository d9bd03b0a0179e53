"""The scale factor of a rate gyro by whole turns on a rate table.

Numbered as the station does it: mount, switch on, stand, turn, stand, off; again after each
switch-on. The terms are those of IEEE Std 952 and 647; no clause of a standard is quoted.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.method.commands import Power
from station.procedure import Procedure, Prompt, ResultKind, Step, usual_modules

from .parameters import UNITS, RateTableParameters
from .work import (
    AGAIN,
    FIRST,
    OFF,
    POWER,
    check,
    instruments,
    outlook,
    records,
    undetermined,
    work,
)

if TYPE_CHECKING:
    from station.runner.run import Run

MOUNT = Prompt(
    "mount-gyro-on-table",
    "Mount the gyro on the turntable, its input axis up, along the axis that turns; level the "
    "mounting face to 1 arcmin.",
    checklist=(
        "The gyro is bolted, its cable goes through the slip ring and is free of the axes.",
        "Nobody is within reach of the table.",
    ),
    then="cables; the gyro is switched on by the station and the table moves",
)
CABLES = Prompt("connect-cables", "Connect the gyro to its acquisition board and its supply.")


def mount(run: Run) -> None:
    """1: the gyro on the table, its cables connected."""
    run.ask(MOUNT)
    run.ask(CABLES)


def first(run: Run) -> None:
    """2 to 5: on and warm, standing, each rate in both senses, standing."""
    from .turning import switch_on_and_turn

    switch_on_and_turn(run, 1)


def again(run: Run) -> None:
    """6: off, cool, and the same again."""
    from .turning import switch_on_and_turn

    for number in range(2, run.parameters.switch_ons + 1):
        switch_on_and_turn(run, number)


def switch_off(run: Run) -> None:
    """7: the gyro off."""
    run.apply(Power(POWER, False))


STEPS = (
    Step("1", "Mount the gyro on the table, input axis up", mount),
    Step(FIRST, "On, warm; standing, each rate in both senses by whole turns, standing", first),
    Step(AGAIN, "Off, cool, and the same again for each switch-on", again),
    Step(OFF, "Switch the gyro off", switch_off),
)

PROCEDURE = Procedure(
    name="gyro-rate-table",
    title="Rate table: scale factor, nonlinearity, asymmetry of a gyro",
    source="Scale factor of a rate gyro on a rate table (terms of IEEE Std 952 and 647; no clause "
    "is quoted)",
    parameters=RateTableParameters,
    results={name: ResultKind(("IA",), unit) for name, unit in UNITS.items()},
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=lambda parameters: (MOUNT, CABLES),
    check=check,
    **usual_modules(__name__),
    work=work,
    outlook=outlook,
    undetermined=undetermined,
    assumptions=(
        "K is the slope of the unweighted line through the noise-free response at the recorded "
        "rates; a mean over the rates is another number where the response is no line.",
        "K is that along the table's axis: an input axis that leans by 10 arcmin reads 4.2 ppm "
        "less.",
        "The repeatability is that of the switch-ons measured; another set scatters about it.",
        "Threshold and resolution are not measured.",
    ),
)
