"""Uncertainty budgets as tables: axes with the same contributions stand side by side."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from station.report.numbers import (
    NOTHING,
    align_decimals,
    format_degrees_of_freedom,
    format_number,
    format_with_uncertainty,
    typeset,
)

if TYPE_CHECKING:
    from station.results import Result
    from station.uncertainty import BudgetLine

MOST_AXES = 3
"""So many axes stand side by side: more are too wide for paper."""
OF_AXIS = "…"
"""What stands for the axis in a description that several have in common."""
Key = tuple[str, ...]


def budgets_of(results: Sequence[Result]) -> list[dict[str, Any]]:
    """Return the budgets of results, each contribution with its share of the variance.

    What was set by convention, with no uncertainty, has none.
    """
    groups: dict[Any, list[Result]] = {}
    for result in results:
        if result.combined is None or result.by_convention:
            continue
        lines = frozenset(_key(line, result.estimate.axis) for line in result.budget)
        key = (result.estimate.measures, result.estimate.unit, lines)
        alone = len(lines) < len(result.budget)  # two contributions that nothing tells apart
        groups.setdefault((*key, result.estimate.axis if alone else None), []).append(result)
    return [
        _budget(group[first : first + MOST_AXES])
        for group in groups.values()
        for first in range(0, len(group), MOST_AXES)
    ]


def _key(line: BudgetLine, axis: str | None) -> Key:
    """Return what a contribution has in common with the same one of another axis."""
    description = line.description
    if axis:
        description = re.sub(rf"(?<![\w.]){re.escape(axis)}(?![\w.])", OF_AXIS, description)
    return description, line.kind, line.distribution, line.source, line.unit


def _budget(results: Sequence[Result]) -> dict[str, Any]:
    """Return the budget of axes whose contributions are the same."""
    axes = [result.estimate.axis or "" for result in results]
    columns, totals = zip(*map(_contributions, results), strict=True)
    # Lines that nothing tells apart stand in one budget alone, each at its own place.
    rows = []
    for place, (key, first) in enumerate(columns[0]):
        cells = [first, *(dict(column)[key] for column in columns[1:])]
        rows.append(
            {
                "description": key[0].replace(OF_AXIS, ", ".join(axes)),
                **dict(zip(("kind", "distribution", "source"), key[1:4], strict=True)),
                **{name: _joined([cell[name] for cell in cells]) for name in SHARED},
                "u": _joined([cell["u"] for cell in cells]) + first["unit"],
                "cells": cells,
                "largest": max(cell["percent"] for cell in cells),
                "place": place,
            }
        )
    rows.sort(key=lambda row: (-row["largest"], row["place"]))
    estimate = results[0].estimate
    return {
        "name": estimate.words,
        "axes": axes,
        "unit": estimate.unit,
        "totals": list(totals),
        "rows": rows,
    }


SHARED = ("input", "dof", "sensitivity")
"""What is printed once where all axes agree."""


def _contributions(result: Result) -> tuple[list[tuple[Key, dict[str, Any]]], str]:
    """Return the contributions to a result, and the whole, with one decimal point."""
    assert result.combined is not None
    variance = result.combined.standard_uncertainty**2
    total = format_with_uncertainty(result.estimate.value, result.combined.standard_uncertainty)[1]
    texts = [_input_texts(line) for line in result.budget]
    *aligned, total = align_decimals([*(text["contribution"] for text in texts), total])
    column = []
    for line, text, contribution in zip(result.budget, texts, aligned, strict=True):
        percent = 100.0 * line.contribution**2 / variance
        numbers = {"contribution": contribution, "percent": percent, "share": _share(percent)}
        column.append((_key(line, result.estimate.axis), {**text, **numbers}))
    return column, total


def _input_texts(line: BudgetLine) -> dict[str, str]:
    """Return what a budget says of an input; of one that nobody states no contribution."""
    given = line.standard_uncertainty is not None
    contribution = format_with_uncertainty(line.contribution, line.contribution)[1]
    return {
        "input": typeset(format_number(line.value)),
        "u": typeset(format_number(line.standard_uncertainty, 3)),
        "unit": f" {line.unit}" if given and line.unit != "1" else "",
        "dof": format_degrees_of_freedom(line.degrees_of_freedom) if given else NOTHING,
        "sensitivity": typeset(format_number(line.sensitivity, 3)),
        "contribution": contribution if given else NOTHING,
    }


def _joined(texts: Sequence[str]) -> str:
    """Return what axes have in common once, else what each has in their order."""
    return " / ".join(texts if len({*texts}) > 1 else texts[:1])


def _share(percent: float) -> str:
    return f"{percent:.1f}" if percent >= 0.05 or percent == 0 else "< 0.1"
