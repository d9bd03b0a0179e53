"""Options and words that several verbs share."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

Json = Annotated[
    bool, typer.Option("--json", help="Print exactly one JSON document on standard output.")
]
BenchName = Annotated[
    str, typer.Option("--bench", help="Bench file: a path, or a name in config/benches.")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value of the plan, as in `--set 'parameters.frequency=0.2 Hz'`; repeatable.",
    ),
]
DEFAULT_BENCH = "sim"
MOUNTED = "rlg-magnetic-sensitivity"
"""The procedure whose device a simulated bench mounts where nobody says otherwise."""


class Kind(StrEnum):
    """What `list` can list."""

    PROCEDURES = "procedures"
    PLANS = "plans"
    BENCHES = "benches"
    DRIVERS = "drivers"
    RUNS = "runs"


class SchemaKind(StrEnum):
    """What `schema` can describe."""

    PLAN = "plan"
    BENCH = "bench"
    DATASET = "dataset"


class ReportFormat(StrEnum):
    """What `report` can write."""

    HTML = "html"
    CSV = "csv"
    JUNIT = "junit"


class ExportFormat(StrEnum):
    """What `export` can write."""

    HDF5 = "hdf5"
    CSV = "csv"
    MAT = "mat"
