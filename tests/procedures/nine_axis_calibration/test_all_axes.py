"""Accelerometers and magnetometer: the truth comes back, and what is not determined is null."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nine_axis_records import PRIOR
from nine_axis_stands import FACES, Bench, truth_of, write

from procedures.nine_axis_calibration.all_axes.inertial import SECOND_ORDER
from procedures.nine_axis_calibration.all_axes.results import OtherResults, prior_rows, results_of
from procedures.nine_axis_calibration.all_axes.spheres import fields, spheres
from procedures.nine_axis_calibration.all_axes.stands import CoilRecord, direction
from procedures.nine_axis_calibration.analysis import analyse
from procedures.nine_axis_calibration.dataset import NineAxisDataset
from procedures.nine_axis_calibration.evaluate import findings_of_dataset
from station.dataset_reading import read_dataset
from station.files.faults import FaultList
from station.results import conclude

SEEDS = 3


def errors_in_u(bench: Bench, found: OtherResults) -> dict[str, list[float]]:
    truth, errors = truth_of(bench.sensor), defaultdict[str, list[float]](list)
    for one in (*found.estimates, *found.misalignment):
        if one.value is not None and one.standard_uncertainty is not None:
            assert one.axis is not None
            error = one.value - truth[one.name, one.axis]
            errors[one.name].append(error / one.standard_uncertainty)
    return errors


def nulls(found: OtherResults) -> set[str]:
    return {one.name for one in found.estimates if one.value is None}


def codes(found: OtherResults) -> set[str]:
    return {one.code for one in found.flags}


@pytest.mark.campaign
def test_every_quantity_comes_back_within_its_uncertainty() -> None:
    together = defaultdict[str, list[float]](list)
    for seed in range(SEEDS):
        bench = Bench(seed)
        found = results_of(bench.data())
        assert nulls(found) == {"g_sensitivity"}
        assert codes(found) == {"not-identifiable"}
        for name, errors in errors_in_u(bench, found).items():
            together[name] += errors
    assert len(together) == 9
    every = np.concatenate(list(together.values()))
    assert 0.8 < float(np.sqrt(np.mean(every**2))) < 1.2
    assert float(np.max(np.abs(every))) < 4.5


def test_upright_turns_determine_the_magnetometer_and_no_accelerometer() -> None:
    bench = Bench(3, poses=())
    found = results_of(bench.data())
    assert found.inertial is None
    assert found.misalignment == ()
    assert not {name for name in nulls(found) if name.startswith("magnetometer")}
    (flag,) = [one for one in found.flags if one.code == "not-identifiable"]
    assert "accelerometer_bias" in flag.details["coefficients"]
    frames = {one.extra.get("frame") for one in found.estimates if "misalignment" in one.name}
    assert frames == {"mounting"}
    assert max(map(abs, errors_in_u(bench, found)["magnetometer_offset"])) < 4.0


def test_faces_alone_leave_the_second_order_out() -> None:
    bench = Bench(4, poses=FACES, field_at_poses=False)
    bench.sensor = replace(bench.sensor, second=np.zeros(3))
    found = results_of(bench.data())
    assert "accelerometer_second_order" in nulls(found)
    assert max(map(abs, errors_in_u(bench, found)["accelerometer_bias"])) < 4.0


@pytest.mark.campaign
def test_a_mounting_that_faces_down_gives_the_gyros_sensitivity_to_force() -> None:
    bench = Bench(5, turned=("X", "Y", "Z", "-X"))
    found = results_of(bench.data())
    assert "g_sensitivity" not in nulls(found)
    assert max(map(abs, errors_in_u(bench, found)["g_sensitivity"])) < 4.5


def test_without_a_known_field_scale_factors_are_relative_by_convention() -> None:
    data = replace(Bench(6).data(), field_nT=None, field_u_nT=0.0)
    found = results_of(data)
    assert "scale-by-convention" in codes(found)
    scale = [one.value for one in found.estimates if one.name == "magnetometer_scale_factor"]
    assert np.mean([value for value in scale if value is not None]) == pytest.approx(1.0, abs=1e-6)


def in_a_coil(bench: Bench) -> CoilRecord:
    """Return steps of the coil along each axis, and what the sensor reads of them."""
    steps = np.vstack([60_000.0 * sense * np.eye(3) for sense in (1.0, -1.0)])
    applied = np.repeat(steps, 20, axis=0)
    output = bench.sensor.offset_nT + applied @ bench.sensor.gain.T
    return CoilRecord(applied, output + bench.draw.normal(0.0, 30.0, output.shape), 0.005, 0.0, 0.0)


def test_a_coil_gives_the_magnetometer_where_nothing_was_turned() -> None:
    bench = Bench(10, poses=(), turned=())
    found = results_of(replace(bench.data(), rests=(), coil=in_a_coil(bench)))
    errors = errors_in_u(bench, found)
    assert set(errors) == {
        "magnetometer_offset",
        "magnetometer_scale_factor",
        "magnetometer_misalignment",
    }
    assert max(map(abs, np.concatenate(list(errors.values())))) < 4.0
    (gain,) = [one for one in found.inputs if one.name == "prior_gaussmeter_gain"]
    assert gain.standard_uncertainty == 0.005
    frames = {one.extra.get("frame") for one in found.estimates if "misalignment" in one.name}
    assert frames == {"coil"}


def test_with_a_coil_no_scale_is_by_convention() -> None:
    bench = Bench(11, poses=())
    data = replace(bench.data(), field_nT=None, field_u_nT=0.0, coil=in_a_coil(bench))
    found = results_of(data)
    assert "scale-by-convention" not in codes(found)
    assert max(map(abs, errors_in_u(bench, found)["magnetometer_scale_factor"])) < 4.0


def test_a_coil_along_two_axes_determines_nothing() -> None:
    bench = Bench(12, poses=(), turned=())
    record = in_a_coil(bench)
    flat = replace(record, applied_nT=record.applied_nT * [1, 1, 0])
    found = results_of(replace(bench.data(), rests=(), coil=flat))
    assert "magnetometer_offset" in nulls(found)


@pytest.mark.parametrize("word", ["", "W", "X+X", "X-X", "x", "+", "XY", "X+Y+Z+X"])
def test_what_is_no_direction_is_none(word: str) -> None:
    assert direction(word) is None


def test_directions_are_unit_vectors() -> None:
    assert np.allclose(direction("-X"), [-1, 0, 0])
    assert np.allclose(direction("X+Y"), [2**-0.5, 2**-0.5, 0])
    assert np.allclose(direction("-X-Y-Z"), -(3**-0.5))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(Bench(9, poses=FACES).data(), tmp_path_factory.mktemp("all-axes"))


def test_an_imported_folder_gives_all_nine_axes(folder: Path) -> None:
    findings = findings_of_dataset(read_dataset(folder))
    document = conclude("nine-axis-calibration", findings, {}, "simple").to_data()
    truth = truth_of(Bench(9, poses=FACES).sensor)
    results = {(one["name"], one["axis"]): one for one in document["results"]}
    assert results["misalignment", "XY"]["frame"] == "accelerometers"
    for key in (("accelerometer_scale_factor", "X"), ("magnetometer_offset", "Z")):
        error = results[key]["value"] - truth[key]
        assert abs(error) < 4.5 * results[key]["standard_uncertainty"], key
    methods = {one["method"] for one in document["as_published"]}
    assert {"six-position", "min-max", "ellipsoid"} <= methods


def test_priors_of_the_other_six_axes_have_rows_that_add_to_their_uncertainty(folder: Path) -> None:
    findings = findings_of_dataset(read_dataset(folder))
    whole = {(one.name, one.axis): one for one in findings.detail.analysis.others.estimates}
    document = conclude("nine-axis-calibration", findings, {}, "simple")
    for key, wanted in {
        ("accelerometer_bias", "X"): {"prior_tilt"},
        ("boresight", "Z"): {"prior_tilt", "prior_mounting"},
        ("magnetometer_misalignment", "XY"): {"prior_directions", "prior_tilt"},
    }.items():
        result = document.result(*key)
        rows = {line.quantity for line in result.budget if line.contribution > 0.0}
        assert {"repeatability", *wanted} <= rows
        assert result.combined is not None
        u = whole[key].standard_uncertainty
        assert result.combined.standard_uncertainty == pytest.approx(u, rel=1e-6)


def test_a_position_that_stood_otherwise_is_in_no_fit(folder: Path, tmp_path: Path) -> None:
    for one in folder.iterdir():
        text = one.read_text(encoding="utf-8")
        text = text.replace("\n1,", "\n3,") if one.name == "static.csv" else text
        (tmp_path / one.name).write_text(text, encoding="utf-8")
    right, wrong = (
        conclude("nine-axis-calibration", findings_of_dataset(read_dataset(place)), {}, "simple")
        for place in (folder, tmp_path)
    )
    flags = {flag.code for flag in wrong.flags}
    assert "wrong-position" in flags
    assert flags.isdisjoint({"poses-disagree", "contradicts-statement"})
    for axis in "XYZ":
        result = wrong.result("accelerometer_bias", axis)
        usual = right.result("accelerometer_bias", axis)
        assert result.combined is not None
        assert usual.combined is not None
        u = result.combined.standard_uncertainty
        assert u < 2.0 * usual.combined.standard_uncertainty
        assert result.estimate.value == pytest.approx(usual.estimate.value, abs=2.0 * u)


@pytest.mark.parametrize(
    ("file", "change", "named"),
    [
        ("poses.csv", lambda text: text.replace("-X,1,", "-W,1,", 1), "'-W' is no direction"),
        ("poses.csv", lambda text: text.replace("ay_g,", "", 1), "row"),
        ("rate.csv", lambda text: text.replace("\nX,", "\nX+,", 1), "'X\\+' is no direction"),
        (
            "dataset.yaml",
            lambda text: text.replace(
                "earth_field: {magnitude: 54", "earth_field: {magnitude: 5 mm, x: 54"
            ),
            "earth_field",
        ),
        ("dataset.yaml", lambda text: text.replace("poses:", "pose:"), "is not known here"),
    ],
)
def test_bad_columns_and_conditions_are_named(
    folder: Path, tmp_path: Path, file: str, change: Callable[[str], str], named: str
) -> None:
    for one in folder.iterdir():
        text = one.read_text(encoding="utf-8")
        text = change(text) if one.name == file else text
        (tmp_path / one.name).write_text(text, encoding="utf-8")
    with pytest.raises(FaultList, match=named):
        findings_of_dataset(read_dataset(tmp_path))


QUIET_STEPS = [(2.5e-4, 2e-5), (8.0 / 2**15, 0.0), (1e-3, 1e-4)]
HAND: dict[str, Any] = {"poses": FACES, "field_at_poses": False, "mounting_arcmin": 3.0}


@pytest.mark.parametrize(("step_g", "noise_g"), QUIET_STEPS)
def test_no_accelerometer_is_better_than_its_step(step_g: float, noise_g: float) -> None:
    every: list[float] = []
    for seed in range(5000, 5003):
        bench = Bench(seed, accelerometer_step_g=step_g, accelerometer_g=noise_g, **HAND)
        bench.sensor = replace(bench.sensor, second=np.zeros(3))
        found = results_of(bench.data())
        assert "coarse-output" in codes(found)
        sizes = [one.standard_uncertainty for one in found.estimates if "bias" in one.name]
        assert min(size for size in sizes if size is not None) > step_g / 12.0**0.5 / 3.0
        for name, errors in errors_in_u(bench, found).items():
            every += errors if name.startswith("accelerometer") else []
    assert max(map(abs, every)) < 4.0


@pytest.mark.parametrize("step_g", [0.0, 1e-3])
def test_a_clipped_accelerometer_is_called_saturated_and_not_used(step_g: float) -> None:
    bench = Bench(5001, accelerometer_limit_g=0.999, accelerometer_step_g=step_g)
    found = results_of(bench.data())
    assert "saturated" in codes(found)
    assert "accelerometer_bias" in nulls(found)


def test_a_clipped_magnetometer_is_called_saturated_and_its_error_is_in_no_result() -> None:
    bench = Bench(5002, magnetometer_limit_nT=45_000.0)
    found = results_of(bench.data())
    assert "saturated" in codes(found)
    errors = errors_in_u(bench, found)
    assert max(map(abs, errors.get("magnetometer_offset", [0.0]))) < 4.0


@pytest.mark.parametrize(
    ("what", "sensor"), [("acceleration_g", "accelerometer"), ("field_nT", "magnetometer")]
)
def test_a_channel_that_is_a_copy_of_another_is_named_and_neither_is_used(
    what: str, sensor: str
) -> None:
    data = Bench(5005).data()
    twice = [samples[:, [0, 0, 2]] for _, _, samples in data.records(what)]
    found = results_of(data.with_records(what, twice))
    (flag,) = [one for one in found.flags if one.code == "frozen"]
    assert (flag.axis, flag.details["sensor"], flag.details["copy_of"]) == ("Y", sensor, "X")
    assert {f"{sensor}_scale_factor"} <= nulls(found)
    assert "contradicts-statement" not in codes(found)


def test_coarse_magnetometers_that_turn_are_not_called_saturated() -> None:
    bench = Bench(5003, magnetometer_step_nT=150.0)
    found = results_of(bench.data())
    assert "saturated" not in codes(found)
    assert max(map(abs, errors_in_u(bench, found)["magnetometer_offset"])) < 4.0


PLATFORM = (500.0, -300.0, 400.0)


def test_a_field_of_the_platform_is_solved_for() -> None:
    together, undisturbed = [], Bench(5000)
    usual = [one.standard_uncertainty for one in results_of(undisturbed.data()).estimates]
    for seed in range(5000, 5004):
        bench = Bench(seed, platform_nT=PLATFORM)
        found = results_of(bench.data())
        (flag,) = [one for one in found.flags if one.code == "field-disturbed"]
        assert flag.details["up_nT"] == pytest.approx(400.0, abs=100.0)
        assert "field-wanders" not in codes(found)
        together += errors_in_u(bench, found)["magnetometer_offset"]
        u = [one.standard_uncertainty for one in found.estimates]
        offsets = [n for n, one in enumerate(found.estimates) if one.name == "magnetometer_offset"]
        assert max((u[n] or 0.0) / (usual[n] or 1.0) for n in offsets) < 2.0
    assert max(map(abs, together)) < 4.0


def test_with_a_field_of_the_platform_upright_turns_know_no_scale() -> None:
    found = results_of(Bench(5004, platform_nT=PLATFORM, **HAND).data())
    assert "field-disturbed" in codes(found)
    assert "magnetometer_scale_factor" in nulls(found)
    assert "magnetometer_offset" not in nulls(found)


def test_scale_factors_of_gyros_are_about_their_own_axes() -> None:
    off = []
    for seed in range(5000, 5006):
        bench = Bench(seed, rates=(1.0, 5.0, 10.0, 50.0, 100.0), **HAND)
        bench.sensor = replace(bench.sensor, second=np.zeros(3))
        data = bench.data()
        turns = tuple(record.turn for mounted in data.mountings for record in mounted.records)
        dataset = NineAxisDataset(39.9, PRIOR, (), turns)
        analysis = analyse(dataset, allan=False, inertial=results_of(data).inertial)
        for axis in "XYZ":
            one = analysis.estimate("scale_factor", axis)
            assert one.value is not None
            assert one.standard_uncertainty is not None
            truth = truth_of(bench.sensor)["scale_factor", axis]
            off.append((one.value - truth) / one.standard_uncertainty)
    assert float(np.sqrt(np.mean(np.square(off)))) < 1.5
    assert float(np.max(np.abs(off))) < 4.0


def test_calibrated_output_lies_on_the_sphere_and_the_ellipsoid_stands_beside_it() -> None:
    bench = Bench(5005)
    found = results_of(bench.data())
    plots = list(spheres(found))
    assert [plot.title.split()[0] for plot in plots] == ["Accelerometers", "Magnetometer"]
    assert found.magnetic is not None
    read, corrected = fields(found.recorded, found.magnetic)
    off = [np.std(np.linalg.norm(values, axis=1)) for values in (read, corrected)]
    assert off[1] < 80.0 < off[0]
    (x, *_) = [one.value for one in found.published if one.method == "ellipsoid"]
    assert x == pytest.approx(bench.sensor.offset_nT[0], abs=1000.0)


def test_a_second_order_that_nobody_states_is_an_input_of_the_bias() -> None:
    bench = Bench(9, poses=FACES)
    data = bench.data()
    found = results_of(data)
    (stated,) = (one for one in prior_rows(data) if one.name == SECOND_ORDER)
    assert stated.standard_uncertainty is None
    second = bench.sensor.second / 1e-6
    for n, axis in enumerate("XYZ"):
        (bias,) = (
            one for one in found.estimates if (one.name, one.axis) == ("accelerometer_bias", axis)
        )
        assert bias.value is not None
        off = bias.value - bench.sensor.bias_g[n]
        assert abs(off) > 0.5e-6 * abs(second[n])
        assert abs(off - bias.sensitivities[SECOND_ORDER] * second[n]) < 4e-5
    scale = [one for one in found.estimates if one.name == "accelerometer_scale_factor"]
    assert all(SECOND_ORDER not in one.sensitivities for one in scale)
    whole = results_of(Bench(9).data())
    assert all(SECOND_ORDER not in one.sensitivities for one in whole.estimates)
