"""Further verbs: simulated instruments and the panel, served until Ctrl-C; and verify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.cli.options import DEFAULT_BENCH, MOUNTED, Json, Procedure


def sim(
    bench: Annotated[str, typer.Argument(help="Simulated bench: path or name.")] = DEFAULT_BENCH,
    procedure: Procedure = MOUNTED,
    speed: Annotated[float, typer.Option(help="How many times as fast as real time.")] = 1.0,
) -> None:
    """Serve simulated instruments until interrupted."""
    from station.cli.instruments import serve

    serve(bench, procedure, speed)


def panel(
    host: Annotated[str, typer.Option(help="Address to listen at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen at.")] = 8642,
    output: Annotated[Path, typer.Option(help="Parent of the run folders.")] = Path("runs"),
    tokens: Annotated[
        Path | None,
        typer.Option(help="YAML file: `operator: TOKEN`, `engineer: TOKEN`.", dir_okay=False),
    ] = None,
) -> None:
    """Serve the operator panel for a browser until interrupted."""
    from station.cli.panel import serve_panel

    serve_panel(host, port, output, tokens)


def verify(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders.")],
    json: Json = False,
) -> None:
    """Prove run folders unchanged, or name what was altered."""
    from station.cli.verifying import verify_runs

    raise typer.Exit(verify_runs(runs, as_json=json))


def add_to(app: typer.Typer) -> None:
    """Add the verbs to the command line."""
    app.command()(sim)
    app.command()(panel)
    app.command()(verify)
