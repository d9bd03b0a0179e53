"""Messages to the operator; a terminal that is gone ends no run."""

from __future__ import annotations

import sys


def tell(text: str) -> None:
    """Write a line to standard error, or nothing where nobody reads it any more."""
    try:
        print(text, file=sys.stderr, flush=True)
    except (OSError, ValueError):  # a broken pipe, a closed terminal: the record tells it all
        return


def span(seconds: float) -> str:
    """Return a span of time for a person: `45 s`, `12 min 30 s`, `5 h 10 min`."""
    whole = round(max(seconds, 0.0))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
