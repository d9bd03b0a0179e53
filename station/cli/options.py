"""The options and arguments that several verbs have, and how a shell completes them."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from station.errors import InputError


def named_run(value: Path | None) -> Path | None:
    """Return the run folder that a person means by a path, a name, or a part of a name."""
    from station.record.run_names import find_run

    return None if value is None else find_run(value)


def active_run(value: Path | None) -> Path | None:
    """Return the run folder that a person means who acts on a run: of several, the active one."""
    from station.control.status import is_active
    from station.record.run_names import find_run

    return None if value is None else find_run(value, is_active=is_active)


def complete_run(typed: str) -> list[str]:
    """Return the names of runs that hold what was typed, for a shell that completes them."""
    from station.record.run_names import RUNS, runs_below

    return [path.name for path in reversed(runs_below(RUNS)) if typed in path.name]


def complete_plan(typed: str) -> list[str]:
    """Return the names of plans that begin with what was typed."""
    from station.files.lookup import PLANS, available

    return [name for name, _ in available(PLANS) if name.startswith(typed)]


def complete_bench(typed: str) -> list[str]:
    """Return the names of benches that begin with what was typed."""
    from station.files.lookup import BENCHES, available

    return [name for name, _ in available(BENCHES) if name.startswith(typed)]


def writable_name(value: Path | None) -> Path | None:
    """Return a folder to write into; raises InputError where its path is no UTF-8.

    Run folders name themselves in their files, which are UTF-8.
    """
    if value is not None:
        path = os.fsencode(value.absolute())
        try:
            path.decode()
        except UnicodeDecodeError as error:
            shown = path.decode(errors="backslashreplace")
            raise InputError(
                f"--output: the path {shown} is no UTF-8; name another folder, or rename it"
            ) from error
    return value


Json = Annotated[
    bool, typer.Option("--json", help="Print exactly one JSON document on standard output.")
]
BenchName = Annotated[
    str,
    typer.Option(
        "--bench",
        help="Bench file: a path, or a name in config/benches.",
        autocompletion=complete_bench,
    ),
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
    bool, typer.Option("--non-interactive", help="Ask no questions; implied by CI=true.")
]
Answers = Annotated[Path | None, typer.Option(help="YAML file of prompt ids and answers.")]
Served = Annotated[
    Path | None, typer.Option(help="File with the first line of a running `station sim`.")
]
Traced = Annotated[
    bool,
    typer.Option(
        "--record-wire", "--trace", help="Write every exchange on the wires into the run folder."
    ),
]

RUN_HELP = "Run folder, or a part of the name of one in ./runs."
PlanName = Annotated[
    str,
    typer.Argument(
        help="Test plan: a path, or a name in config/plans.", autocompletion=complete_plan
    ),
]
Rehearsed = Annotated[
    bool, typer.Option("--rehearse", help="On a simulated bench, ask what a real one would ask.")
]
Output = Annotated[
    Path, typer.Option("--output", help="Parent of the run folder.", callback=writable_name)
]
OutputOfAnalysis = Annotated[
    Path | None,
    typer.Option(
        "--output", help="Folder for results.json and report.html.", callback=writable_name
    ),
]
Detached = Annotated[
    bool, typer.Option("--detach", help="Run without this terminal; `station attach` shows it.")
]
RunFolder = Annotated[
    Path,
    typer.Argument(metavar="RUN", help=RUN_HELP, callback=named_run, autocompletion=complete_run),
]
ACTIVE_HELP = f"{RUN_HELP} Of several the active one."
ActiveRun = Annotated[
    Path,
    typer.Argument(
        metavar="RUN", help=ACTIVE_HELP, callback=active_run, autocompletion=complete_run
    ),
]
NewestRun = Annotated[
    Path | None,
    typer.Argument(
        metavar="[RUN]",
        help=f"{ACTIVE_HELP} Without it, the newest.",
        callback=active_run,
        autocompletion=complete_run,
    ),
]
BenchFile = Annotated[
    str,
    typer.Argument(help="Bench file: a path, or a name.", autocompletion=complete_bench),
]
Procedure = Annotated[
    str, typer.Option(help="The procedure whose device a simulated bench mounts.")
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
    CERTIFICATES = "certificates"


class NewKind(StrEnum):
    """What `new` can write."""

    PROCEDURE = "procedure"
    DRIVER = "driver"
    PLAN = "plan"
    BENCH = "bench"


class SchemaKind(StrEnum):
    """What `schema` can describe."""

    PLAN = "plan"
    BENCH = "bench"
    DATASET = "dataset"


class ReportFormat(StrEnum):
    """What `report` can write."""

    HTML = "html"
    PDF = "pdf"
    CSV = "csv"
    JUNIT = "junit"
    XLSX = "xlsx"
    DCC = "dcc"


class ReportKind(StrEnum):
    """What `report` can make: the whole measurement report, or a certificate."""

    REPORT = "report"
    CERTIFICATE = "certificate"


class Paper(StrEnum):
    """What a PDF is laid out for."""

    A4 = "a4"
    LETTER = "letter"


Letterhead = Annotated[
    Path | None, typer.Option("--letterhead", metavar="DIR", help="Folder of your own letterhead.")
]


class ExportFormat(StrEnum):
    """What `export` can write."""

    HDF5 = "hdf5"
    CSV = "csv"
    MAT = "mat"
