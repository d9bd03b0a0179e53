"""The bench file that a commissioning completes: measured values, and the figures to watch."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from station.fields import StrictModel
from station.files.yaml.document import Document, Where
from station.findings import Estimate
from station.instruments.commissioned import Commissioned, CommissionedFigure, ConfirmedForm
from station.record.events import Event

BENCH_FILE, FIGURES_FILE = "bench-commissioned.yaml", "commissioned.json"
KEY = "commissioned"


@dataclass(frozen=True)
class Completion:
    """A value of the bench file: where it stands, what it becomes, why, in a few words.

    `figure` is the watched one that is relative to the value: name, axis, and what it becomes.
    """

    where: Where
    text: str
    why: str
    figure: tuple[str, str, float] | None = None


@dataclass(frozen=True)
class Withheld:
    """A part whose figures are not written, and the causes that are open."""

    part: str
    causes: tuple[str, ...]


def figures_to_watch(
    estimates: Sequence[Estimate], watched: Sequence[str], changes: Sequence[Completion]
) -> tuple[CommissionedFigure, ...]:
    """Return the figures that a weekly check is held against, of the bench file as it becomes."""
    become = {
        change.figure[:2]: change.figure[2] for change in changes if change.figure is not None
    }
    return tuple(
        CommissionedFigure(
            name=estimate.name,
            axis=estimate.axis,
            value=become.get((estimate.name, estimate.axis or ""), estimate.value),
            unit=estimate.unit,
            standard_uncertainty=estimate.standard_uncertainty or 0.0,
        )
        for estimate in estimates
        if estimate.name in watched and estimate.value is not None
    )


def confirmed_forms(events: Iterable[Event]) -> tuple[ConfirmedForm, ...]:
    """Return which forms the drivers met in a run, each once, by instrument."""
    met = {
        (event.details["instrument"], event.details["met"])
        for event in events
        if event.kind == "instrument-variant"
    }
    return tuple(ConfirmedForm(instrument=name, met=form) for name, form in sorted(met))


def files_of(
    bench: str,
    written: Document,
    changes: Sequence[Completion],
    withheld: Sequence[Withheld],
    commissioned: Commissioned,
) -> dict[str, str]:
    """Return the completed bench file and the figures, file name to text.

    Without any figure there is no bench file: a check would have nothing to watch.
    """
    data: dict[str, Any] = {
        "schema": 1,
        "bench": bench,
        **commissioned.model_dump(mode="json"),
        "changes": [
            {"key": ".".join(map(str, change.where)), "value": change.text, "why": change.why}
            for change in changes
        ],
        "withheld": [
            {"part": withheld_part.part, "causes": list(withheld_part.causes)}
            for withheld_part in withheld
        ],
    }
    figures = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    if not commissioned.figures:
        return {FIGURES_FILE: figures}
    return {FIGURES_FILE: figures, BENCH_FILE: bench_text(written, changes, commissioned)}


def bench_text(
    document: Document, changes: Sequence[Completion], commissioned: Commissioned
) -> str:
    """Return the text of a bench file with changed values and its figures; comments stay."""
    lines = without_block(document.text.splitlines(), document)
    head = [f"# Commissioned {commissioned.date.isoformat()}, run {commissioned.run}."]
    places = [(document.positions[change.where], change) for change in changes]
    # From the end of a line to its beginning, so that what stands before keeps its column.
    for mark, change in sorted(places, key=lambda at: (at[0].line, at[0].column), reverse=True):
        written, row, column = document.scalars[change.where], mark.line - 1, mark.column - 1
        before, after = lines[row][:column], lines[row][column:]
        lines[row] = before + after.replace(written, change.text, 1)
        head.append(f"# {'.'.join(map(str, change.where))}: {written} before; {change.why}.")
    first = next((k for k, line in enumerate(lines) if not line.startswith("#")), 0)
    return "\n".join([*lines[:first], *head, *lines[first:], *block_of(commissioned)]) + "\n"


def without_block(lines: list[str], document: Document) -> list[str]:
    """Return the lines without the figures of an earlier commissioning."""
    key = document.key_positions.get((KEY,))
    if key is None:
        return lines
    later = [
        mark.line
        for where, mark in document.key_positions.items()
        if len(where) == 1 and mark.line > key.line
    ]
    end = min(later, default=len(lines) + 1)
    # The places of what follows are kept: a line is emptied, not taken out.
    return [*lines[: key.line - 1], *([""] * (end - key.line)), *lines[end - 1 :]]


def block_of(commissioned: Commissioned) -> list[str]:
    """Return the lines of the key `commissioned`."""
    return [
        "",
        f"{KEY}:",
        f"  date: {commissioned.date.isoformat()}",
        f"  run: {json.dumps(commissioned.run, ensure_ascii=False)}",
        "  figures:",
        *(f"    - {entry(figure)}" for figure in commissioned.figures),
        *_entries("confirmed", commissioned.confirmed),
        *_entries("tried", commissioned.tried),
    ]


def _entries(key: str, entries: Sequence[StrictModel]) -> list[str]:
    lines = [f"    - {json.dumps(each.model_dump(), ensure_ascii=False)}" for each in entries]
    return [f"  {key}:", *lines] if lines else []


def entry(figure: CommissionedFigure) -> str:
    """Return a figure as a mapping in one line."""
    axis = "" if figure.axis is None else f"axis: {json.dumps(figure.axis, ensure_ascii=False)}, "
    return (
        f"{{name: {figure.name}, {axis}value: {figure.value!r}, unit: {json.dumps(figure.unit)}, "
        f"standard_uncertainty: {figure.standard_uncertainty!r}}}"
    )
