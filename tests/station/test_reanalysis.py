"""Many runs evaluated again: one table, a recalled certificate, what cannot be evaluated."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from command_line import PLAN
from distributed import LocalCluster
from made_runs import made_run
from places import SIM
from pyarrow import parquet
from quick_yaml import dump_yaml, load_yaml

from station import registry
from station.cli.analysing import analyse_data
from station.cli.app import app
from station.cli.reanalysing import analyse_store, refuse_without_all, run_folders
from station.errors import InputError
from station.files.faults import FaultList
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.reanalysis import scheduling
from station.reanalysis.one_run import rows_of_run
from station.reanalysis.recall import read_recall
from station.runner.evaluation import conclude_run

RECALL = {
    "replaces": "SIM-F71-0001",
    "calibration": {
        "certificate": "SIM-F71-0002",
        "due": "2099-01-01",
        "corrections": [{"quantity": "field", "gain": 1.01}],
        "uncertainty": [
            {"quantity": "field", "up_to": "10 mT", "relative": "0.5 %", "coverage_factor": 2}
        ],
    },
}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two runs, below each other's shelf, and one whose bench was altered."""
    place = tmp_path_factory.mktemp("store")
    plan_file = place / "plan.yaml"
    data = load_yaml(PLAN)
    data["parameters"] |= {"duration": "50 s", "frequency": "0.2 Hz"}
    plan_file.write_text(dump_yaml(data), encoding="utf-8")
    bench = read_bench(SIM, registry.names(registry.DRIVERS))
    run = made_run(place / "a", read_plan(plan_file, Procedures()), bench)
    conclude_run(run, report=False)
    shutil.copytree(run, place / "shelf" / "b" / run.name)
    altered = place / "c" / run.name
    shutil.copytree(run, altered)
    (altered / "bench.resolved.yaml").write_text("name: sim\n", encoding="utf-8")
    return place


def recalled(folder: Path, **changed: Any) -> Path:
    file = folder / "recall.yaml"
    file.write_text(dump_yaml({**RECALL, **changed}), encoding="utf-8")
    return file


def test_every_run_of_a_store_is_in_one_table_as_it_is_alone(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        LocalCluster(n_workers=1, processes=False, protocol="tcp", dashboard_address=None) as there,
        pytest.raises(SystemExit) as ended,
    ):
        words = ["analyse", "--all", str(store), "--output", str(tmp_path), "--json"]
        app([*words, "--scheduler", there.scheduler_address])
    assert ended.value.code == 2
    summary = json.loads(capsys.readouterr().out)
    assert (summary["runs"], summary["evaluated"], summary["changed"]) == (3, 2, 0)
    (failed,) = summary["failed"].items()
    assert failed[0].startswith(str(store / "c")) and "bench.resolved.yaml" in failed[1]
    rows = parquet.read_table(summary["table"]).to_pylist()
    alone = next((store / "a").glob("*/results.json"))
    digest = hashlib.sha256(alone.read_bytes()).hexdigest()
    results = json.loads(alone.read_text(encoding="utf-8"))["results"]
    good = [row for row in rows if row["error"] is None]
    assert [row["results_sha256"] for row in good] == [digest] * 2 * len(results)
    assert [row["value"] for row in good] == 2 * [entry["value"] for entry in results]


def test_a_recalled_certificate_moves_what_used_it_and_nothing_else(
    store: Path, tmp_path: Path
) -> None:
    (run,) = (store / "a").iterdir()
    rows = rows_of_run(str(run), read_recall(recalled(tmp_path)))
    for row in rows:  # a field that is 1 % larger than it was taken for
        assert row["value"] == pytest.approx(row["stored_value"] / 1.01, rel=1e-6)
        assert row["change_in_u"] != 0.0 and row["recalled"] == "gaussmeter"
    assert rows_of_run(str(run), read_recall(recalled(tmp_path, replaces="SIM-F71-0009"))) == []
    assert rows_of_run(str(run), read_recall(recalled(tmp_path, since="2099-01-01"))) == []
    assert rows_of_run(str(run), read_recall(recalled(tmp_path, since="2020-01-01"))) == rows


def test_a_certificate_that_no_run_used_is_refused_with_those_that_runs_used(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(
        InputError, match=r"certificate 'SIM-F71-001'; .*did you mean 'SIM-F71-0001'"
    ) as raised:  # before anything is evaluated
        wrong = recalled(tmp_path, replaces="SIM-F71-001")
        analyse_store(str(store / "a"), tmp_path, "tcp://nobody:1", wrong, as_json=False)
    with LocalCluster(
        n_workers=1, processes=False, protocol="tcp", dashboard_address=None
    ) as there:
        scheduler, none_since = there.scheduler_address, recalled(tmp_path, since="2099-01-01")
        assert analyse_store(str(store / "a"), tmp_path, scheduler, none_since, as_json=False) == 0
    assert "SIM-BOARD-0001" in str(raised.value)
    assert "0 of 1 runs used certificate SIM-F71-0001" in capsys.readouterr().out


def test_a_folder_of_runs_is_no_dataset(store: Path) -> None:
    with pytest.raises(InputError, match="holds 1 runs, and is neither a run nor a dataset"):
        analyse_data(store / "a", None, compare=False, as_json=False)


def test_what_will_fail_at_the_end_fails_at_the_beginning(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = tmp_path / "taken"
    taken.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="--output"):
        analyse_store(str(store), taken, "tcp://nobody:1", None, as_json=False)
    monkeypatch.setattr(scheduling, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"inertial-station\[cluster\]"):
        analyse_store(str(store), tmp_path, "tcp://nobody:1", None, as_json=False)


def test_a_wrong_recall_or_store_says_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(FaultList, match="replaces: must be text"):
        read_recall(recalled(tmp_path, **{"replaces": None}))
    with pytest.raises(InputError, match="no run folder"):
        run_folders(tmp_path)
    with pytest.raises(InputError, match="--all"):
        refuse_without_all("runs", None, tmp_path)
    with pytest.raises(InputError, match="--all"):
        refuse_without_all("s3://laboratory/runs", None, None)
