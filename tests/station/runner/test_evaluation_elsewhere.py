"""A recorded run is read, evaluated and reported where no driver package is installed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import copytree

import pytest
from tiers import quick

from station import registry
from station.files.faults import FaultList
from station.record.folder import RESULTS, RunFolder
from station.report.run_report import report_of_run
from station.runner.evaluation import evaluate_run
from station.runner.resuming import ResumeRequest, resume

PLANS = (
    "rlg-magnetic-sensitivity",
    "accelerometer-magnetic-sensitivity",
    "serf-nonorthogonality",
    "fog-scale-factor-temperature",
    "nine-axis-calibration",
)


@pytest.fixture
def without_drivers(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    """Return what takes every driver and simulator away from the registry."""

    def take_away() -> None:
        offered, odd = registry.offers()
        groups = (registry.DRIVERS, registry.SIMULATORS)
        kept = {group: entries for group, entries in offered.items() if group not in groups}
        monkeypatch.setattr(registry, "offers", lambda: (kept, odd))
        forget()

    yield take_away
    monkeypatch.undo()
    forget()


def forget() -> None:
    registry.names.cache_clear()
    registry.load.cache_clear()


@pytest.mark.parametrize("plan", quick(PLANS, *PLANS[:2]))
def test_a_run_is_evaluated_and_reported_where_no_driver_is_installed(
    plan: str, run_of: Callable[[str], Path], without_drivers: Callable[[], None]
) -> None:
    path = run_of(plan)
    without_drivers()
    assert registry.names(registry.DRIVERS) == ()
    folder = RunFolder(path)
    document, _ = evaluate_run(folder)
    assert document.to_data() == json.loads((path / RESULTS).read_text(encoding="utf-8"))
    assert folder.run_facts()["station"] in report_of_run(folder, document, ())


def test_a_run_does_not_go_on_where_its_drivers_are_not_installed(
    tmp_path: Path, run_of: Callable[[str], Path], without_drivers: Callable[[], None]
) -> None:
    folder = tmp_path / "run"
    copytree(run_of(PLANS[0]), folder)
    without_drivers()
    with pytest.raises(FaultList, match="there is no driver 'kepco-bop-36-12'"):
        resume(ResumeRequest(folder))
