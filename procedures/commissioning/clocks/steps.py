"""Step K1 of a commissioning: the gaussmeter's time stamps against the station's clock."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.coils.work import EARTH_FIELD_MT, GAUSSMETER
from station.method.commands import FieldRange
from station.method.verbs import Follower
from station.method.work import POLL_S, Rows, Work
from station.procedure import Step
from station.roles import Gaussmeter

from .parameters import UNIT, ClockParameters

if TYPE_CHECKING:
    from station.method.run import Run

RANGE = FieldRange(GAUSSMETER, 3.0 * EARTH_FIELD_MT, decided_by=("parameters", "clocks"))


def instruments(parameters: ClockParameters) -> tuple[str, ...]:
    """Return the instruments whose clocks are compared."""
    return (GAUSSMETER,)


def work(parameters: ClockParameters) -> Iterator[Work]:
    """Yield the record of the ambient field."""
    rows = Rows(GAUSSMETER, parameters.record_s)
    yield Work("K1", UNIT, (RANGE,), (rows,), parameters.record_s)


def gaussmeter(run: Run) -> None:
    """K1: readings with their time stamps."""
    parameters: ClockParameters = run.parameters.clocks
    if run.is_finished(UNIT):
        return
    run.may_pause()
    run.apply(RANGE)
    source = run.role(GAUSSMETER, Gaussmeter)
    source.drain()
    with run.unit(UNIT):
        until_s = run.now_s + parameters.record_s
        Follower(run, {GAUSSMETER: source}).follow(until_s, UNIT, UNIT, POLL_S)


STEPS = (Step("K1", "Gaussmeter: its clock against the station's", gaussmeter),)
