"""The verbs and their options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.groups import Verbs
from station.cli.more_verbs import add_to
from station.cli.options import (
    DEFAULT_BENCH,
    MOUNTED,
    ActiveRun,
    Answers,
    BenchFile,
    BenchName,
    Detached,
    ExportFormat,
    Json,
    Kind,
    NewestRun,
    NonInteractive,
    Output,
    OutputOfAnalysis,
    Overrides,
    PlanName,
    Procedure,
    Rehearsed,
    RunFolder,
    Served,
    Traced,
    complete_plan,
    complete_run,
)
from station.cli.own_process import leave_to_own_process

# rich would draw the same help in twice the time.
app = typer.Typer(
    name="station",
    cls=Verbs,
    help="Run published calibration procedures of inertial sensors on a real or simulated bench.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=True,
)


@app.command("list")
def list_(
    kind: Annotated[Kind | None, typer.Argument()] = None,
    search: Annotated[
        str, typer.Option(metavar="TEXT", help="Of the runs: name, operator, verdict, state.")
    ] = "",
    store: Annotated[
        str, typer.Option(metavar="STORE", help="Folder of the runs, or URL of a history.")
    ] = "runs",
    page: Annotated[
        int, typer.Option(min=1, max=10**6, metavar="N", help="Of the runs: 1 is the newest 50.")
    ] = 1,
    json: Json = False,
) -> None:
    """List procedures, plans, benches, drivers, runs, certificates."""
    from station.cli.looking import list_what_there_is

    listed = kind or Kind.RUNS
    if (search or page > 1) and listed is not Kind.RUNS:
        raise typer.BadParameter(
            f"--search and --page are of the runs: leave them out with {listed.value}"
        )
    if store != "runs" and listed not in (Kind.RUNS, Kind.CERTIFICATES):
        raise typer.BadParameter(
            f"--store is of runs and certificates: leave it out with {listed.value}"
        )
    of_runs = search or page > 1 or store != "runs"
    wanted = kind.value if kind else "runs" if of_runs else None
    list_what_there_is(wanted, search=search, store=store, page=page, as_json=json)


@app.command()
def validate(
    plans: Annotated[list[str], typer.Argument(metavar="PLAN...", autocompletion=complete_plan)],
    bench: BenchName = DEFAULT_BENCH,
    set_: Overrides = None,
    resolved: Annotated[
        bool, typer.Option("--resolved", help="Print each value and where it comes from.")
    ] = False,
    json: Json = False,
) -> None:
    """Find every fault of every plan; touches no instrument."""
    from station.cli.validating import validate_plans

    raise typer.Exit(validate_plans(plans, bench, set_ or (), resolved=resolved, as_json=json))


@app.command()
def run(
    plan: PlanName,
    bench: BenchName = DEFAULT_BENCH,
    non_interactive: NonInteractive = False,
    answers: Answers = None,
    served: Served = None,
    output: Output = Path("runs"),
    set_: Overrides = None,
    serial: Annotated[
        str | None, typer.Option(help="Serial number of the device, in place of the plan's.")
    ] = None,
    operator: Annotated[
        str | None, typer.Option(help="Who operates, in place of the plan's.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print durations and set-points; open nothing.")
    ] = False,
    trace: Traced = False,
    rehearse: Rehearsed = False,
    detach: Detached = False,
    json: Json = False,
) -> None:
    """Run a test plan; leaves a folder of data and report."""
    if not dry_run:
        leave_to_own_process(detach=detach, non_interactive=non_interactive, as_json=json)
    from station.files.plan.composition import identifying

    overrides = [*(set_ or ()), *identifying(serial, operator)]
    if dry_run:
        from station.cli.running import dry_run_plan

        raise typer.Exit(
            dry_run_plan(
                plan, bench, served=served, output=output, as_json=json, overrides=overrides
            )
        )
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
            overrides=overrides,
            trace=trace,
            rehearse=rehearse,
        )
    )


@app.command()
def commission(
    bench: Annotated[str, typer.Argument(help="Bench file: a path, or a name in config/benches.")],
    non_interactive: NonInteractive = False,
    answers: Answers = None,
    output: Output = Path("runs"),
    check: Annotated[bool, typer.Option("--check", help="Short form: what has drifted.")] = False,
    set_: Overrides = None,
    trace: Traced = False,
    json: Json = False,
) -> None:
    """Measure what a bench does; name what is wrong."""
    from station.cli.commissioning import commission_bench

    code = commission_bench(
        bench, set_ or (), non_interactive, answers, output, check=check, as_json=json, trace=trace
    )
    raise typer.Exit(code)


@app.command()
def resume(
    folder: ActiveRun,
    bench: Annotated[
        str | None, typer.Option("--bench", help="Bench file, where addresses have changed.")
    ] = None,
    served: Served = None,
    answers: Answers = None,
    non_interactive: NonInteractive = False,
    trace: Traced = False,
    rehearse: Rehearsed = False,
    json: Json = False,
) -> None:
    """Resume an interrupted or paused run."""
    leave_to_own_process(non_interactive=non_interactive, as_json=json)
    from station.cli.running import resume_run

    raise typer.Exit(
        resume_run(
            folder,
            bench,
            served=served,
            answers=answers,
            non_interactive=non_interactive,
            trace=trace,
            as_json=json,
            rehearse=rehearse,
        )
    )


@app.command()
def attach(run: ActiveRun) -> None:
    """Show a running run and answer its prompts."""
    from station.cli.attaching import attach as attach_to

    raise typer.Exit(attach_to(run))


@app.command()
def analyse(
    data: Annotated[
        str,
        typer.Argument(
            help="Run folder (a part of its name will do), dataset folder or dataset.yaml.",
            autocompletion=complete_run,
        ),
    ],
    output: OutputOfAnalysis = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Print the largest difference from stored results.")
    ] = False,
    every_run: Annotated[
        bool,
        typer.Option(
            "--all", help="DATA is a folder of run folders, or its URL: all into one table."
        ),
    ] = False,
    trials: Annotated[
        int | None,
        typer.Option(
            "--monte-carlo",
            metavar="N",
            min=100,
            max=1_000_000,
            help="Propagate the budget through the whole analysis by so many trials.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="With --monte-carlo: what is drawn.")] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(help="With --all or --monte-carlo: a Dask cluster, as tcp://host:8786."),
    ] = None,
    with_calibration: Annotated[
        Path | None, typer.Option(help="With --all: YAML file of a recalled certificate.")
    ] = None,
    json: Json = False,
) -> None:
    """Compute results of a run again, of a dataset, of many runs."""
    from station.cli.analysing import analyse_data
    from station.cli.reanalysing import (
        analyse_store,
        by_trials,
        refuse_trials_of_many,
        refuse_without_all,
    )
    from station.record.run_names import find_run

    if every_run:
        refuse_trials_of_many(trials)
        raise typer.Exit(analyse_store(data, output, scheduler, with_calibration, as_json=json))
    refuse_without_all(data, scheduler, with_calibration, trials)
    propagate = by_trials(trials, seed, scheduler)
    folder = find_run(Path(data))
    raise typer.Exit(analyse_data(folder, output, propagate, compare=compare, as_json=json))


app.command("analyze", hidden=True)(analyse)


@app.command()
def export(
    folder: RunFolder,
    format: Annotated[ExportFormat, typer.Option("--format")],
) -> None:
    """Write the raw data of a run for other tools."""
    from station.cli.analysing import export_run

    export_run(folder, format.value)


@app.command()
def replay(
    folder: RunFolder,
    write_test: Annotated[
        Path | None,
        typer.Option("--write-test", metavar="FILE", help="Write a pytest file that replays it."),
    ] = None,
    json: Json = False,
) -> None:
    """Serve a run's transcript to the drivers; list deviations."""
    from station.cli.replaying import replay_run

    raise typer.Exit(replay_run(folder, write_test, as_json=json))


@app.command()
def status(
    run: NewestRun = None,
    watch: Annotated[
        bool, typer.Option("--watch", help="Show it again until the run ends; Ctrl-C stops.")
    ] = False,
    follow: Annotated[
        bool, typer.Option("--follow", help="With --json: a line at each change, to its end.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the state of a run, from its log alone."""
    from station.cli.looking import print_status
    from station.cli.watching import follow_newest, watch_newest

    if follow:
        follow_newest(run, as_json=json and not watch)
    elif watch:
        watch_newest(run, as_json=json)
    else:
        print_status(run, as_json=json)


@app.command()
def pause(
    run: ActiveRun,
    json: Json = False,
) -> None:
    """Pause a run before its next unit of work."""
    from station.cli.controlling import pause_run

    raise typer.Exit(pause_run(run, as_json=json))


@app.command()
def abort(
    run: ActiveRun,
    timeout: Annotated[
        float, typer.Option(help="Wait so many seconds until the bench is safe.")
    ] = 120.0,
    json: Json = False,
) -> None:
    """End a run; its bench is made safe first."""
    from station.cli.controlling import abort_run

    raise typer.Exit(abort_run(run, timeout, as_json=json))


@app.command()
def acknowledge(
    bench: BenchFile,
    json: Json = False,
) -> None:
    """Allow a bench again after an interlock tripped."""
    from station.cli.controlling import acknowledge_bench

    acknowledge_bench(bench, as_json=json)


@app.command()
def identify(
    bench: BenchFile = DEFAULT_BENCH,
    procedure: Procedure = MOUNTED,
    json: Json = False,
) -> None:
    """Identify every instrument of a bench."""
    from station.cli.instruments import identify_bench

    raise typer.Exit(identify_bench(bench, procedure, as_json=json))


@app.command()
def scan(
    host: Annotated[
        list[str] | None,
        typer.Option("--host", help="Host to try on the known instrument ports; repeatable."),
    ] = None,
    served: Served = None,
    visa_library: Annotated[str, typer.Option(help="`@py`, or the vendor's library.")] = "@py",
    json: Json = False,
) -> None:
    """List attached instruments; print a draft of a bench file."""
    from station.cli.instruments import print_scan

    raise typer.Exit(print_scan(host or (), visa_library, served, as_json=json))


add_to(app)


@app.callback(invoke_without_command=True)
def version(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Print the version where it is asked for."""
    if version:
        from station import __version__

        typer.echo(__version__)
        raise typer.Exit
