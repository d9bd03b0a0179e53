"""Readings of a tumble test that mean something else: rows, planes and mountings mixed up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from procedures.estimation.orthogonal import independent_of
from procedures.estimation.readings import Reading, Remainder, named, shifted, suiting
from station.findings import Flag

from .dataset import AnalysisSettings, TumbleDataset
from .model import COEFFICIENTS
from .solution import Solution, solve

OTHER_PLANE = {"io": "ip", "ip": "io"}
ROWS = (-2, -1, 1, 2)
SMALLEST_PART = 1e-5
"""Of a column: with less of its own, readings determine other coefficients than those stated."""


def misread_flags(
    dataset: TumbleDataset, kept: tuple[str, ...], solution: Solution, settings: AnalysisSettings
) -> list[Flag]:
    """Return the flag of what the columns mean where they do not mean what is stated, or none.

    Looked for where something beside the model moved the output.
    """
    if solution.cause is None:
        return []

    places = [COEFFICIENTS.index(name) for name in kept]
    nothing = np.empty((len(dataset.time_s), 0))

    def remainder(data: TumbleDataset) -> Remainder | None:
        if len(independent_of(nothing, data.columns[:, places], SMALLEST_PART)) < len(places):
            return None
        solved = solve(data, kept, settings, beside=False)
        # Readings left out are what a model does not follow.
        residual = np.abs(solved.residual_V)
        squares = float(np.sum(np.minimum(residual, np.quantile(residual, 0.98)) ** 2))
        return Remainder(squares, solved.freedom)

    suits = suiting(dataset, _kinds(dataset), remainder)
    if not suits:
        return []
    text = (
        f"The output is followed only if {named(suits)}. There are no results: mend the table, "
        "and analyse it again."
    )
    return [suits[0].reading.flag(text)]


def _kinds(dataset: TumbleDataset) -> list[Sequence[Reading[TumbleDataset]]]:
    """Return what laboratories mix up: rows of the output, plane or reversal of a mounting."""
    late = [
        Reading(
            f"the outputs stand {abs(rows)} row(s) too {'late' if rows > 0 else 'early'}",
            shifted(("output_V",), rows),
            "output_V",
            {"rows": rows},
        )
        for rows in ROWS
    ]
    called = []
    for number in range(int(dataset.mounting[-1]) + 1):
        for column, change in (("plane", _in_other_plane), ("reversed", _reversed)):
            what = f"mounting {number + 1} in order of time has another `{column}`"
            apply: Callable[[TumbleDataset], TumbleDataset] = partial(change, number)
            called.append(Reading(what, apply, column, {"mounting": number + 1}))
    return [late, called]


def _in_other_plane(number: int, dataset: TumbleDataset) -> TumbleDataset:
    other = np.array([OTHER_PLANE[name] for name in dataset.plane.tolist()])
    return replace(dataset, plane=np.where(dataset.mounting == number, other, dataset.plane))


def _reversed(number: int, dataset: TumbleDataset) -> TumbleDataset:
    there = dataset.mounting == number
    return replace(dataset, reverse=np.where(there, -dataset.reverse, dataset.reverse))
