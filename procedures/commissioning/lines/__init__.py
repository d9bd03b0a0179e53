"""The part of the lines: each instrument by itself, nothing energised."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station.procedure import LazyImport, RecordUse

from .parameters import LINES, RESULTS, LineName, LineParameters
from .steps import STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def asked_on(bench: Bench) -> tuple[LineName, ...]:
    """Return the instruments of a bench whose lines are asked."""
    return tuple(name for name in LINES if name in bench.instruments)


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has an instrument with a line."""
    return bool(asked_on(bench))


def fits(bench: Bench) -> Iterator[str]:
    """Yield which instruments of a bench are asked."""
    yield f"parameters.lines.instruments=[{', '.join(asked_on(bench))}]"


def not_tried(parameters: LineParameters) -> Mapping[str, str]:
    """Return why no cable is pulled."""
    if parameters.disconnected:
        return {}
    return {
        "L2": "no line was disconnected by hand: name some in parameters.lines.disconnected, such "
        "as [gaussmeter]"
    }


def measured_axes(parameters: LineParameters) -> Mapping[str, tuple[str, ...]]:
    """Return the instruments that a plan asks, for each figure."""
    return dict.fromkeys(RESULTS, parameters.instruments)


def records_of_asked(names: Iterable[str], bench: Bench) -> Iterator[RecordUse]:
    """Yield that nothing is missing of the records of instruments that are asked who they are.

    No reading of theirs is taken, so that no figure depends on what their records state.
    """
    for name in names:
        for _, quantity in bench.statements(name):
            yield RecordUse(name, quantity, 0.0, "1", needed=False)


LINES_PART = Part(
    name="lines",
    steps=STEPS,
    results=RESULTS,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
    fits=fits,
    measured_axes=measured_axes,
    touches=False,
    not_tried=not_tried,
    short=("parameters.lines.queries=20", "parameters.lines.disconnected=[]"),
)
