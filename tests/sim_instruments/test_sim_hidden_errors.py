"""Errors of the simulated world that no reading shows: each acts as told, results stay right."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.truths import TRUTHS
from fog_fixture import BENCH
from keysight_fixture import standing
from plan_runs import run_of, shipped_bench, shipped_plan
from stage_bench import stage_bench

from sim_instruments.bench import world_of
from sim_instruments.truth import Truth
from sim_instruments.world.accelerometer import PLANES, AccelerometerBench, acceleration_g
from sim_instruments.world.laser_gyro import LaserGyroBench
from sim_instruments.world.nine_axis import NineAxisBench

ACCELEROMETER, LASER_GYRO, NINE_AXIS = (
    "accelerometer-magnetic-sensitivity",
    "rlg-magnetic-sensitivity",
    "nine-axis-calibration",
)
SHORT: dict[str, dict[str, Any]] = {
    ACCELEROMETER: {
        "design": "efficient",
        "largest_field": "50 mT",
        "warm_up": "10 s",
        "readings": 3,
    },
    LASER_GYRO: {
        "duration": "100 s",
        "warm_up": {"slope_limit": "10 deg/h^2", "window": "1 min", "at_most": "5 min"},
    },
    NINE_AXIS: {
        "warm_up": "10 s",
        "static_time": "1 min",
        "sample_rate": "10 Hz",
        "settle": "1 s",
        "rates": [f"{rate} deg/s" for rate in (20, 40, 60, 80, 100)],
    },
}
Errors = dict[str, Any]
SIZES: dict[str, Errors] = {
    ACCELEROMETER: {
        "simulation/accelerometer/axis_tilt": "20 arcsec",
        "simulation/accelerometer/soft_iron": "0.2 %",
        "simulation/dc_coil/probe_position": {"x": "14 mm", "y": "-10 mm", "z": "8 mm"},
        "instruments/rotary_stage/simulator/encoder_sine": "1 arcsec",
        "instruments/rotary_stage/simulator/encoder_phase": "60 deg",
        "instruments/multimeter/simulator/linearity": "1 ppm",
    },
    LASER_GYRO: {
        "simulation/gyro/soft_iron": {"x": "0.5 %", "y": "-0.3 %"},
        "simulation/probe_position": {"x": "40 mm", "y": "-30 mm", "z": "50 mm"},
    },
    NINE_AXIS: {
        "simulation/nine_axis/table_field": {
            "plate": {"x": "600 nT", "z": "-400 nT"},
            "motors": {"north": "150 nT", "down": "80 nT"},
        },
        "simulation/fog/table/outer/lean": {"towards_x": "40 arcsec", "towards_y": "-30 arcsec"},
    },
}
"""Realistic sizes, within what bench file and plan state of instruments and set-up."""


def put(data: Any, errors: Errors) -> Any:
    """Return a bench as data with values put by path."""
    for path, value in errors.items():
        *way, last = path.split("/")
        place = data
        for part in way:
            place = place[part]
        place[last] = value
    return data


@pytest.mark.campaign
@pytest.mark.parametrize("procedure", SIZES)
def test_results_hold_with_the_errors_that_no_reading_shows(procedure: str, tmp_path: Path) -> None:
    plan = shipped_plan(procedure)
    asked = {} if procedure == ACCELEROMETER else plan["parameters"]
    plan["parameters"] = asked | SHORT[procedure]
    bench = put(shipped_bench(), SIZES[procedure])
    outcome = run_of(tmp_path, plan, bench)
    assert outcome.document is not None, outcome.error
    compared = 0
    for result in outcome.document.to_data()["results"]:
        true = TRUTHS[procedure](bench, result)
        if true is None or result["value"] is None:
            continue
        compared += 1
        # The expanded uncertainty holds 95 %; half as much again is beyond the noise of one run.
        assert abs(result["value"] - true) < 1.5 * result["expanded_uncertainty"], result
        if result["name"] == "misalignment":
            # Of a mounting that is known to 0.5 arcmin and a table that is to 10 arcsec.
            assert result["frame"] == "mounting"
            assert result["standard_uncertainty"] == pytest.approx(math.hypot(30.0, 10.0), rel=0.1)
    assert compared >= 3


def world(procedure: str, errors: Errors) -> Any:
    data = put({"simulation": copy.deepcopy(BENCH["simulation"])}, errors)
    return world_of(procedure)(Truth(data["simulation"], "simulation"))


def test_soft_iron_is_felt_by_the_device_and_not_by_the_probe() -> None:
    plain, iron = (
        world(LASER_GYRO, one) for one in ({}, {"simulation/gyro/soft_iron": {"y": "2 %"}})
    )
    assert isinstance(plain, LaserGyroBench)
    ratio = iron.gyro_mT_per_A[1, 1] / plain.gyro_mT_per_A[1, 1]
    assert ratio == pytest.approx(1.02, abs=1e-4)
    assert np.array_equal(iron.probe_mT_per_A, plain.probe_mT_per_A)
    plain, iron = (
        world(ACCELEROMETER, one) for one in ({}, {"simulation/accelerometer/soft_iron": "2 %"})
    )
    assert isinstance(plain, AccelerometerBench)
    assert iron.device_T_per_A == pytest.approx(1.02 * plain.device_T_per_A)
    edges = np.array([0.0, 1.0])
    assert np.array_equal(iron.mean_probe_field_mT(edges), plain.mean_probe_field_mT(edges))


def test_the_tilt_of_the_rotation_axis_brings_gravity_onto_it() -> None:
    tilt = math.radians(0.1)
    across = {"io": 2, "ip": 1, "op": 0}
    for plane, axis in across.items():
        number = np.full(3, PLANES.index(plane))
        force = acceleration_g(number, np.array([0.0, 50.0, 200.0]), tilt)
        assert force[:, axis] == pytest.approx(math.sin(tilt))
        assert np.linalg.norm(force, axis=1) == pytest.approx(1.0)
    tilted = world(ACCELEROMETER, {"simulation/accelerometer/axis_tilt": "0.1 deg"})
    assert tilted._tilt_rad == pytest.approx(tilt)


def test_the_table_disturbs_the_field_where_the_sensor_is_mounted_on_it() -> None:
    table = {"plate": {"x": "600 nT"}, "motors": {"down": "90 nT"}}
    worlds = [world(NINE_AXIS, one) for one in ({}, {"simulation/nine_axis/table_field": table})]
    edges = np.array([1.0, 2.0, 3.0])
    off = []
    for act in ("pose-1", "mount-Z-up"):
        read = []
        for one in worlds:
            assert isinstance(one, NineAxisBench)
            one.act(act, 0.0)
            read.append(one.nine_axis_means(edges).magnetometer_nT)
        off.append(read[1] - read[0])
    assert np.allclose(off[0], 0.0)
    assert np.allclose(off[1], off[1][0])
    assert np.linalg.norm(off[1][0]) == pytest.approx(600.0, rel=0.01)
    for one in worlds:
        one.table.axis(1).turn_at(3.0, 50.0, 50.0)
    turning = np.array([10.0, 11.0])
    moved = [one.nine_axis_means(turning).magnetometer_nT for one in worlds]
    up = moved[1][0, 2] - moved[0][0, 2]
    assert abs(up) == pytest.approx(45.0, rel=0.05)


def test_the_stage_graduation_comes_back_every_turn() -> None:
    graduation = {"encoder_sine": "0.0015 deg", "encoder_phase": "0 deg", "encoder_noise": "0 deg"}
    with stage_bench(graduation | {"encoder_offset": "0 deg", "angle_at_start": "0 deg"}) as bench:
        stage = bench.homed()
        for angle_deg, off_deg in ((90.0, 0.0015), (180.0, 0.0), (270.0, -0.0015)):
            stage.move_to(angle_deg)
            bench.wait(stage)
            true_deg = float(bench.rotation.angle_deg(np.array([bench.clock.now()]))[0])
            assert stage.angle_deg() - true_deg == pytest.approx(off_deg, abs=1e-4)


def test_the_voltmeter_bows_between_the_ends_of_its_range() -> None:
    for volts, off in ((0.0, 20e-6), (0.5, 15e-6), (1.0, 0.0)):
        with (
            standing(volts=volts, noise="0 ppm", linearity="20 ppm") as fixture,
            fixture.line() as line,
        ):
            reading = float(line.ask("MEAS:VOLT:DC? 1"))
        assert reading - volts == pytest.approx(off, abs=1e-7)


def test_an_error_that_is_not_given_is_none() -> None:
    truth = Truth({"given": "2 nT", "below": {"x": "3 nT"}}, "simulation")
    assert (truth.error("given", "nT"), truth.error("absent", "nT")) == (2.0, 0.0)
    assert truth.errors("below", ("x", "y"), "nT") == [3.0, 0.0]
    assert truth.errors("nowhere", ("x", "y"), "nT") == [0.0, 0.0]
