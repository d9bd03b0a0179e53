"""The results of many runs as one table in a Parquet file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from station.errors import InputError
from station.reanalysis.one_run import Row

TEXTS = (
    "run",
    "folder",
    "procedure",
    "model",
    "serial",
    "started_utc",
    "bench",
    "recalled",
    "verdict",
    "stored_verdict",
    "flags",
    "results_sha256",
    "name",
    "axis",
    "unit",
    "method",
    "result_verdict",
    "error",
)
NUMBERS = (
    "value",
    "standard_uncertainty",
    "expanded_uncertainty",
    "stored_value",
    "stored_expanded_uncertainty",
    "change_in_u",
)
"""Values in the unit of their row; the change in its standard uncertainty."""


def write_table(rows: Sequence[Row], file: Path) -> None:
    """Write rows as a Parquet file, whole or not at all; raises InputError where it cannot be."""
    import pyarrow as pa
    from pyarrow import parquet

    columns = {name: pa.string() for name in TEXTS} | {name: pa.float64() for name in NUMBERS}
    table = pa.Table.from_pylist(list(rows), schema=pa.schema(list(columns.items())))
    part = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(table, part)
        part.replace(file)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(
            f"cannot write {file}: {error.strerror or error}; choose another folder with --output"
        ) from error
