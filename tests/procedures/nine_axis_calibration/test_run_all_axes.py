"""All nine axes from one run: further poses, turns upside down, by the table and by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.truths import number
from plan_runs import run_of, shipped_bench, shipped_plan
from test_run_nine_axis import SHORT

from procedures.nine_axis_calibration import PROCEDURE
from procedures.nine_axis_calibration.directions import ending, table_angles_deg, up_of
from procedures.nine_axis_calibration.outlook import outlook
from procedures.nine_axis_calibration.parameters import NineAxisParameters
from station.record.folder import RunFolder
from station.runner.outcome import Outcome

COMPLETE = "nine-axis-calibration-complete"
WITHIN_U = 4.0
TRUTH: dict[str, Any] = {
    "gyros": {"g_sensitivity": {"xx": "0.5 deg/h/g", "yz": "-0.8 deg/h/g"}},
    "accelerometers": {
        "nonorthogonality": {"xy": "60 arcsec", "yz": "-90 arcsec"},
        "boresight": {"about_x": "80 arcsec", "about_y": "-50 arcsec", "about_z": "30 arcsec"},
        "lever_arm": {"x": "30 mm", "y": "-20 mm", "z": "10 mm"},
    },
    "magnetometers": {"misalignment": {"xy": "900 arcsec", "zx": "-600 arcsec"}},
}
SHORT_TURNS: dict[str, Any] = {
    "rates": ["20 deg/s", "40 deg/s", "60 deg/s", "80 deg/s", "100 deg/s"],
    "pose_time": "30 s",
    "turned_down_rates": ["60 deg/s"],
    "static_time": "1 min",
}


def run_with(folder: Path, truth: dict[str, Any], **changes: Any) -> Outcome:
    plan, bench = shipped_plan(COMPLETE), shipped_bench()
    plan["parameters"] |= SHORT | SHORT_TURNS | changes
    del plan["limits"]["bias"]  # of gyros that feel gravity it differs from position to position
    sensor = bench["simulation"]["nine_axis"]["sensor"]
    sensor["warm_up"]["bias"] = "0 deg/h"
    for part, errors in truth.items():
        sensor[part] |= errors
    return run_of(folder, plan, bench)


def true_values(bench: dict[str, Any]) -> dict[tuple[str, str], float]:
    """Return what the simulated sensor is, in its accelerometers' frame where that matters."""
    sensor = bench["simulation"]["nine_axis"]["sensor"]
    felt, field = sensor["accelerometers"], sensor["magnetometers"]
    true = {}
    for axis in "xyz":
        name = axis.upper()
        true["accelerometer_bias", name] = 1e-3 * number(felt["bias"][axis])
        scale = 1e-6 * number(felt["scale_factor_error"][axis])
        true["accelerometer_scale_factor", name] = 1.0 + scale
        true["magnetometer_offset", name] = number(field["offset"][axis])
        percent = 1e-2 * number(field["scale_factor_error"][axis])
        true["magnetometer_scale_factor", name] = 1.0 + percent
        turned = TRUTH["accelerometers"]["boresight"][f"about_{axis}"]
        true["boresight", name] = number(turned)
        for other in "XYZ":
            own = TRUTH["gyros"]["g_sensitivity"].get(axis + other.lower(), "0 deg/h/g")
            true["g_sensitivity", name + other] = number(own)
    for pair in ("XY", "XZ", "YZ"):
        lean = TRUTH["accelerometers"]["nonorthogonality"].get(pair.lower(), "0 arcsec")
        true["accelerometer_nonorthogonality", pair] = number(lean)
    return true


@pytest.mark.campaign
def test_all_nine_axes_come_back_in_one_frame(tmp_path: Path) -> None:
    outcome = run_with(tmp_path, TRUTH)
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    true = true_values(shipped_bench())
    seen = set()
    for result in outcome.document.results:
        estimate = result.estimate
        wanted = true.get((estimate.name, str(estimate.axis)))
        if wanted is None:
            continue
        assert estimate.value is not None, estimate
        assert result.combined is not None
        off = abs(estimate.value - wanted) / result.combined.standard_uncertainty
        assert off < WITHIN_U, (estimate.name, estimate.axis, off)
        seen.add((estimate.name, estimate.axis))
    assert seen == set(true)
    leans = {
        r.estimate.axis: r for r in outcome.document.results if r.estimate.name == "misalignment"
    }
    gyros = shipped_bench()["simulation"]["nine_axis"]["sensor"]["gyros"]["misalignment"]
    turned = TRUTH["accelerometers"]["boresight"]
    about = {axis: number(turned[f"about_{axis}"]) for axis in "xyz"}
    # What the base's axes are turned by is taken off: the frame is the accelerometers'.
    skew = {"XY": -about["z"], "XZ": about["y"], "YX": about["z"]}
    skew |= {"YZ": -about["x"], "ZX": -about["y"], "ZY": about["x"]}
    for pair, result in leans.items():
        assert result.combined is not None
        assert result.estimate.value is not None
        assert result.estimate.extra["frame"] == "accelerometers"
        wanted = number(gyros[str(pair).lower()]) - skew[str(pair)]
        assert abs(result.estimate.value - wanted) < WITHIN_U * result.combined.standard_uncertainty
        assert result.combined.standard_uncertainty < 8.0
    (folder,) = (tmp_path / "runs").iterdir()
    hold_against_its_own_data(folder)
    assert {"pose -X", "pose X+Y", "-Z +60 deg/s"} <= set(RunFolder(folder).finished_units())


def hold_against_its_own_data(folder: Path) -> None:
    """Apply the calibration file to what the run recorded at rest: gravity and the earth's field.

    The one is 1 g and the other 54,826 nT in every pose, wherever it points.
    """
    calibration = json.loads((folder / "calibration.json").read_text("utf-8"))
    assert calibration["frame"] == "accelerometers"
    recorded = RunFolder(folder)
    for sensor, names, size, within in (
        ("accelerometers", "accelerometer_{}_g", 1.0, 1e-4),
        ("magnetometer", "magnetometer_{}_nT", 54826.0, 200.0),
    ):
        own = calibration[sensor]
        assert own["frame"] == "accelerometers"
        count = len(own["covariance"]["names"])
        assert np.shape(own["covariance"]["matrix"]) == (count, count)
        assert np.linalg.eigvalsh(own["covariance"]["matrix"]).min() > -1e-12
        offset = np.array(own["bias" if sensor == "accelerometers" else "offset"])
        for unit in ("pose -X", "pose -Y", "pose X+Y", "position 1"):
            rows = recorded.rows("imu", unit)
            mean = [np.nanmean(rows[names.format(axis)]) for axis in "xyz"]
            true = np.array(own["inverse_gain"]) @ (np.array(mean) - offset)
            assert abs(float(np.linalg.norm(true)) - size) < within, (sensor, unit)


def test_a_pose_that_is_wrong_ends_the_run_safely_and_says_how_it_lies(tmp_path: Path) -> None:
    plan, bench = shipped_plan(COMPLETE), shipped_bench()
    plan["parameters"] |= SHORT | SHORT_TURNS | {"poses": ["X"], "static_time": "20 s"}
    plan["parameters"]["pose"] = {"acceleration": "0.0001 g", "attempts": 1}
    outcome = run_of(tmp_path, plan, bench)
    assert outcome.exit_code == 3
    assert "the sensor is to stand with X up; the accelerometers read +1.00" in str(outcome.error)


def test_the_outlook_says_what_each_pose_adds() -> None:
    parameters = shipped_plan(COMPLETE)["parameters"]
    lines = outlook(NineAxisParameters.model_validate(parameters))
    (whole,) = [line for line in lines if line.startswith("accelerometers: u = ")]
    assert "misalignment in their frame" in whole
    assert not [line for line in lines if "frame of the mounting" in line]
    without = [line for line in lines if line.startswith("  without pose ")]
    assert [line.split()[2] for line in without] == [f"{word}:" for word in parameters["poses"]]
    edge = next(line for line in without if "X+Y" in line)
    face = next(line for line in without if "-X" in line)
    assert float(edge.split()[-2]) > 2.0 * float(face.split()[-2])
    published = NineAxisParameters.model_validate(parameters | {"poses": [], "turned_down": []})
    assert any(line.startswith("accelerometers: not determined") for line in outlook(published))


@pytest.mark.parametrize(
    ("word", "angles", "name"),
    [
        ("X", (90.0, 0.0), "X-up"),
        ("-X", (-90.0, 0.0), "X-down"),
        ("-Z", (0.0, 180.0), "Z-down"),
        ("X+Y", (45.0, 90.0), "X-up-Y-up"),
        ("-Y-Z", (0.0, -135.0), "Y-down-Z-down"),
    ],
)
def test_a_direction_is_two_angles_of_the_table_and_a_name(
    word: str, angles: tuple[float, float], name: str
) -> None:
    assert table_angles_deg(word) == pytest.approx(angles)
    assert ending(word) == name


@pytest.mark.parametrize("word", ["", "U", "X+X", "X+", "XY", "+-X"])
def test_a_word_that_is_no_direction_is_refused(word: str) -> None:
    assert up_of(word) is None
    with pytest.raises(ValueError, match="is no direction; write what points up"):
        NineAxisParameters.model_validate({"latitude": "40 deg", "poses": [word]})


def test_a_plan_by_hand_asks_for_each_direction_and_the_world_knows_them() -> None:
    from sim_instruments.world.nine_axis import DIRECTIONS, MOUNTINGS

    by_hand = {"latitude": "40 deg", "poses": ["-X", "X-Z"], "turned_down": ["-Y"]}
    parameters = NineAxisParameters.model_validate(by_hand)
    asked = [prompt.id for prompt in PROCEDURE.walk(parameters).prompts]
    assert asked[3:5] == ["pose-X-down", "pose-X-up-Z-down"]
    assert asked[-1] == "mount-Y-down"
    assert {one.removeprefix("pose-") for one in asked[3:5]} <= set(DIRECTIONS)
    assert set(asked[-4:]) <= set(MOUNTINGS)
    for word in parameters.poses:
        x, y, z = DIRECTIONS[ending(word)]
        assert [-axis[2] for axis in (x, y, z)] == pytest.approx(up_of(word))
