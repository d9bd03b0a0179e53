"""The table of bad input, from the cases that the tests try."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from tables import code, table

CASES = Path(__file__).parent.parent.parent / "tests" / "bad_input.yaml"


def bad_input() -> str:
    """Return the cases as a table: what is wrong, command, exit code, what is said."""
    cases = yaml.safe_load(CASES.read_text(encoding="utf-8"))
    rows = (
        (case["name"], code(f"station {case['command']}"), str(case["exit"]), said(case))
        for case in cases
    )
    return table(("what is wrong", "command", "exit code", "the sentence holds"), rows)


def said(case: dict[str, Any]) -> str:
    """Return what a case's message holds, as it can be compared."""
    return code(case["says"])
