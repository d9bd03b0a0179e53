"""A bench that has drifted since its commissioning is refused until somebody has looked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from station.console import tell
from station.safety.acknowledgement import remember

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.results import ResultDocument

DRIFT = "drift"
"""The result of a weekly check: a figure's change over what is allowed."""


def remember_drift(
    bench: Bench, bench_file: Path, document: ResultDocument | None, run: Path
) -> None:
    """Keep a bench from being used, as a tripped interlock does, where a figure has drifted."""
    drifted = [
        result.estimate.axis or ""
        for result in (document.results if document else ())
        if result.estimate.name == DRIFT and result.decision.verdict == "fail"
    ]
    if not drifted:
        return
    message = f"{', '.join(drifted)} drifted since the bench was commissioned"
    try:
        remember(bench_file, DRIFT, message, run, instruments_of(bench))
    except OSError as error:
        tell(f"the drift cannot be noted ({error}); do not use the bench until its cause is known")


def instruments_of(bench: Bench) -> dict[str, tuple[str, str]] | None:
    """Return the instruments of a real bench, address to model and serial; None of another."""
    if bench.simulation is not None:
        return None
    return {
        entry.address: ("", entry.serial or "")
        for entry in bench.instruments.values()
        if entry.address
    }
