"""The nine-axis calibration from end to end on the simulated bench, in a short form."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from campaigns.truths import nine_axis_scale_factor, number

from station import registry
from station.cli.analysing import analyse_run
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.record.folder import RunFolder
from station.runner.evaluation import evaluate_run
from station.runner.execute import Request, execute
from station.runner.outcome import Outcome
from station.runner.resuming import ResumeRequest, resume

PROCEDURE = "nine-axis-calibration"
RATES = (15.0, 30.0, 45.0, 60.0, 100.0)
SHORT: dict[str, Any] = {
    "warm_up": "10 s",
    "static_time": "2 min",
    "sample_rate": "10 Hz",
    "settle": "1 s",
    "rates": [f"{rate:g} deg/s" for rate in RATES],
}
COMBINED = 4.0


def short_run(
    folder: Path,
    seed: int,
    *faults: dict[str, str],
    saturates: str = "",
    table: Any = None,
    **changes: Any,
) -> tuple[Outcome, dict[str, Any]]:
    """Run the short form; return the truth of the gyros beside it."""
    plan = yaml.safe_load(find(PLANS, PROCEDURE).read_text(encoding="utf-8"))
    bench = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))
    plan["parameters"] |= SHORT | changes
    bench["simulation"] |= {"seed": seed, "faults": list(faults)}
    bench["simulation"]["nine_axis"]["sensor"]["warm_up"]["bias"] = "0 deg/h"
    gyros = bench["simulation"]["nine_axis"]["sensor"]["gyros"]
    gyros["range"] = saturates or gyros["range"]
    folder.mkdir(exist_ok=True)
    bench["instruments"]["turntable"]["settings"] |= table or {}
    (folder / "plan.yaml").write_text(yaml.safe_dump(plan), encoding="utf-8")
    (folder / "bench.yaml").write_text(yaml.safe_dump(bench), encoding="utf-8")
    outcome = execute(
        Request(
            read_plan(folder / "plan.yaml", Procedures()),
            read_bench(folder / "bench.yaml", registry.names(registry.DRIVERS)),
            folder / "runs",
            quiet=True,
            report=False,
        )
    )
    return outcome, gyros


def off_in_u(
    outcome: Outcome, gyros: dict[str, Any], rates: Sequence[float] = RATES
) -> dict[tuple[str, str], float]:
    """Return by how many standard uncertainties results are off; the simulated clock is right."""
    assert outcome.document is not None, outcome.error
    off = {}
    for one in outcome.document.results:
        estimate = one.estimate
        true = truth(gyros, estimate.name, str(estimate.axis), rates)
        if true is None:
            continue
        assert estimate.value is not None
        assert one.combined is not None
        u = one.combined.standard_uncertainty
        if estimate.name == "scale_factor":
            assert estimate.standard_uncertainty is not None
            u = estimate.standard_uncertainty  # the simulated clock is right
        off[estimate.name, str(estimate.axis)] = abs(estimate.value - true) / u
    return off


def truth(gyros: dict[str, Any], name: str, axis: str, rates: Sequence[float]) -> float | None:
    """Return what a result should be; None where the world has no one number for it."""
    if name == "scale_factor":
        return nine_axis_scale_factor(gyros[axis.lower()], rates)
    if name == "misalignment":
        return number(gyros["misalignment"][axis.lower()])
    return number(gyros[axis.lower()][name]) if name in ("bias", "asymmetry") else None


def codes(outcome: Outcome) -> set[str]:
    """Return the codes of the flags."""
    assert outcome.document is not None
    return {flag.code for flag in outcome.document.flags}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Outcome, dict[str, Any]]:
    """One short run by the table."""
    return short_run(tmp_path_factory.mktemp("nine"), seed=1)


def test_biases_and_scale_factors_come_back(run: tuple[Outcome, dict[str, Any]]) -> None:
    outcome, gyros = run
    assert outcome.exit_code == 0, outcome.error
    off = off_in_u(outcome, gyros)
    assert len(off) == 9 + 6
    assert max(off.values()) < COMBINED, off


@pytest.mark.campaign
def test_they_come_back_from_the_plate_with_a_flip_and_other_noise(tmp_path: Path) -> None:
    outcome, gyros = short_run(tmp_path, 2, positioning="plate", flip=True)
    assert outcome.exit_code == 0, outcome.error
    off = off_in_u(outcome, gyros)
    assert max(off.values()) < COMBINED, off
    asked = [one.details["id"] for one in RunFolder(outcome.folder).events_of("prompt")]
    assert asked[0] == "pose-1"
    assert asked[-4:-1] == ["mount-X-up", "mount-Y-up", "mount-Z-up"]


def test_every_record_is_whole_turns_with_all_nine_axes(
    run: tuple[Outcome, dict[str, Any]],
) -> None:
    folder = RunFolder(run[0].folder)
    units = folder.finished_units()
    assert len(units) == 3 + 30
    assert "part-turns" not in codes(run[0])
    rows = folder.rows("imu", "position 1")
    names = rows.dtype.names
    assert names is not None
    for kind in ("gyro", "accelerometer", "magnetometer"):
        own = [name for name in names if name.startswith(f"{kind}_")]
        assert len(own) == 3
        assert all(np.isfinite(rows[name]).sum() > len(rows) / 8 for name in own)


def test_a_new_analysis_gives_the_same_bytes(run: tuple[Outcome, dict[str, Any]]) -> None:
    folder = run[0].folder
    analyse_run(folder, None, compare=False)
    again = (folder / "revisions" / "001" / "results.json").read_bytes()
    assert again == (folder / "results.json").read_bytes()


@pytest.mark.campaign
def test_a_silent_sensor_ends_a_run_that_then_goes_on_with_saturated_rates_left_out(
    tmp_path: Path,
) -> None:
    silence = {"instrument": "imu", "fault": "silent", "at": "600 s", "for": "15 s"}
    ended, gyros = short_run(tmp_path, 4, silence, saturates="95 deg/s")
    assert ended.exit_code == 3
    before = RunFolder(ended.folder).finished_units()
    assert len(before) > 5
    outcome = resume(ResumeRequest(ended.folder, quiet=True, report=False))
    assert outcome.exit_code == 0, outcome.error
    units = RunFolder(ended.folder).finished_units()
    assert {name: units[name] for name in before} == before
    assert len(units) == 3 + 30
    assert outcome.document is not None
    (over,) = [one for one in outcome.document.flags if (one.code, one.axis) == ("overload", "X")]
    assert over.details["rates"] == [100.0, -100.0]
    assert max(off_in_u(outcome, gyros, RATES[:-1]).values()) < COMBINED


def test_a_sensor_that_repeats_one_output_ends_the_run(tmp_path: Path) -> None:
    outcome, _ = short_run(tmp_path, 6, {"instrument": "imu", "fault": "frozen", "at": "60 s"})
    assert outcome.exit_code == 3
    assert outcome.error is not None
    assert outcome.error.startswith("imu: record position 1: ")
    assert "outputs in a row hold the same six rates and specific forces" in outcome.error
    assert "position 1" not in RunFolder(outcome.folder).finished_units()


def test_a_wrong_pose_is_measured_again_and_refused_and_a_wrong_axis_up_ends_the_run(
    tmp_path: Path,
) -> None:
    swapped = {"middle_axis": 3, "inner_axis": 2}
    outcome, _ = short_run(tmp_path, 5, table=swapped, static_time="30 s")
    assert outcome.exit_code == 3
    assert outcome.error is not None
    assert outcome.error.startswith("gyro X of imu reads")
    assert "look how the sensor is mounted" in outcome.error
    folder = RunFolder(outcome.folder)
    refused = [one.details for one in folder.events_of("pose-refused")]
    assert [(one["unit"], one["attempt"]) for one in refused] == [("position 3", n) for n in (1, 2)]
    assert refused[0]["why"] == "the accelerometers are 1 g off"
    document, _ = evaluate_run(folder)
    assert [f.details["position"] for f in document.flags if f.code == "wrong-position"] == [3]
