"""The results as one CSV table: a row for each result, the published value beside it."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from station.results import ResultDocument

COLUMNS = (
    "procedure",
    "name",
    "axis",
    "value",
    "unit",
    "standard_uncertainty",
    "coverage_factor",
    "expanded_uncertainty",
    "degrees_of_freedom",
    "method",
    "limit_min",
    "limit_max",
    "limit_max_abs",
    "verdict",
    "decision",
    "as_published",
    "as_published_unit",
    "as_published_method",
)


def published_by_key(document: ResultDocument) -> dict[tuple[str, str | None], dict[str, Any]]:
    """Return what the source document's own formula gave, by name and axis of the result."""
    return {(one.name, one.axis): one.to_data() for one in document.published}


def csv_of(document: ResultDocument) -> str:
    """Return the results as CSV with a header; what is null stays empty.

    Numbers have the digits that bring back the same number, uncertainties are in the value's unit.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    published = published_by_key(document)
    for result in document.results:
        data = result.to_data()
        other = published.get((data["name"], data["axis"]), {})
        writer.writerow(
            {
                **data,
                "procedure": document.procedure,
                **{f"limit_{name}": value for name, value in (data["limit"] or {}).items()},
                "as_published": other.get("value"),
                "as_published_unit": other.get("unit"),
                "as_published_method": other.get("method"),
            }
        )
    return text.getvalue()
