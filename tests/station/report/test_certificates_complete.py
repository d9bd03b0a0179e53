"""A complete plan on a complete bench makes a certificate of every procedure."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from quick_yaml import dump_yaml
from short_forms import SHORT_FORMS, bench_data, read_bench_at
from tiers import quick

from station.cli.validating import read_plan_for
from station.record.folder import RunFolder
from station.report.certificate import certificate_of_run
from station.runner.evaluation import evaluate_run
from station.runner.execute import Request, execute

READ = {"instrument": "Testo 622, 4711", "certificate": "K-118", "due": "2130-01-31"}
PLAN: Mapping[str, Any] = {
    "operator": "A. Reader",
    "customer": {"name": "Ring Gyros Ltd", "address": "2 Ring Road, Oldtown"},
    "references": {"order": "PO-4711", "work_instruction": "WI-12 rev. 3"},
    "room": {"temperature": {"value": "21.3 degC", "uncertainty": "0.2 degC", **READ}},
    "dut": {"received": "2026-01-05", "condition": "no damage"},
}
LABORATORY = {
    "name": "Inertial Laboratory",
    "address": "1 Field Road, Newtown",
    "location": "Room 7",
    "signatories": [{"name": "B. Head", "function": "head of the laboratory"}],
}
RECORDS: Mapping[str, Mapping[str, Any]] = {
    "gaussmeter": {"quantity": "angle", "up_to": "5 deg", "absolute": "1 deg"},
    "navigator": {"quantity": "temperature", "up_to": "100 degC", "absolute": "0.5 degC"},
}
"""What certificates state that the records of the shipped bench do not."""
LATITUDE = {"latitude_uncertainty": "1 arcmin"}
STATED: Mapping[str, Mapping[str, Any]] = {
    "rlg-magnetic-sensitivity": {},
    "accelerometer-magnetic-sensitivity": {
        "local_gravity_uncertainty": "20e-6 g",
        "ambient_field": "0.05 mT",
    },
    "accelerometer-tumble": {},
    "serf-nonorthogonality": {"coil_constants": "known"},
    "fog-scale-factor-temperature": {"drive": LATITUDE},
    "nine-axis-calibration": LATITUDE,
    "nine-axis-calibration-coil": LATITUDE,
    "gyro-static-noise": LATITUDE,
    "gyro-rate-table": LATITUDE,
    "gyro-bias-temperature": LATITUDE,
}
"""What the plans of procedures state that the shipped ones do not."""

DETERMINES_NOTHING = {"gyro-bias-temperature"}
"""Short forms that are too short for any result."""
SIMULATED = "The bench is simulated"


@pytest.mark.parametrize("name", quick(STATED, "serf-nonorthogonality", "nine-axis-calibration"))
def test_a_complete_plan_on_a_complete_bench_is_a_draft_for_its_simulation_alone(
    name: str, tmp_path: Path
) -> None:
    bench = bench_data() | {"laboratory": LABORATORY}
    used = RECORDS if "magnetic" in name or name.startswith("fog") else {}
    for instrument, entry in used.items():
        record = bench["instruments"][instrument].setdefault(
            "calibration", {"certificate": "K-7", "date": "2026-01-15", "due": "2036-01-15"}
        )
        record.setdefault("uncertainty", []).append({**entry, "coverage_factor": 2})
    for entry in bench["instruments"].values():
        if "calibration" in entry:
            entry["calibration"]["calibrated_by"] = "National Institute"
    files = {"bench.yaml": bench, "plan.yaml": {"plan": 1, "extends": name, **PLAN}}
    files["plan.yaml"]["parameters"] = STATED[name]
    for file, data in files.items():
        (tmp_path / file).write_text(dump_yaml(data), encoding="utf-8")
    read = read_bench_at(tmp_path / "bench.yaml")
    plan = read_plan_for(str(tmp_path / "plan.yaml"), read, SHORT_FORMS[name])
    done = execute(Request(plan, read, tmp_path / "runs", quiet=True, report=False))
    folder = RunFolder(done.folder)
    certificate = certificate_of_run(folder, evaluate_run(folder)[0])
    reasons = certificate.draft_reasons()
    nothing = ["The result is missing"] if name in DETERMINES_NOTHING else []
    assert [reason for reason in reasons if not reason.startswith((*nothing, SIMULATED))] == []
    assert len(reasons) == 1 + len(nothing)
    assert (certificate.room[0].value, certificate.room[0].unit) == (21.3, "°C")
    assert not [row for row in certificate.ambient if "set point" in row.quantity]
