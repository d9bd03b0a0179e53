"""Steps L1 and L2 of a commissioning: each line by itself, and its return after a pulled cable."""

from __future__ import annotations

from functools import partial
from typing import Any

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import InstrumentError
from station.method.duration import on_the_way
from station.method.run import Run
from station.procedure import Prompt, Step
from station.roles import Instrument, KeepsErrors

from .parameters import LineParameters, line_unit, return_unit

QUERY_S = 0.05
BACK_S = 5.0
"""A line that was disconnected may need so long; what a person does takes no bench time."""
SOURCE = "lines"
BEFORE, SINCE = "errors_before", "errors_since"
"""Details of a unit: errors that the instrument kept before and since it is asked, if it can."""
COLUMNS = {
    "latency_s": "s from the question for the identity to its answer, NaN where none came",
    "answered": "1 the identity came, 0 it did not",
    "same": "1 it is the identity of the run's beginning, 0 it is not",
}
TRIES, BETWEEN_S = 10, 1.0
"""A person plugs the cable in before the prompt is answered; a line may need some seconds more."""


def ask(run: Run) -> None:
    """L1: each instrument is asked many times who it is, between two looks into its error queue."""
    parameters: LineParameters = run.parameters.lines
    for name in run.unfinished(parameters.instruments, line_unit):
        with run.unit(line_unit(name)) as details:
            act = partial(question, run, line_unit(name), run.role(name, Instrument), details)
            run.read(act, takes=on_the_way(QUERY_S * parameters.queries))


def come_back(run: Run) -> None:
    """L2: each chosen instrument is disconnected by hand, and answers again.

    Coils are off and axes at rest before the hand is asked for.
    """
    parameters: LineParameters = run.parameters.lines
    for name in run.unfinished(parameters.disconnected, return_unit, pauses=False):
        instrument = run.role(name, Instrument)
        known = run.read(instrument.identify)
        ask_at_rest(run, pull(name))
        with run.unit(return_unit(name)):
            act = partial(await_return, run, name, instrument, known)
            run.read(act, takes=on_the_way(BACK_S))


STEPS = (
    Step("L1", "Lines: identity, latency, answers that do not come", ask),
    Step("L2", "Lines: disconnected by hand, and back", come_back),
)


def pull(name: str) -> Prompt:
    """Return the request to disconnect an instrument and to connect it again."""
    text = f"Pull the data cable of {name}, wait for ten seconds and plug it in again."
    return Prompt("reconnect", text)


def question(run: Run, unit: str, instrument: Instrument, details: dict[str, Any]) -> None:
    """Ask an instrument who it is, and what errors it kept before and since; record the answers."""
    if isinstance(instrument, KeepsErrors):
        details[BEFORE] = instrument.take_errors()
    known = instrument.identify()
    _record(run, unit, [_one(run, instrument, known) for _ in range(run.parameters.lines.queries)])
    if isinstance(instrument, KeepsErrors):
        details[SINCE] = instrument.take_errors()


def await_return(run: Run, name: str, instrument: Instrument, known: object) -> None:
    """Ask an instrument who it is until it answers, as often as that may take; record that."""
    rows: list[tuple[float, bool, bool]] = []
    for _ in range(TRIES):
        rows.append(_one(run, instrument, known))
        if rows[-1][1]:
            break
        run.wait(BETWEEN_S, f"{name} comes back")
    _record(run, return_unit(name), rows)


def _one(run: Run, instrument: Instrument, known: object) -> tuple[float, bool, bool]:
    """Return how long one question took in s, whether it was answered, and as before."""
    began_s = run.now_s
    try:
        who = instrument.identify()
    except InstrumentError:
        return float("nan"), False, False
    return run.now_s - began_s, True, who == known


def _record(run: Run, unit: str, rows: list[tuple[float, bool, bool]]) -> None:
    import numpy as np

    from station.roles.base import ARRIVAL

    names = [(name, np.float64) for name in (*COLUMNS, ARRIVAL)]
    now_s = run.now_s
    run.keep_rows(SOURCE, unit, COLUMNS, np.array([(*row, now_s) for row in rows], dtype=names))
