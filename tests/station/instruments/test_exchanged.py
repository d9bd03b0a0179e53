"""An instrument that answers in another's place is named: exchanged cables, or one unit twice."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from plan_runs import run_of, shipped_bench, shipped_plan

X, Z = "coil_supply.x", "coil_supply.z"


def exchanged(bench: dict[str, Any]) -> None:
    one, other = bench["instruments"][X], bench["instruments"][Z]
    one["serial"], other["serial"] = other["serial"], one["serial"]
    for entry, serial in ((one, other["serial"]), (other, one["serial"])):
        entry["simulator"]["serial"] = serial


def one_unit_twice(bench: dict[str, Any]) -> None:
    bench["instruments"][Z]["simulator"]["serial"] = bench["instruments"][X]["serial"]


@pytest.mark.parametrize(
    ("plant", "sentences"),
    [
        (
            exchanged,
            [
                f"{X}: serial number H148201 answers",
                f"it is that of {Z}, which answers with this one's: the two are exchanged",
                f"it is that of {X}, which answers with this one's: the two are exchanged",
            ],
        ),
        (
            one_unit_twice,
            [f"{X} answers with it, too: the addresses of both lead to one instrument"],
        ),
    ],
)
def test_who_answers_in_whose_place(
    plant: Callable[[dict[str, Any]], None], sentences: list[str], tmp_path: Path
) -> None:
    bench = shipped_bench()
    plant(bench)
    outcome = run_of(tmp_path, shipped_plan("commissioning"), bench)
    assert outcome.exit_code == 3
    for sentence in sentences:
        assert sentence in str(outcome.error), outcome.error


def test_a_stranger_is_named_as_before(tmp_path: Path) -> None:
    bench = shipped_bench()
    bench["instruments"][X]["simulator"]["serial"] = "H999999"
    outcome = run_of(tmp_path, shipped_plan("commissioning"), bench)
    assert "connect the right instrument or correct the bench file" in str(outcome.error)
    assert "it is that of" not in str(outcome.error)
