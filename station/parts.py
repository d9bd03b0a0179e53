"""What a procedure adds to the report: plots and tables with a sentence each, all of it data."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from station.errors import reason_of
from station.plots import MAX_ROWS as ROWS_OF_A_TRACE
from station.plots import Plot, plot_of, to_data

MAX_BYTES = 2_000_000
"""Of the plots of a revision: traces are thinned further where they hold more."""
MAX_ROWS = 40


@dataclass(frozen=True)
class Table:
    """A table of texts; `rows` are as long as `columns`."""

    title: str
    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


Part = Plot | Table


def first_rows(
    title: str, caption: str, columns: Sequence[str], rows: Sequence[Sequence[str]]
) -> Table:
    """Return a table of the first 40 rows; its caption ends with how many more there are."""
    more = len(rows) - MAX_ROWS
    if more > 0:
        caption = f"{caption} {more} more are not shown."
    return Table(title, caption, columns, rows[:MAX_ROWS])


def text_of_parts(parts: Sequence[Part]) -> str:
    """Return parts as JSON text, their traces thinned to 4,000 points and to 2 MB in all."""
    most = ROWS_OF_A_TRACE
    while True:
        data = {"parts": [_to_data(part, most) for part in parts]}
        text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        if len(text.encode()) <= MAX_BYTES or most < 100:
            return f"{text}\n"
        most //= 2


def parts_of_text(text: str) -> tuple[Part, ...]:
    """Return the parts that `text_of_parts` wrote; raises ValueError where it did not."""
    try:
        return tuple(_part_of(data) for data in json.loads(text)["parts"])
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"no plots and tables: {reason_of(error)}") from error


def _to_data(part: Part, most: int) -> dict[str, Any]:
    if isinstance(part, Table):
        return {"kind": "table", **asdict(part)}
    return {"kind": "plot", **to_data(part, most)}


def _part_of(data: Mapping[str, Any]) -> Part:
    if data["kind"] == "table":
        return Table(data["title"], data["caption"], data["columns"], data["rows"])
    return plot_of(data)
