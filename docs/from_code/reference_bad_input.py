"""The table of bad input, from the cases that the tests try."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from tables import code, table

CASES = Path(__file__).parents[2] / "tests/station/files/bad_input.yaml"


def bad_input() -> str:
    """Return the cases as a table: what is wrong, command, exit code, what is said."""
    cases = yaml.safe_load(CASES.read_text(encoding="utf-8"))
    rows = (
        (
            case["name"],
            wrong_in(case),
            code(f"station {case['command']}"),
            code(case["exit"]),
            code(str(case["says"]).strip()),
        )
        for case in cases
    )
    return table(("fault", "what is wrong", "command", "code", "the message holds"), rows)


def wrong_in(case: dict[str, Any]) -> str:
    """Say what a case changes in files that are right otherwise."""
    if "change" in case:
        new = " ".join(str(case["change"][1]).split())
        file = code(case["file"])
        return f"{code(new)} in {file}" if len(new) > 1 else f"a part of {file} is gone"
    if "remove" in case:
        return f"{code(case['remove'])} is gone"
    return f"other lines in {code(case['file'])}" if "lines" in case else ""
