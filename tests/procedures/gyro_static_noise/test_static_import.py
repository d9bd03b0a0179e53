"""Imported records at rest: the example within tolerance, triads, every fault in one sentence."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from places import DATA
from static_records import DEVICES, noise

from procedures.gyro_static_noise.figures import draw_parts
from station.cli.analysing import analyse_dataset
from station.dataset_reading import read_dataset
from station.runner.evaluation import evaluate_dataset

DATA = DATA / "gyro-static-noise"
FIRST = "1,1561,9.9303"


def test_the_example_comes_out_within_its_tolerance() -> None:
    document, findings = evaluate_dataset(read_dataset(DATA))
    data = document.to_data()
    truth = json.loads((DATA / "truth.json").read_text(encoding="utf-8"))
    found = {(one["name"], one["axis"]): one for one in data["results"]}
    assert len(found) == len(truth["expected"]) == 9
    for expected in truth["expected"]:
        one = found[expected["name"], expected["axis"]]
        assert one["unit"] == expected["unit"]
        assert abs(one["value"] - expected["value"]) < expected["tolerance"], one
        u = one["standard_uncertainty"]
        assert expected.get("u_min", 0.0) < u < expected.get("u_max", 1.0), one
    codes = {one["code"] for one in data["flags"]}
    assert "not-significant" in codes
    assert "periodic" not in codes
    methods = {one["name"]: one["method"] for one in data["results"]}
    assert methods["bias_instability"] == "maximum-likelihood"
    published = {one["name"]: one["value"] for one in data["as_published"]}
    assert published["quantisation_noise"] > 1.0  # slopes invent it
    titles = [part.title for part in draw_parts(findings, document)]
    assert titles == ["Allan deviation, IA", "Record at rest, IA", "Switch-ons, IA"]


def written(folder: Path, conditions: str, header: str, rows: list[str]) -> Path:
    """Write a dataset folder with the usual conditions and these beside them."""
    usual = (
        "dataset: 1\nprocedure: gyro-static-noise\nfiles: {samples: samples.csv}\nconditions:\n"
        "  sample_interval: 1 s\n  timestamp: interval-end\n  latitude: 39.9 deg\n"
    )
    folder.mkdir()
    (folder / "dataset.yaml").write_text(usual + conditions, encoding="utf-8")
    (folder / "samples.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return folder


def test_a_triad_gives_each_axis_its_own_results(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    axes = "".join(
        f"    {name}: {{azimuth: {azimuth} deg, elevation: {elevation} deg}}\n"
        for name, azimuth, elevation in (("X", 0, 0), ("Y", 90, 0), ("Z", 0, 90))
    )
    earth = 15.041 * np.array([np.cos(np.deg2rad(39.9)), 0.0, np.sin(np.deg2rad(39.9))])
    rates = np.column_stack([noise(rng, DEVICES["MEMS"], 600, 1.0) for _ in range(3)])
    rates += earth + np.array([30.0, -20.0, 10.0])
    place = written(
        tmp_path / "triad",
        f"  gyro_output: rate\n  input_axis:\n{axes}",
        "switch_on,t_s,gx_deg_per_h,gy_deg_per_h,gz_deg_per_h",
        [f"1,{n + 1},{x:.4f},{y:.4f},{z:.4f}" for n, (x, y, z) in enumerate(rates)],
    )
    results = analyse_dataset(place, None).to_data()["results"]
    assert len(results) == 27
    found = {(one["name"], one["axis"]): one for one in results}
    for axis, bias in (("X", 30.0), ("Y", -20.0), ("Z", 10.0)):
        assert found["angle_random_walk", axis]["value"] == pytest.approx(0.15, rel=0.15)
        assert abs(found["bias", axis]["value"] - bias) < 4 * 0.9
        assert found["bias_repeatability", axis]["value"] is None


def test_samples_before_the_warm_up_do_not_count(tmp_path: Path) -> None:
    place = tmp_path / "cold"
    shutil.copytree(DATA, place)
    text = (place / "samples.csv").read_text(encoding="utf-8")
    assert FIRST in text
    (place / "samples.csv").write_text(text.replace(FIRST, "1,1561,900"), encoding="utf-8")
    before, after = (analyse_dataset(one, None).to_data() for one in (DATA, place))
    assert before["results"] == after["results"]
