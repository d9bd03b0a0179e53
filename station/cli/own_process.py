"""Where a run gets a process of its own, this command only shows it."""

from __future__ import annotations

import sys

import typer


def leave_to_own_process(*, non_interactive: bool, as_json: bool, detach: bool = False) -> None:
    """End this command with the run's own process, where it gets one; else return."""
    if detach or sys.stdin.isatty():
        from station.cli.attaching import run_elsewhere

        code = run_elsewhere(
            sys.argv[1:], detach=detach, non_interactive=non_interactive, as_json=as_json
        )
        if code is not None:
            raise typer.Exit(code)
