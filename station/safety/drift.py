"""A bench that has drifted since its commissioning is refused until somebody has looked."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from station.console import tell
from station.safety.acknowledgement import remember

if TYPE_CHECKING:
    from station.results import ResultDocument

DRIFT = "drift"
"""The result of a weekly check: a figure's change over what is allowed."""


def remember_drift(
    attached: Mapping[str, tuple[str, str]] | None,
    bench_file: Path,
    document: ResultDocument | None,
    run: Path,
) -> None:
    """Keep a bench from being used, as a tripped interlock does, where a figure has drifted.

    `attached` are its instruments, address to model and serial; None of a simulated bench.
    """
    drifted = [
        result.estimate.axis or ""
        for result in (document.results if document else ())
        if result.estimate.name == DRIFT and result.decision.verdict == "fail"
    ]
    if not drifted:
        return
    message = f"{', '.join(drifted)} drifted since the bench was commissioned"
    try:
        remember(bench_file, DRIFT, message, run, attached)
    except OSError as error:
        tell(f"the drift cannot be noted ({error}); do not use the bench until its cause is known")
