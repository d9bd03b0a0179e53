"""What a procedure adds to the report: plots and tables with a sentence each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Plot:
    """A drawn figure with its title and one or two sentences that say what to see."""

    title: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Table:
    """A table of texts; `rows` are as long as `columns`."""

    title: str
    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


Part = Plot | Table
MAX_ROWS = 40


def first_rows(
    title: str, caption: str, columns: Sequence[str], rows: Sequence[Sequence[str]]
) -> Table:
    """Return a table of the first 40 rows; its caption ends with how many more there are."""
    more = len(rows) - MAX_ROWS
    if more > 0:
        caption = f"{caption} {more} more are not shown."
    return Table(title, caption, columns, rows[:MAX_ROWS])
