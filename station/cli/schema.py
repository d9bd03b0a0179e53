"""`station schema`."""

from __future__ import annotations

from station.schema import schema_text


def print_schema(kind: str, *, built_in: bool) -> None:
    """Print the JSON Schema of a plan, bench or dataset."""
    print(schema_text(kind, built_in=built_in), end="")
