"""Mountings and table axes of a nine-axis record: what no noise shows is in u."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from nine_axis_records import (
    ARCMIN,
    CROSS,
    PRIOR,
    Setting,
    codes,
    record,
)

from procedures.nine_axis_calibration.analysis import analyse
from procedures.nine_axis_calibration.calibration import calibration_data, correction_of
from procedures.nine_axis_calibration.dataset import NineAxisDataset
from procedures.nine_axis_calibration.evaluate import prior_inputs
from procedures.nine_axis_calibration.outlook import prior_of
from procedures.nine_axis_calibration.parameters import Prior
from station.uncertainty import combine

ARCSEC = 648000.0 / np.pi
KNOWN = replace(PRIOR, mounting_rad=0.5 * ARCMIN, table_axes_rad=10.0 / ARCSEC)


def leaning(dataset: NineAxisDataset, seed: int, lean_rad: float) -> NineAxisDataset:
    """Return a dataset whose mountings each lean, as a gyro across the table's axis shows it."""
    generator = np.random.default_rng([seed, 5])
    leans = lean_rad * generator.standard_normal((3, 3))
    turns = []
    for one in dataset.turns:
        rate = one.rate_deg_per_s.copy()
        for gyro in {0, 1, 2} - {one.axis}:
            rate[:, gyro] += leans[gyro, one.axis] * one.commanded_deg_per_s
        turns.append(replace(one, rate_deg_per_s=rate))
    return replace(dataset, turns=tuple(turns), prior=KNOWN)


def test_misalignment_holds_mounting_and_table_axes_and_says_its_frame() -> None:
    off = []
    for seed in range(12):
        analysis = analyse(leaning(record(Setting(seed, static_s=60)), seed, 0.5 * ARCMIN))
        own = [one for one in analysis.estimates if one.name == "misalignment"]
        assert {one.extra["frame"] for one in own} == {"mounting"}
        found = combine(own, list(prior_inputs(KNOWN, "the plan")))
        for one, total in zip(own, found, strict=True):
            assert total is not None
            assert one.value is not None
            assert one.axis is not None
            assert total.standard_uncertainty == pytest.approx(np.hypot(30.0, 10.0), rel=0.01)
            sources = {line.description.split(",")[0] for line in total.budget}
            assert {"mounting of the sensor on the table", "axes of the table"} <= sources
            truth = ARCSEC * CROSS["XYZ".index(one.axis[0]), "XYZ".index(one.axis[1])]
            off.append((one.value - truth) / total.standard_uncertainty)
    assert np.max(np.abs(off)) < 4.0
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.2


def test_the_calibration_file_says_the_frame_of_its_misalignments() -> None:
    for alone, frame in ((False, "mounting"), (True, None)):
        correction = correction_of(analyse(record(Setting(alone=alone)), allan=False))
        assert correction is not None
        data = calibration_data(correction)
        assert json.loads(json.dumps(data))["frame"] == frame


def test_the_mounting_is_as_sure_as_the_tilt_unless_given() -> None:
    given = {
        "heading": "10 arcmin",
        "relative_heading": "0.5 arcmin",
        "tilt": "0.7 arcmin",
        "accelerometer_bias": "0.0001 g",
    }
    unsaid = prior_of(Prior.model_validate(given))
    assert unsaid.mounting_rad == pytest.approx(0.7 * ARCMIN)
    assert unsaid.table_axes_rad * ARCSEC == pytest.approx(10.0)
    said = prior_of(Prior.model_validate(given | {"mounting": "2 arcmin"}))
    assert said.mounting_rad == pytest.approx(2.0 * ARCMIN)


@pytest.mark.parametrize("value_g", [0.0, -0.5])
def test_an_accelerometer_that_is_dead_at_rest_is_frozen_and_gives_no_bias(value_g: float) -> None:
    made = record()
    felt = [still.acceleration_g.copy() for still in made.static]
    for acceleration_g in felt:
        acceleration_g[:, 2] = value_g
    static = tuple(
        replace(still, acceleration_g=own) for still, own in zip(made.static, felt, strict=True)
    )
    analysis = analyse(replace(made, static=static))
    assert "frozen" in codes(analysis)
    assert all(one.value is None for one in analysis.estimates if one.name == "bias")
