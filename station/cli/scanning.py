"""`station scan`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from station.cli.running import read_served
from station.errors import EXIT_DONE, EXIT_FAULT
from station.instruments.scan import scan
from station.instruments.scan_draft import draft


def print_scan(hosts: Sequence[str], library: str, served: Path | None, *, as_json: bool) -> int:
    """Print what is attached on standard error and a bench-file draft on standard output.

    Returns exit code 3 when nothing answers.
    """
    seen = scan(hosts, library, read_served(served) if served else None)
    answered = any(one.answered for one in seen)
    if as_json:
        found = [vars(one) for one in seen]
        print(json.dumps({"seen": found, "draft": draft(seen)}, indent=1, ensure_ascii=False))
    else:
        for one in seen:
            mark = "     " if not one.answered else "ok   " if one.driver else "?    "
            told = f"{one.driver}: {one.said}" if one.driver else one.said
            print(f"{mark} {one.address:<36} {told}", file=sys.stderr)
        print(draft(seen), end="")
    if not answered:
        print(
            "nothing answers; switch the instruments on, or name hosts with --host", file=sys.stderr
        )
    return EXIT_DONE if answered else EXIT_FAULT
