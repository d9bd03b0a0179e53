"""A short run whose certificate is filled in: a draft for its simulated bench alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from command_line import PLAN
from places import SIM
from quick_yaml import dump_yaml, load_yaml

from station import registry
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.record.folder import RunFolder
from station.runner.execute import Request, execute

LABORATORY = {
    "name": "Inertial Laboratory",
    "address": "1 Field Road, Newtown",
    "location": "Room 7",
    "signatories": [{"name": "B. Head", "function": "head of the laboratory"}],
}
FILLED_IN = {
    "operator": "A. Reader",
    "customer": {"name": "Ring Gyros Ltd", "address": "2 Ring Road, Oldtown"},
    "references": {"order": "PO-4711", "work_instruction": "WI-12 rev. 3", "drawing": "D-9"},
    "deviations": ["The warm-up ended early."],
}
ON_PROBE = {"quantity": "angle", "up_to": "5 deg", "absolute": "1 deg", "coverage_factor": 2}
"""How far the gaussmeter's axes are off: without it a part of u is not stated."""
THERMOMETER = {"instrument": "Testo 622, 4711", "certificate": "K-118", "due": "2130-01-31"}
ROOM = {
    "temperature": {"value": "21.3 degC", "uncertainty": "0.2 degC", **THERMOMETER},
    "humidity": {"uncertainty": "2 %", **THERMOMETER},
}
TYPED = {"room.humidity": "45 %"}
FIELD = {"quantity": "field", "up_to": "35 mT", "relative": "0.5 %", "coverage_factor": 2}


def measured(
    folder: Path,
    calibration: Mapping[str, Any] | None,
    further: Mapping[str, Any] | None = None,
    answers: Mapping[str, str] | None = None,
) -> RunFolder:
    """Run the short plan on a simulated bench whose gaussmeter has this record, or none."""
    plan = load_yaml(PLAN) | FILLED_IN | dict(further or {})
    plan["dut"] |= {"received": "2026-01-05", "condition": "no damage"}
    plan["parameters"] |= {"duration": "50 s", "frequency": "0.2 Hz"}
    bench = load_yaml(SIM.read_text(encoding="utf-8")) | {"laboratory": LABORATORY}
    for name, entry in bench["instruments"].items():
        if "calibration" in entry:
            entry["calibration"]["calibrated_by"] = f"National Institute, {name}"
    gaussmeter = bench["instruments"]["gaussmeter"]
    if calibration is None:
        del gaussmeter["calibration"]
    else:
        gaussmeter["calibration"]["uncertainty"].append(ON_PROBE)
        gaussmeter["calibration"] |= calibration
    folder.mkdir()
    for name, data in (("plan", plan), ("bench", bench)):
        (folder / f"{name}.yaml").write_text(dump_yaml(data), encoding="utf-8")
    drivers = registry.names(registry.DRIVERS)
    read = read_plan(folder / "plan.yaml", Procedures()), read_bench(folder / "bench.yaml", drivers)
    request = Request(*read, folder, quiet=True, report=False, answers=answers or {})
    return RunFolder(execute(request).folder)
