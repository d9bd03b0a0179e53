"""What the station says to bad input, from the table that the tests try."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from tables import code, table

CASES = Path(__file__).parents[2] / "tests" / "bad_input.yaml"


def bad_input() -> str:
    """Return the table of bad input: what is wrong, the command, the exit code, the message."""
    cases = yaml.safe_load(CASES.read_text(encoding="utf-8"))
    rows = [
        (case["name"], wrong_in(case), code(case["command"]), code(case["exit"]), code(case["says"]))
        for case in cases
    ]
    return table(("fault", "what is wrong", "command", "code", "the message holds"), rows)


def wrong_in(case: dict[str, Any]) -> str:
    """Say what a case changes in the files that are right otherwise."""
    if "change" in case:
        new = " ".join(str(case["change"][1]).split())
        return f"{code(new)} in {code(case['file'])}" if new else f"a part of {case['file']} is gone"
    if "remove" in case:
        return f"{code(case['remove'])} is gone"
    return f"other lines in {code(case['file'])}" if "lines" in case else ""
