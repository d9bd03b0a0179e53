"""Step K1 of a commissioning: the gaussmeter's time stamps against the station's clock."""

from __future__ import annotations

from procedures.commissioning.coils.steps import EARTH_FIELD_MT, GAUSSMETER
from station.method.commands import FieldRange
from station.method.run import Run
from station.method.verbs import Recording
from station.procedure import Step
from station.roles import Gaussmeter

from .parameters import UNIT, ClockParameters

RANGE = FieldRange(GAUSSMETER, 3.0 * EARTH_FIELD_MT, decided_by=("parameters", "clocks"))


def gaussmeter(run: Run) -> None:
    """K1: readings with their time stamps."""
    parameters: ClockParameters = run.parameters.clocks
    for unit in run.unfinished([UNIT]):
        run.apply(RANGE)
        run.role(GAUSSMETER, Gaussmeter).drain()
        with run.unit(unit):
            Recording(run, unit, {GAUSSMETER: None}).follow(parameters.record_s, unit)


STEPS = (Step("K1", "Gaussmeter: its clock against the station's", gaussmeter),)
