"""Further verbs: what is served until Ctrl-C, and what looks at runs that have ended."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_BENCH,
    MOUNTED,
    Json,
    Letterhead,
    NewKind,
    Output,
    Paper,
    Procedure,
    ReportFormat,
    ReportKind,
    RunFolder,
    SchemaKind,
    named_run,
)


def sim(
    bench: Annotated[str, typer.Argument(help="Simulated bench: path or name.")] = DEFAULT_BENCH,
    procedure: Procedure = MOUNTED,
    speed: Annotated[float, typer.Option(help="How many times as fast as real time.")] = 1.0,
    until_stdin_closes: Annotated[
        bool,
        typer.Option(
            "--until-stdin-closes",
            help="End when standard input closes, with whoever started this.",
        ),
    ] = False,
) -> None:
    """Serve simulated instruments until interrupted."""
    from station.cli.instruments import serve

    serve(bench, procedure, speed, until_stdin_closes=until_stdin_closes)


def new(
    kind: NewKind,
    name: Annotated[str, typer.Argument(help="Small letters, digits and hyphens.")],
    extends: Annotated[
        str | None,
        typer.Option(metavar="PLAN", help="The plan that a new one changes.", show_default=False),
    ] = None,
) -> None:
    """Write a plan, bench file, procedure or driver to start from."""
    from station.cli.new import write_new

    write_new(kind.value, name, extends)


def panel(
    host: Annotated[str, typer.Option(help="Address to listen at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen at.")] = 8642,
    output: Output = Path("runs"),
    tokens: Annotated[
        Path | None,
        typer.Option(help="YAML file: `operator: TOKEN`, `engineer: TOKEN`.", dir_okay=False),
    ] = None,
) -> None:
    """Serve the operator panel for a browser until interrupted."""
    from station.cli.panel import serve_panel

    serve_panel(host, port, output, tokens)


def schema(
    kind: SchemaKind,
    built_in: Annotated[
        bool, typer.Option("--built-in", help="Leave out procedures and drivers of other packages.")
    ] = False,
) -> None:
    """Print the JSON Schema of plan, bench or dataset files."""
    from station.schema import schema_text

    print(schema_text(kind.value, built_in=built_in), end="")


def report(
    folder: RunFolder,
    format: Annotated[ReportFormat, typer.Option("--format")] = ReportFormat.HTML,
    kind: Annotated[
        ReportKind, typer.Option("--kind", help="The whole report, or a certificate.")
    ] = ReportKind.REPORT,
    paper: Annotated[Paper | None, typer.Option("--paper", help="Paper of a PDF; else a4.")] = None,
    letterhead: Letterhead = None,
    lang: Annotated[
        str | None,
        typer.Option(
            help="en, zh, or zh+en: one above the other; else that of this terminal.",
            show_default=False,
        ),
    ] = None,
    schema: Annotated[
        Path | None,
        typer.Option("--schema", metavar="XSD", help="Schema that a dcc is held against."),
    ] = None,
    issue: Annotated[
        bool, typer.Option("--issue", help="Give a certificate its number, and keep its PDF.")
    ] = False,
    replaces: Annotated[
        str, typer.Option(metavar="NUMBER", help="The certificate that this one replaces.")
    ] = "",
    reason: Annotated[
        str, typer.Option(metavar="TEXT", help="Why; it stands on the certificate.")
    ] = "",
) -> None:
    """Make the report or certificate of a run, into its exports."""
    from station.cli.reporting import issue_certificate, remake_report

    if issue:
        if format not in (ReportFormat.HTML, ReportFormat.PDF) or schema is not None:
            raise typer.BadParameter("--issue keeps a PDF: leave --format and --schema out")
        size = paper or Paper.A4
        issue_certificate(folder, kind.value, size.value, letterhead, lang, replaces, reason)
    elif replaces or reason:
        raise typer.BadParameter("--replaces and --reason go with --issue")
    elif paper is not None and format is not ReportFormat.PDF:
        raise typer.BadParameter("--paper is of a PDF: give --format pdf, or leave it out")
    else:
        size_asked = paper.value if paper else None
        remake_report(folder, format.value, kind.value, size_asked, letterhead, lang, schema)


def history(
    store: Annotated[
        str | None,
        typer.Argument(
            metavar="STORE", help="With --rebuild: folder of the runs, or URL of a store of runs."
        ),
    ] = None,
    dut: Annotated[str | None, typer.Option(metavar="SERIAL", help="Of this unit.")] = None,
    procedure: Annotated[str | None, typer.Option(help="Of this procedure.")] = None,
    result: Annotated[str | None, typer.Option(metavar="NAME", help="This result.")] = None,
    bench: Annotated[str | None, typer.Option(help="Of this bench, by its name.")] = None,
    check_standards: Annotated[
        bool, typer.Option("--check-standards", help="Of plans marked `check_standard: true`.")
    ] = False,
    rebuild: Annotated[
        bool, typer.Option("--rebuild", help="Read every run folder again first.")
    ] = False,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write plots.")] = None,
    acknowledge: Annotated[
        list[str] | None,
        typer.Option(metavar="ID", help="Take note of an alarm of a check standard."),
    ] = None,
    reason: Annotated[
        str | None,
        typer.Option(metavar="TEXT", help="With --acknowledge: the cause, and what was done."),
    ] = None,
    new_baseline: Annotated[
        bool,
        typer.Option("--new-baseline", help="With --acknowledge: its chart begins anew after it."),
    ] = False,
    output: Output = Path("runs"),
    json: Json = False,
) -> None:
    """Show results of past runs over time."""
    from station.cli.history import acknowledge_alarms, show_history
    from station.history.store import Wanted

    if store is not None and not rebuild:
        raise typer.BadParameter("a store goes with --rebuild, as in `--rebuild STORE`")
    if acknowledge:
        if any((dut, procedure, result, bench, check_standards, rebuild, html)):
            raise typer.BadParameter(
                "--acknowledge lists and draws nothing: leave all but --reason, --new-baseline, "
                "--output and --json out"
            )
        acknowledge_alarms(
            output, acknowledge, reason or "", new_baseline=new_baseline, as_json=json
        )
        return
    if reason is not None or new_baseline:
        raise typer.BadParameter("--reason and --new-baseline go with --acknowledge ID")
    wanted = Wanted(dut, procedure, bench, result, check_standards or None)
    show_history(output, wanted, rebuild=rebuild, store=store, page=html, as_json=json)


def compare(
    first: Annotated[Path, typer.Argument(metavar="A", callback=named_run)],
    second: Annotated[Path, typer.Argument(metavar="B", callback=named_run)],
    json: Json = False,
) -> None:
    """Compare two runs side by side."""
    from station.cli.comparing import compare_runs

    compare_runs(first, second, as_json=json)


def verify(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders.")],
    trusted: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Keys whose signatures count, one a line."),
    ] = None,
    bench: Annotated[
        str | None, typer.Option(help="Bench file whose `laboratory.trusted_keys` count.")
    ] = None,
    head: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT",
            help="A head that the run had, or the text of its QR code; lists what came after.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Prove run folders unchanged, or name what was altered."""
    from station.cli.verifying import verify_runs

    raise typer.Exit(verify_runs(runs, as_json=json, trusted=trusted, bench=bench, head=head))


def sign(
    run: Annotated[Path | None, typer.Argument(help="Run folder.", callback=named_run)] = None,
    key: Annotated[Path | None, typer.Option(help="Private key, PEM.")] = None,
    signer: Annotated[str, typer.Option(help="Who signs.")] = "",
    new_key: Annotated[Path | None, typer.Option(help="Make a private key here.")] = None,
) -> None:
    """Sign an unchanged run folder with the laboratory's key."""
    from station.cli.verifying import make_key, sign_run

    if new_key is not None:
        make_key(new_key)
    elif run is None or key is None or not signer:
        raise typer.BadParameter("give RUN, --key and --signer; or --new-key FILE for a first key")
    else:
        raise typer.Exit(sign_run(run, key, signer))


def add_to(app: typer.Typer) -> None:
    """Add the verbs to the command line."""
    app.command()(sim)
    app.command()(new)
    app.command()(panel)
    app.command()(report)
    app.command()(schema)
    app.command()(verify)
    app.command()(sign)
    app.command()(history)
    app.command()(compare)
