"""Step T1 of a commissioning: a small step of the chamber's set-point, and what follows it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.method.commands import Power
from station.method.motion import ChamberOn
from station.method.verbs import Follower, keep_row, look_until
from station.procedure import Prompt, Step
from station.roles import Navigator, ThermalChamber

from .parameters import STEPPED, UNIT, ChamberParameters
from .work import CHAMBER, LOOK_S, NAVIGATOR, OUTPUT_HZ, POWER, first, second

if TYPE_CHECKING:
    from station.method.run import Run

COLUMNS = {"temperature_degC": "degC, of the air", "set_point_degC": "degC"}
MOUNT = Prompt(
    "mount-navigator",
    "Set the navigation system into the chamber, connect its power and its data line; close the "
    "door.",
)


def prompts(parameters: ChamberParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return (MOUNT,)


def step(run: Run) -> None:
    """T1: the air held, a step of its set-point, held again; chamber and device are recorded."""
    if run.is_finished(UNIT):
        return
    parameters: ChamberParameters = run.parameters.chamber
    run.ask(MOUNT)
    chamber = run.role(CHAMBER, ThermalChamber)
    navigator = run.role(NAVIGATOR, Navigator)
    chamber.programme_limits()
    run.event("field-on", instrument=CHAMBER)
    run.apply(ChamberOn(CHAMBER))
    run.apply(Power(POWER, True))
    navigator.start(OUTPUT_HZ)
    follower = Follower(run, {NAVIGATOR: navigator})

    def look() -> None:
        follower.take(UNIT)
        values = chamber.temperature_degC(), chamber.set_point_degC()
        keep_row(run, UNIT, CHAMBER, COLUMNS, *values)

    with run.unit(UNIT) as details:
        run.apply(first(parameters))
        look_until(run, run.now_s + parameters.before_s, look, "air held", LOOK_S)
        run.apply(second(parameters))
        details[STEPPED] = run.now_s
        look_until(run, run.now_s + parameters.after_s, look, "after the step", LOOK_S)
    navigator.stop()
    run.apply(Power(POWER, False))


STEPS = (Step("T1", "Chamber: overshoot, lag, steady error, and which thermometer follows", step),)
