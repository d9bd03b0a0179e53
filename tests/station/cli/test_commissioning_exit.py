"""The exit code of a commissioning, resumed or not."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from station.cli.running import leave_nothing_untried
from station.findings import NOT_TRIED, Flag
from station.runner.outcome import Outcome


@pytest.mark.parametrize(
    ("before", "untried", "after"),
    [(0, True, 3), (6, True, 3), (0, False, 0), (1, True, 1), (4, True, 4), (5, True, 5)],
)
def test_what_was_not_tried_proves_no_bench(before: int, untried: bool, after: int) -> None:
    document: Any = SimpleNamespace(flags=[Flag(NOT_TRIED, "L2 was not tried.")] * untried)
    outcome = Outcome(Path("run"), exit_code=before, document=document)
    leave_nothing_untried(outcome)
    assert outcome.exit_code == after
