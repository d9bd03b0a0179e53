"""The resolved plan says every value and its origin, and a run folder needs nothing else."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from station import registry
from station.cli.app import app
from station.files.lookup import BENCHES, find
from station.files.plan import plan_of, read_plan
from station.files.yaml.reading import read_yaml_text
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.record.folder import RunFolder
from station.runner.evaluation import read_plan_and_bench
from station.runner.execute import Request, execute

BASE = """\
extends: rlg-magnetic-sensitivity
vars: {drive: 0.1 Hz}
parameters:
  frequency: ${drive}
  duration: 200 s
  axes: [IA]
  warm_up: {slope_limit: 10 deg/h^2, window: 1 min, at_most: 5 min}
"""
PLAN = """\
extends: base
title: "一个轴: # no comment"
vars: {drive: 0.2 Hz}
parameters:
  duration: 100 s
"""


@pytest.fixture(autouse=True)
def two_plans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "base.yaml").write_text(BASE, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    return tmp_path


def command(*arguments: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, arguments)
    return done.exit_code, done.stdout, done.stderr


def origin_of(text: str, line: str) -> str:
    """Return the comment beside a line of YAML."""
    lines = [one.split("  # ") for one in text.splitlines() if "  # " in one]
    found = [said for *before, said in lines if "  # ".join(before).strip() == line]
    assert len(found) == 1, (line, text)
    return found[0]


def test_each_value_is_printed_with_its_origin() -> None:
    exit_code, text, _ = command(
        "validate", "plan.yaml", "--resolved", "--set", "parameters.amplitude=0.5 mT"
    )
    assert exit_code == 0
    shipped = "rlg-magnetic-sensitivity.yaml"
    assert origin_of(text, "frequency: 0.2 Hz") == "vars.drive, plan.yaml:3"
    assert origin_of(text, "duration: 100 s") == "plan.yaml:5"
    assert origin_of(text, "- IA") == "base.yaml:6"
    assert origin_of(text, "amplitude: 0.5 mT") == "--set"
    assert origin_of(text, "gap: 1.5") == "default"
    assert origin_of(text, "sample_interval: 0.1 s").startswith(f"{shipped}:")
    aligned = [line for line in text.splitlines()[5:] if "  # " in line and line.isascii()]
    assert len({line.rindex("  # ") for line in aligned}) == 1


def test_what_is_printed_is_a_plan_of_the_same_content() -> None:
    procedures = Procedures()
    _, text, _ = command("validate", "plan.yaml", "--resolved")
    plan = read_plan(Path("plan.yaml"), procedures)
    again = plan_of(read_yaml_text(text, Path("again.yaml")), procedures)
    assert again.to_yaml_data() == plan.to_yaml_data()
    assert again.title == "一个轴: # no comment"
    assert again.limits_by_axis() == plan.limits_by_axis()


def test_several_plans_are_several_documents_and_a_faulty_one_is_told_beside_them() -> None:
    Path("wrong.yaml").write_text("extends: base\ntitel: x\n", encoding="utf-8")
    exit_code, text, told = command(
        "validate", "plan.yaml", "wrong.yaml", "base.yaml", "--resolved"
    )
    assert exit_code == 2
    documents = text.split("---\n")
    assert [one.splitlines()[0] for one in documents] == [
        "# plan.yaml, resolved",
        "# base.yaml, resolved",
    ]
    assert told.splitlines() == ["wrong.yaml:2:1: titel: is not known here; did you mean 'title'"]


def test_as_json_values_and_origins_stand_in_the_one_document() -> None:
    exit_code, text, _ = command("validate", "plan.yaml", "base.yaml", "--resolved", "--json")
    assert exit_code == 0
    document: dict[str, Any] = json.loads(text)
    plan = document["resolved"][0]
    assert plan["values"]["parameters"]["axes"] == ["IA"]
    assert plan["origins"]["parameters.axes[1]"] == "base.yaml:6"
    assert plan["origins"]["parameters.thresholds.gap"] == "default"
    assert len(document["resolved"]) == 2


def test_a_fault_that_plans_share_is_told_once() -> None:
    exit_code, _, told = command("validate", "plan.yaml", "base.yaml", "--set", "titel=x")
    assert exit_code == 2
    assert told.splitlines() == ["--set:1:1: titel: is not known here; did you mean 'title'"]


def test_the_run_folder_alone_gives_the_plan_that_was_run(two_plans: Path) -> None:
    plan = read_plan(Path("plan.yaml"), Procedures(), ["parameters.amplitude=0.5 mT"])
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    outcome = execute(Request(plan, bench, two_plans / "runs", quiet=True, report=False))
    assert outcome.exit_code in (0, 1, 6), outcome.error
    elsewhere = two_plans / "elsewhere" / "run"
    shutil.copytree(outcome.folder, elsewhere)
    for name in ("plan.yaml", "base.yaml"):
        Path(name).unlink()

    folder = RunFolder(elsewhere)
    again, bench_again = read_plan_and_bench(folder)
    assert again.to_yaml_data() == plan.to_yaml_data()
    assert bench_again.file == bench.file
    assert (elsewhere / "plan.yaml").read_text(encoding="utf-8") == PLAN
    assert folder.run_facts()["set"] == ["parameters.amplitude=0.5 mT"]
    exit_code, text, _ = command("analyse", str(elsewhere), "--json")
    assert exit_code == outcome.exit_code
    stored = (elsewhere / "results.json").read_text(encoding="utf-8")
    assert json.loads(text) == json.loads(stored)
