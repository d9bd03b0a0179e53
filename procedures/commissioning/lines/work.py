"""What the lines' part asks and records; it energises nothing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from station.method.work import Work, on_the_way
from station.procedure import Prompt, RecordUse

from .parameters import LINES, LineName, LineParameters, line_unit, return_unit

if TYPE_CHECKING:
    from station.instruments.bench import Bench

QUERY_S = 0.05
BACK_S = 5.0
"""A line that was disconnected may need so long; what a person does takes no bench time."""


def asked_on(bench: Bench) -> tuple[LineName, ...]:
    """Return the instruments of a bench whose lines are asked."""
    return tuple(name for name in LINES if name in bench.instruments)


def instruments(parameters: LineParameters) -> tuple[str, ...]:
    """Return the bench instances that are commissioned."""
    return tuple(dict.fromkeys((*parameters.instruments, *parameters.disconnected)))


def pull(name: str) -> Prompt:
    """Return the request to disconnect an instrument and to connect it again."""
    text = f"Pull the data cable of {name}, wait for ten seconds and plug it in again."
    return Prompt("reconnect", text)


def prompts(parameters: LineParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return tuple(pull(name) for name in parameters.disconnected)


def records_of_asked(names: Iterable[str], bench: Bench) -> Iterator[RecordUse]:
    """Yield that nothing is missing of the records of instruments that are asked who they are.

    No reading of theirs is taken, so that no figure depends on what their records state.
    """
    for name in names:
        for _, quantity in bench.statements(name):
            yield RecordUse(name, quantity, 0.0, "1", needed=False)


def work(parameters: LineParameters) -> Iterator[Work]:
    """Yield the questions to each instrument, then each that is disconnected by hand."""
    for name in parameters.instruments:
        yield Work("L1", line_unit(name), decided=on_the_way(QUERY_S * parameters.queries))
    for name in parameters.disconnected:
        yield Work("L2", return_unit(name), decided=on_the_way(BACK_S))
