"""`station compare`: two runs side by side."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from station.record.comparison import Comparison, Difference, ResultPair, compare
from station.report.numbers import format_number, format_with_uncertainty

ALIKE = "alike in both"


def compare_runs(first: Path, second: Path, *, as_json: bool) -> None:
    """Print where two runs differ, and their results in units of their uncertainties."""
    found = compare(first, second)
    if as_json:
        print(json.dumps(found.to_data(), indent=1, ensure_ascii=False))
    else:
        print("\n".join(lines(found)))


def lines(found: Comparison) -> Iterator[str]:
    """Yield what is printed of a comparison."""
    yield f"A  {found.runs[0]}"
    yield f"B  {found.runs[1]}"
    parts = {"plan": found.plan, "instruments": found.instruments, "software": found.software}
    for name, differences in parts.items():
        yield f"{name}:" + ("" if differences else f"  {ALIKE}")
        yield from table([_row(one) for one in differences])
    yield "results:"
    yield from table(
        [("", "A", "B", "unit", "B - A", "in u"), *(_result(one) for one in found.results)]
    )


def table(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows with their columns in line."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        yield f"  {'  '.join(cells)}".rstrip()


def _row(one: Difference) -> tuple[str, str, str]:
    first, second = ("-" if value is None else str(value) for value in (one.first, one.second))
    return one.where, first, second


def _result(one: ResultPair) -> tuple[str, ...]:
    """Return a row; the difference has the digits that the larger uncertainty gives a meaning."""
    title = " ".join(filter(None, (one.name.replace("_", " "), one.axis)))
    first, second = (
        " ± ".join(format_with_uncertainty(value, u)) if u is not None else format_number(value)
        for value, u in ((one.first, one.first_u), (one.second, one.second_u))
    )
    u = max(one.first_u or 0.0, one.second_u or 0.0)
    difference = format_with_uncertainty(one.difference, u or None)[0]
    return title, first, second, one.unit, difference, format_number(one.in_u, 2)
