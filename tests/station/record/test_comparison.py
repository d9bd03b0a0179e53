"""Two runs side by side."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from station.cli.comparing import compare_runs, lines
from station.errors import DamagedRecord, InputError
from station.record.comparison import compare


@pytest.fixture
def pair(run_of: Callable[[str], Path], tmp_path: Path) -> tuple[Path, Path]:
    first = run_of("rlg-magnetic-sensitivity")
    second = Path(shutil.copytree(first, tmp_path / "other"))
    results = second / "results.json"
    data = json.loads(results.read_text(encoding="utf-8"))
    data["results"][0]["value"] += 5.0 * data["results"][0]["standard_uncertainty"]
    data["results"][1]["value"] = None
    results.write_text(json.dumps(data), encoding="utf-8")
    plan = second / "plan.resolved.yaml"
    text = plan.read_text(encoding="utf-8")
    plan.write_text(text.replace("amplitude: 1 mT", "amplitude: 2 mT"), encoding="utf-8")
    return first, second


def test_what_differs_is_named_and_results_are_in_units_of_u(pair: tuple[Path, Path]) -> None:
    found = compare(*pair)
    assert [one.where for one in found.plan] == ["parameters.amplitude"]
    assert (found.instruments, found.software) == ((), ())
    moved, lost = found.results
    assert moved.in_u == pytest.approx(5.0 / 2**0.5)
    assert (lost.difference, lost.in_u) == (None, None)
    assert found.results[0].first is not None
    said = "\n".join(lines(found))
    assert "parameters.amplitude  1 mT  2 mT" in said
    assert "alike in both" in said
    assert "undetermined" in said


def test_a_run_without_results_is_refused_by_name(pair: tuple[Path, Path]) -> None:
    (pair[1] / "results.json").unlink()
    with pytest.raises(InputError, match="no results to compare"):
        compare(*pair)
    with pytest.raises(InputError, match="no run folder"):
        compare(pair[0], pair[1] / "raw")


@pytest.mark.parametrize(
    "file", ["results.json", "plan.resolved.yaml", "bench.resolved.yaml", "run.json"]
)
def test_nothing_that_was_altered_is_compared(
    file: str, run_of: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = run_of("rlg-magnetic-sensitivity")
    compare_runs(first, first, as_json=False)
    assert "alike in both" in capsys.readouterr().out
    second = Path(shutil.copytree(first, tmp_path / "other"))
    (second / file).write_text((second / file).read_text(encoding="utf-8") + " ", encoding="utf-8")
    with pytest.raises(DamagedRecord, match="station verify"):
        compare_runs(first, second, as_json=False)
    assert not capsys.readouterr().out
