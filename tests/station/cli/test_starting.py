"""What keeps a run from being started from the panel is said before the button works."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from station.cli.starting import DetachedRuns
from station.files.lookup import BENCHES, find
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
