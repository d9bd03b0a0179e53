"""Step T1 of a commissioning: a small step of the chamber's set-point, and what follows it."""

from __future__ import annotations

from station.method.commands import Power
from station.method.duration import exactly
from station.method.motion import ChamberOn, TemperatureTo
from station.method.run import Run
from station.method.verbs import Recording, keep_row, look_until
from station.procedure import Prompt, Step
from station.roles import Navigator, ThermalChamber

from .parameters import STEPPED, UNIT, ChamberParameters

CHAMBER, NAVIGATOR, POWER = "thermal_chamber", "navigator", "dut_power"
FROM = ("parameters", "chamber", "from")
STEP = ("parameters", "chamber", "step")
LOOK_S, OUTPUT_HZ = 10.0, 1.0
COLUMNS = {"temperature_degC": "degC, of the air", "set_point_degC": "degC"}
MOUNT = Prompt(
    "mount-navigator",
    "Set the navigation system into the chamber, connect its power and its data line; close the "
    "door.",
)


def step(run: Run) -> None:
    """T1: the air held, a step of its set-point, held again; chamber and device are recorded."""
    parameters: ChamberParameters = run.parameters.chamber
    for unit in run.unfinished([UNIT], pauses=False):
        run.ask(MOUNT)
        chamber = run.role(CHAMBER, ThermalChamber)
        navigator = run.role(NAVIGATOR, Navigator)
        chamber.programme_limits()
        run.event("field-on", instrument=CHAMBER)
        run.apply(ChamberOn(CHAMBER))
        run.apply(Power(POWER, True))
        navigator.start(OUTPUT_HZ)
        with run.unit(unit) as details:
            run.apply(first(parameters))
            hold(run, parameters.before_s, "air held")
            run.apply(second(parameters))
            details[STEPPED] = run.now_s
            hold(run, parameters.after_s, "after the step")
        navigator.stop()
        run.apply(Power(POWER, False))


STEPS = (Step("T1", "Chamber: overshoot, lag, steady error, and which thermometer follows", step),)


def first(parameters: ChamberParameters) -> TemperatureTo:
    """Return the command that brings the air to where the step begins."""
    text = f"to {parameters.from_degC:g} degC"
    return TemperatureTo(CHAMBER, parameters.from_degC, text, decided_by=FROM)


def second(parameters: ChamberParameters) -> TemperatureTo:
    """Return the command of the step."""
    end_degC = parameters.from_degC + parameters.step_K
    return TemperatureTo(CHAMBER, end_degC, f"to {end_degC:g} degC", decided_by=STEP)


def hold(run: Run, seconds: float, doing: str) -> None:
    """Record chamber and device for a time."""
    chamber = run.role(CHAMBER, ThermalChamber)
    recording = Recording(run, UNIT, {NAVIGATOR: OUTPUT_HZ})

    def look() -> None:
        recording.take()
        values = chamber.temperature_degC(), chamber.set_point_degC()
        keep_row(run, UNIT, CHAMBER, COLUMNS, *values)

    def act() -> None:
        look_until(run, run.now_s + seconds, look, doing, LOOK_S)

    run.read(act, takes=exactly(seconds), rates={**recording.rates, CHAMBER: 1.0 / LOOK_S})
