"""`station compare`: two runs side by side."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from station.record.comparison import Comparison, Difference, ResultPair, compare
from station.record.layout import BENCH, PLAN, RUN
from station.record.verification import refuse_unproven
from station.report.numbers import format_number, format_with_uncertainty
from station.speech import in_columns, said

ALIKE = "alike in both"


def compare_runs(first: Path, second: Path, *, as_json: bool) -> None:
    """Print where two runs differ, and their results in units of their uncertainties.

    Raises DamagedRecord where what is compared cannot be shown as what the run left.
    """
    for folder in (first, second):
        refuse_unproven(folder, PLAN, BENCH, RUN)
    comparison = compare(first, second)
    if as_json:
        print(json.dumps(comparison.to_data(), indent=1, ensure_ascii=False))
    else:
        print("\n".join(lines(comparison)))


def lines(comparison: Comparison) -> Iterator[str]:
    """Yield what is printed of a comparison."""
    yield f"A  {comparison.runs[0]}"
    yield f"B  {comparison.runs[1]}"
    parts = {
        "plan": comparison.plan,
        "instruments": comparison.instruments,
        "software": comparison.software,
    }
    for name, differences in parts.items():
        yield said(f"{name}:" + ("" if differences else f"  {ALIKE}"))
        yield from table([_row(difference) for difference in differences])
    yield said("results:")
    yield from table(
        [
            ("", "A", "B", said("unit"), "B - A", said("in u")),
            *(_result(result) for result in comparison.results),
        ]
    )


def table(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows with their columns in line."""
    yield from (f"  {line}" for line in in_columns(rows))


def _row(difference: Difference) -> tuple[str, str, str]:
    first, second = (
        "-" if value is None else str(value) for value in (difference.first, difference.second)
    )
    return difference.where, first, second


def _result(pair: ResultPair) -> tuple[str, ...]:
    """Return a row; the difference has the digits that the larger uncertainty gives a meaning."""
    title = " ".join(filter(None, (said(pair.name.replace("_", " ")), pair.axis)))
    first, second = (
        " ± ".join(format_with_uncertainty(value, u)) if u is not None else format_number(value)
        for value, u in (
            (pair.first, pair.first_u),
            (pair.second, pair.second_u),
        )
    )
    u = max(pair.first_u or 0.0, pair.second_u or 0.0)
    difference = format_with_uncertainty(pair.difference, u or None)[0]
    return title, first, second, pair.unit, said(difference), format_number(pair.in_u, 2)
