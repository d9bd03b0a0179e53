"""The simulated nine-axis sensor on its plate and on the table: attitude, gains, noise, flaws."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from fog_fixture import BENCH, EARTH_DEG_PER_S, IDEAL, INNER, LATITUDE_DEG, MIDDLE, OUTER

from procedures.nine_axis_calibration.directions import table_angles_deg
from procedures.nine_axis_calibration.placing import POSES_DEG
from procedures.nine_axis_calibration.pose import ATTITUDES
from sim_instruments.bench import world_of
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.nine_axis import NineAxisBench

PROCEDURE = "nine-axis-calibration"
AXES = ("X", "Y", "Z")
ACCELERATION = 50.0
LATITUDE = np.radians(LATITUDE_DEG)
EARTH = EARTH_DEG_PER_S * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
UP = np.array([0.0, 0.0, 1.0])
FIELD_NT = np.array([-3300.0, 28200.0, -46900.0])
"""East, north, up."""

BY_AXIS = [f"sensor__gyros__{axis}__" for axis in "xyz"]
NONE = {
    "heading_error": {"plate": "0 deg", "table": "0 deg"},
    "placing_error": {"heading": "0 deg", "tilt": "0 deg"},
    "sensor__gyros__resolution": "1e-9 deg/s",
    "sensor__gyros__angle_random_walk": "0 deg/sqrt(h)",
    "sensor__gyros__bias_instability": "0 deg/h",
    "sensor__gyros__misalignment": dict.fromkeys(("xy", "xz", "yx", "yz", "zx", "zy"), "0 deg"),
    **{f"{one}bias": "0 deg/h" for one in BY_AXIS},
    **{f"{one}scale_factor_error": "0 ppm" for one in BY_AXIS},
    **{f"{one}asymmetry": "0 ppm" for one in BY_AXIS},
    **{f"{one}ripple__amplitude": "0 ppm" for one in BY_AXIS},
    "sensor__accelerometers__bias": dict.fromkeys("xyz", "0 g"),
    "sensor__accelerometers__scale_factor_error": dict.fromkeys("xyz", "0 ppm"),
    "sensor__accelerometers__noise_in_one_second": "0 g",
    "sensor__magnetometers__offset": dict.fromkeys("xyz", "0 nT"),
    "sensor__magnetometers__scale_factor_error": dict.fromkeys("xyz", "0 ppm"),
    "sensor__magnetometers__noise_in_one_second": "0 nT",
}


def sensor_world(ideal: bool = True, **changes: Any) -> NineAxisBench:
    """Return the world of the simulated bench, with changes by path below `nine_axis`."""
    data = copy.deepcopy(BENCH["simulation"])
    table = {path: value for path, value in IDEAL.items() if path.startswith("table__")}
    for section, wanted in (("fog", table if ideal else {}), ("nine_axis", NONE if ideal else {})):
        for path, value in {**wanted, **(changes if section == "nine_axis" else {})}.items():
            *places, key = path.split("__")
            here = data[section]
            for place in places:
                here = here[place]
            here[key] = value
    world = world_of(PROCEDURE)(Truth(data, "simulation"))
    assert isinstance(world, NineAxisBench)
    return world


def every(interval_s: float, first_s: float, seconds: float) -> np.ndarray:
    return first_s + interval_s * np.arange(round(seconds / interval_s) + 1)


def go_to(world: NineAxisBench, time_s: float, *angles_deg: float) -> None:
    for axis, angle_deg in zip((OUTER, MIDDLE, INNER), angles_deg, strict=True):
        world.table.axis(axis).move_to(time_s, angle_deg, 50.0, ACCELERATION)


@pytest.mark.parametrize("by", ["plate", "table"])
@pytest.mark.parametrize("position", sorted(ATTITUDES))
def test_a_position_feels_earth_gravity_and_field_by_hand_and_by_table(
    by: str, position: int
) -> None:
    world = sensor_world()
    world.act("mount-table" if by == "table" else f"pose-{position}", 0.0)
    if by == "table":
        go_to(world, 0.0, *POSES_DEG[position])
    means = world.nine_axis_means(every(0.1, 30.0, 5.0))
    axes = ATTITUDES[position]
    assert np.abs(means.gyro_deg_per_s - axes @ EARTH).max() < 1e-8
    assert np.abs(means.accelerometer_g - axes @ UP).max() < 1e-9
    assert np.abs(means.magnetometer_nT - axes @ FIELD_NT).max() < 1e-6


@pytest.mark.parametrize("how", ["by hand", "by table"])
@pytest.mark.parametrize("axis", AXES)
def test_turns_both_ways_tell_gain_misalignment_and_asymmetry(axis: str, how: str) -> None:
    world = sensor_world(
        sensor__gyros__x__scale_factor_error="300 ppm",
        sensor__gyros__y__asymmetry="40 ppm",
        sensor__gyros__z__bias="100 deg/h",
        sensor__gyros__misalignment={"xy": "60 arcsec", "xz": "-30 arcsec", "yx": "20 arcsec"}
        | {"yz": "-10 arcsec", "zx": "50 arcsec", "zy": "-40 arcsec"},
    )
    world.act(f"mount-{axis}-up" if how == "by hand" else "mount-table", 0.0)
    if how == "by table":
        go_to(world, 0.0, 0.0, *table_angles_deg(axis))
    place = AXES.index(axis)
    read, rate = [], 100.0
    for start_s, sense in ((50.0, 1.0), (100.0, -1.0)):
        # The outer axis turns clockwise from above, about down.
        world.table.axis(OUTER).turn_at(start_s, -sense * rate, ACCELERATION)
        read.append(world.nine_axis_means(every(0.1, start_s + 10.0, 3.6)).gyro_deg_per_s.mean(0))
        world.table.axis(OUTER).stop(start_s + 20.0)
    gain = (read[0] - read[1]) / (2 * rate)
    arcsec = np.array([[0, 60, -30], [20, 0, -10], [50, -40, 0]])[:, place] * np.pi / 648000
    expected = (arcsec + np.eye(3)[place]) * np.array([1.0003, 1.0, 1.0])
    assert np.abs(gain - expected).max() < 2e-8
    # At rest, in the mean of both senses: the earth's vertical part, the bias, the asymmetry.
    middle = 0.5 * (read[0] + read[1])[place] - EARTH[2] * expected[place]
    wanted = {"X": 0.0, "Y": 0.5 * 40e-6 * rate, "Z": 100.0 / 3600}[axis]
    assert middle == pytest.approx(wanted, abs=2e-6)


def test_a_ripple_is_the_scale_factors_sine_over_the_rate() -> None:
    world = sensor_world(sensor__gyros__z__ripple={"amplitude": "20 ppm", "period": "140 deg/s"})
    rates = np.array([1.0, 35.0, 105.0, -35.0])
    scale = world.sensor.scale_factor(np.column_stack((0 * rates, 0 * rates, rates)))[:, 2]
    expected = 20e-6 * np.sin(2 * np.pi * np.abs(rates) / 140.0)
    assert scale - 1.0 == pytest.approx(expected, abs=1e-12)


def test_a_wrong_heading_of_plate_or_table_lets_the_east_axis_feel_the_earth() -> None:
    heading = {"plate": "30 arcmin", "table": "-30 arcmin"}
    world = sensor_world(heading_error=heading)
    found = {}
    for act in ("pose-1", "mount-table"):
        world.act(act, 0.0)
        go_to(world, 0.0, *(POSES_DEG[1] if act == "mount-table" else (0.0, 0.0, 0.0)))
        rate = world.nine_axis_means(every(0.1, 30.0, 1.0)).gyro_deg_per_s.mean(0)
        found[act] = rate[0] / EARTH[1]
    # East of a mark that lies east of north is south of east.
    assert found["pose-1"] == pytest.approx(-np.sin(np.radians(0.5)), abs=1e-6)
    assert found["mount-table"] == pytest.approx(np.sin(np.radians(0.5)), abs=1e-6)


def test_it_is_never_put_twice_in_the_same_way() -> None:
    world = sensor_world(placing_error={"heading": "5 arcmin", "tilt": "1 arcmin"})
    found = []
    for k in range(200):
        world.act("pose-1", 10.0 * k)
        found.append(world.attitude(np.array([10.0 * k + 1.0]))[0])
    arcmin = np.degrees(np.array(found)) * 60
    # X east: what of it points north is the heading, what of it and of Y points up the tilts.
    assert np.std(arcmin[:, 0, 0]) == pytest.approx(5.0, rel=0.2)
    assert np.std(arcmin[:, 0, 2]) == pytest.approx(1.0, rel=0.2)
    assert np.std(arcmin[:, 1, 2]) == pytest.approx(1.0, rel=0.2)


def allan_deg_per_h(rate_deg_per_s: np.ndarray, count: int) -> float:
    """Return the Allan deviation of means over `count` samples."""
    whole = len(rate_deg_per_s) // count * count
    means = 3600 * rate_deg_per_s[:whole].reshape(-1, count, 3).mean(axis=1)
    return float(np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2)))


def test_noise_is_white_by_the_random_walk_and_flicker_by_the_instability() -> None:
    white = sensor_world(sensor__gyros__angle_random_walk="0.012 deg/sqrt(h)")
    rates = white.nine_axis_means(every(0.1, 0.0, 2000.0)).gyro_deg_per_s
    for count in (1, 10, 100):
        expected = 0.012 * 60 / np.sqrt(0.1 * count)
        assert allan_deg_per_h(rates, count) == pytest.approx(expected, rel=0.15)
    slow = sensor_world(sensor__gyros__bias_instability="0.05 deg/h")
    rates = slow.nine_axis_means(every(5.0, 0.0, 400_000.0)).gyro_deg_per_s
    for count in (16, 64, 256):
        assert allan_deg_per_h(rates, count) == pytest.approx(0.664 * 0.05, rel=0.15)


def test_a_cold_sensor_reads_a_bias_that_goes_and_gets_warm() -> None:
    warm_up = {"bias": "9 deg/h", "time_constant": "10 min", "temperature_rise": "12 K"}
    world = sensor_world(sensor__warm_up=warm_up, sensor__powered_at_start=False)
    assert not world.dut_powered
    world.act("dut-power-on", 1000.0)
    world.act("pose-1", 1000.0)
    edges_s = 1000.0 + np.array([0.0, 0.1, 600.0, 600.1, 36000.0, 36000.1])
    means = world.nine_axis_means(edges_s)
    bias = 3600 * (means.gyro_deg_per_s[::2, 0])
    assert bias == pytest.approx(9.0 * np.array([1.0, np.exp(-1.0), 0.0]), abs=0.01)
    rise = means.temperature_degC[::2] - 22.5
    assert rise == pytest.approx(12.0 * np.array([0.0, 1 - np.exp(-1.0), 1.0]), abs=0.01)


def test_beyond_its_range_a_gyro_stays_there_and_is_not_valid() -> None:
    world = sensor_world(sensor__gyros__range="80 deg/s")
    world.act("mount-Z-up", 0.0)
    world.table.axis(OUTER).turn_at(10.0, 100.0, ACCELERATION)
    means = world.nine_axis_means(every(0.1, 20.0, 1.0))
    assert (means.gyro_deg_per_s[:, 2] == -80.0).all()
    assert not means.valid[:, 2].any() and means.valid[:, :2].all()


def test_who_asks_in_which_pieces_makes_no_difference() -> None:
    def world() -> NineAxisBench:
        found = sensor_world(ideal=False)
        found.act("mount-table", 5.0)
        found.table.axis(OUTER).turn_at(10.0, 30.0, ACCELERATION)
        found.table.axis(OUTER).stop(20.0)
        return found

    edges_s = every(0.1, 0.0, 30.0)
    whole, one = world().nine_axis_means(edges_s), world()
    for k in range(0, 300, 7):
        part = one.nine_axis_means(edges_s[k : k + 8])
        here = whole.rows(slice(k, k + 7))
        for found, expected in zip(part, here, strict=True):
            assert np.abs(found.astype(float) - expected.astype(float)).max() < 1e-9


def test_an_act_that_is_none_is_refused_with_those_there_are() -> None:
    with pytest.raises(SimulationError) as raised:
        sensor_world().act("pose-7", 0.0)
    assert all(act in str(raised.value) for act in sensor_world().acts)


def test_in_the_coil_the_sensor_feels_what_the_probe_beside_it_feels() -> None:
    lies = {"coil_mounting_error": dict.fromkeys(("about_x", "about_y", "about_z"), "0 deg")}
    world = sensor_world(**lies)
    world.act("mount-in-coil", 0.0)
    edges_s = np.arange(10.0, 11.0, 0.1)
    for axis, current_A in zip("xyz", (0.2, -0.15, 0.1), strict=True):
        before_nT = world.nine_axis_means(edges_s).magnetometer_nT[-1]
        world.coil(axis).hold(edges_s[-1], current_A)
        edges_s = edges_s + 10.0
        felt = world.nine_axis_means(edges_s)
        probe_nT = 1e6 * world.mean_probe_field_mT(edges_s)[-1]
        assert felt.magnetometer_nT[-1] == pytest.approx(probe_nT, abs=60.0)
        changed_nT = felt.magnetometer_nT[-1] - before_nT
        assert np.argmax(np.abs(changed_nT)) == "xyz".index(axis)
        assert np.sign(changed_nT["xyz".index(axis)]) == np.sign(current_A)
        assert felt.accelerometer_g[-1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
