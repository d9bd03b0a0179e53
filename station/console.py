"""Messages to the operator; a terminal that is gone ends no run."""

from __future__ import annotations

import sys


def tell(text: str) -> None:
    """Write a line to standard error, or nothing where nobody reads it any more."""
    try:
        print(text, file=sys.stderr, flush=True)
    except (OSError, ValueError):  # a broken pipe, a closed terminal: the record tells it all
        return
