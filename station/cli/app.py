"""The verbs and their options."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

# rich would draw the same help in twice the time.
app = typer.Typer(
    name="station",
    help="Run published calibration procedures of inertial sensors on a real or simulated bench.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)

Json = Annotated[
    bool, typer.Option("--json", help="Print exactly one JSON document on standard output.")
]
BenchName = Annotated[
    str, typer.Option("--bench", help="Bench file: a path, or a name in config/benches.")
]
DEFAULT_BENCH = "sim"


class Kind(StrEnum):
    """What `list` can list."""

    PROCEDURES = "procedures"
    PLANS = "plans"
    BENCHES = "benches"
    DRIVERS = "drivers"
    RUNS = "runs"


class ReportFormat(StrEnum):
    """What `report` can write."""

    HTML = "html"


@app.command("list")
def list_(kind: Annotated[Kind | None, typer.Argument()] = None, json: Json = False) -> None:
    """List what there is: procedures, plans, benches, drivers, runs."""
    from station.cli.listing import list_what_there_is

    list_what_there_is(kind.value if kind else None, as_json=json)


@app.command()
def validate(
    plans: Annotated[list[str], typer.Argument(metavar="PLAN...")],
    bench: BenchName = DEFAULT_BENCH,
    json: Json = False,
) -> None:
    """Find every fault of every plan; touches no instrument."""
    from station.cli.validating import validate_plans

    raise typer.Exit(validate_plans(plans, bench, as_json=json))


@app.command()
def run(
    plan: Annotated[str, typer.Argument(help="Test plan: a path, or a name in config/plans.")],
    bench: BenchName = DEFAULT_BENCH,
    non_interactive: Annotated[
        bool, typer.Option("--non-interactive", help="Ask nobody; CI=true implies it.")
    ] = False,
    answers: Annotated[
        Path | None, typer.Option(help="YAML file of prompt ids and answers.")
    ] = None,
    served: Annotated[
        Path | None, typer.Option(help="File with the first line of a running `station sim`.")
    ] = None,
    output: Annotated[Path, typer.Option(help="Parent of the run folder.")] = Path("runs"),
    json: Json = False,
) -> None:
    """Run a test plan and leave a run folder with raw data, results and report."""
    from station.cli.running import run_plan

    raise typer.Exit(
        run_plan(
            plan,
            bench,
            non_interactive=non_interactive,
            answers=answers,
            served=served,
            output=output,
            as_json=json,
        )
    )


@app.command()
def analyse(
    data: Annotated[Path, typer.Argument(help="Run folder, dataset folder or dataset.yaml.")],
    output: Annotated[
        Path | None, typer.Option(help="Folder for results.json and report.html.")
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Print the largest difference from stored results.")
    ] = False,
    json: Json = False,
) -> None:
    """Compute results again from recorded raw data, or from an imported dataset."""
    from station.cli.analysing import analyse_data

    raise typer.Exit(analyse_data(data, output, compare=compare, as_json=json))


app.command("analyze", hidden=True)(analyse)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")],
    format: Annotated[ReportFormat, typer.Option("--format")] = ReportFormat.HTML,
) -> None:
    """Make the report of a run again, into its exports folder."""
    from station.cli.reporting import remake_report

    remake_report(folder)


@app.command()
def identify(
    bench: Annotated[str, typer.Argument(help="Bench file: a path, or a name.")] = DEFAULT_BENCH,
    json: Json = False,
) -> None:
    """Ask every instrument of a bench who it is, and compare with the bench file."""
    from station.cli.identifying import identify_bench

    raise typer.Exit(identify_bench(bench, as_json=json))


@app.command()
def sim(
    bench: Annotated[str, typer.Argument(help="Simulated bench: path or name.")] = DEFAULT_BENCH,
    procedure: Annotated[
        str, typer.Option(help="The procedure whose device is mounted.")
    ] = "rlg-magnetic-sensitivity",
    speed: Annotated[float, typer.Option(help="How many times as fast as real time.")] = 1.0,
) -> None:
    """Serve the simulated instruments on their wire protocols until interrupted."""
    from station.cli.serving import serve

    serve(bench, procedure, speed)


@app.callback(invoke_without_command=True)
def version(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Print the version where it is asked for."""
    if version:
        from station import __version__

        typer.echo(__version__)
        raise typer.Exit
