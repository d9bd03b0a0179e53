"""What keeps a run from being started from the panel is said before the button works."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import cast

import pytest
import yaml

from station.cli.starting import DetachedRuns
from station.errors import InputError
from station.files.lookup import BENCHES, find
from station.panel.access import Role
from station.panel.starting import Wanted

WANTED = Wanted("rlg-magnetic-sensitivity", "real", "SN-1", "")


@pytest.fixture
def real_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The simulated bench as a real one, at addresses where nothing listens."""
    bench = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))
    del bench["simulation"]
    bench["name"] = "real"
    for number, entry in enumerate(bench["instruments"].values()):
        entry.pop("simulator", None)
        entry["address"] = f"TCPIP0::127.0.0.1::{number + 1}::SOCKET"
    path = tmp_path / "config" / "benches" / "real.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(yaml.safe_dump(bench, sort_keys=False), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return path


def test_instruments_that_do_not_answer_are_named_before_a_run(
    real_bench: Path, tmp_path: Path
) -> None:
    looked = DetachedRuns(tmp_path / "runs").look(WANTED, "operator")
    silent = {fault.partition(":")[0]: fault for fault in looked["faults"]}
    assert set(silent) >= {"coil_supply.x", "coil_supply.y", "coil_supply.z", "gaussmeter"}
    assert "turntable" not in silent  # the plan does not use it
    assert "check that nobody else uses the instrument" in silent["gaussmeter"]
    assert looked["steps"], "what the run would do is shown all the same"


def test_an_operator_resumes_no_run_of_a_plan_that_is_not_released(
    one_axis_run: Path, tmp_path: Path
) -> None:
    run = shutil.copytree(one_axis_run, tmp_path / one_axis_run.name)
    for role, words in (("operator", "not released"), ("engineer", "was changed since")):
        plan = run / "plan.resolved.yaml"
        text = plan.read_text(encoding="utf-8").replace("released: true", "released: false")
        plan.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=words):
            DetachedRuns(tmp_path).resume(run, cast("Role", role))
