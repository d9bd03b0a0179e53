"""Options and words that several verbs share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
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
NonInteractive = Annotated[
    bool, typer.Option("--non-interactive", help="Ask nobody; CI=true implies it.")
]
Answers = Annotated[Path | None, typer.Option(help="YAML file of prompt ids and answers.")]
Served = Annotated[
    Path | None, typer.Option(help="File with the first line of a running `station sim`.")
]
Traced = Annotated[
    bool, typer.Option("--trace", help="Write every byte on the wires into the run folder.")
]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")]
BenchFile = Annotated[str, typer.Argument(help="Bench file: a path, or a name.")]
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
