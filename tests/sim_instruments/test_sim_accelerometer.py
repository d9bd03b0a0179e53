"""The simulated accelerometer in its coil against physics worked out here a second time."""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import yaml
from places import SIM
from scipy.constants import mu_0
from scipy.integrate import solve_ivp
from sim_bench import Frames, Line, served

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.accelerometer import COEFFICIENTS, AccelerometerBench
from station.clock import VirtualClock

PROCEDURE = "accelerometer-magnetic-sensitivity"
BENCH: dict[str, Any] = yaml.safe_load(SIM.read_text(encoding="utf-8"))
BENCH_K = BENCH["simulation"]["accelerometer"]["coefficients"]
NOWHERE = {"x": "0 mT", "y": "0 mT", "z": "0 mT"}
PERFECT_COIL = {"spacing_error": "0 %", "normal": {"towards_y": "0 deg", "towards_z": "0 deg"}}
STILL: dict[str, Any] = {
    "noise_in_one_second": "0 V",
    "K0_per_K": "0 V",
    "Ki_per_K": "0 V/g",
    "drift_in_one_hour": "0 V",
    "warm_up": {"amplitude": "0 V", "time_constant": "15 min", "temperature_rise": "0 K"},
    "angle_offset": "0 deg",
    "powered_at_start": True,
}
TESLA_PER_A = 0.8**1.5 * mu_0 * 445 / 0.08


def world(
    accelerometer: dict[str, Any] | None = None, *, k: dict[str, float] | None = None, **others: Any
) -> AccelerometerBench:
    """Return a quiet world in a perfect coil; `k` replaces all coefficients, the rest being 0."""
    data = copy.deepcopy(BENCH["simulation"]) | {"ambient_field": NOWHERE}
    data["dc_coil"] |= PERFECT_COIL
    data["accelerometer"] |= STILL | (accelerometer or {})
    if k is not None:
        data["accelerometer"]["coefficients"] = {
            name: f"{k.get(name, 0.0)} {unit}" for name, unit in COEFFICIENTS.items()
        }
    for section, changes in others.items():
        data[section] |= changes
    return AccelerometerBench(Truth(data, "simulation"))


def between(first_s: float, last_s: float) -> np.ndarray:
    return np.array([first_s, last_s])


def test_the_truth_comes_back_from_a_fit_of_its_output() -> None:
    bench = world()
    attitude = {"io": (0, 1), "ip": (0, 2), "op": (1, 2)}
    rows, output, time_s = [], [], 0.0
    for plane, (along_sine, along_cosine) in attitude.items():
        bench.act(f"mount-{plane}", time_s)
        for angle in range(0, 360, 30):
            bench.rotation.put(time_s, angle)
            for ampere in (-8.0, -4.0, 0.0, 4.0, 8.0):
                bench.coil("dc").hold(time_s, ampere)
                time_s += 5.0
                output.append(bench.mean_output_V(between(time_s - 1.0, time_s))[0])
                force = np.zeros(3)
                force[along_sine] = np.sin(np.deg2rad(angle))
                force[along_cosine] = np.cos(np.deg2rad(angle))
                rows.append([*force, TESLA_PER_A * ampere])
    i, o, p, m = np.array(rows).T
    # On the sphere of 1 g, Kpp goes into K0, Kii and Koo.
    design = np.column_stack(
        [i**0, i, i**2, i**3, i * o, i * p, o**2, m, m**2, i * m, o * m, p * m, o, p]
    )
    scale = np.abs(design).max(axis=0)
    fit = np.linalg.lstsq(design / scale, np.array(output), rcond=None)[0] / scale
    k = {name: float(BENCH_K[name].split()[0]) for name in COEFFICIENTS}
    expected = [k["K0"] + k["Kpp"], k["Ki"], k["Kii"] - k["Kpp"], k["Kiii"], k["Kio"], k["Kip"]]
    expected += [k["Koo"] - k["Kpp"], k["Km"], k["Kmm"], k["Kim"], k["Kom"], k["Kpm"]]
    expected += [k["Ko"], k["Kp"]]
    np.testing.assert_allclose(fit, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("plane", "angle", "force"),
    [
        ("io", 0, (0, 1, 0)),
        ("io", 90, (1, 0, 0)),
        ("io", 210, (-0.5, -(0.75**0.5), 0)),
        ("ip", 0, (0, 0, 1)),
        ("ip", 30, (0.5, 0, 0.75**0.5)),
        ("op", 0, (0, 0, 1)),
        ("op", 150, (0, 0.5, -(0.75**0.5))),
        ("level", 0, (0, 0, 1)),
        ("level", 77, (0, 0, 1)),
    ],
)
def test_gravity_lies_on_the_axes_as_the_plane_and_the_angle_say(
    plane: str, angle: float, force: tuple[float, float, float]
) -> None:
    bench = world(k={"Ki": 1.0, "Ko": 0.1, "Kp": 0.01})
    bench.act(f"mount-{plane}", 0.0)
    bench.rotation.put(0.0, angle)
    seen = bench.mean_output_V(between(1.0, 2.0))[0]
    assert seen == pytest.approx(np.dot(force, [1.0, 0.1, 0.01]), abs=1e-14)


def test_the_device_stands_beside_the_encoder_by_the_same_angle_in_every_plane() -> None:
    bench = world({"angle_offset": "10 arcsec"}, k={"Ki": 1.0, "Kp": 1.0})
    seen = []
    for k, plane in enumerate(("io", "ip")):
        bench.act(f"mount-{plane}", 10.0 * k)
        bench.rotation.put(10.0 * k, 0.0 if plane == "io" else 90.0)
        seen.append(bench.mean_output_V(between(10.0 * k + 1, 10.0 * k + 2))[0])
    offset = np.deg2rad(10 / 3600)
    assert seen == pytest.approx([np.sin(offset), np.cos(offset) - np.sin(offset)], abs=1e-12)


def test_means_are_those_of_a_dense_average_while_field_and_angle_move() -> None:
    bench = world()
    bench.act("mount-io", 0.0)
    for k in range(40):
        bench.coil("dc").hold(1.0 + 0.05 * k, 0.2 * (k + 1))
    bench.rotation.move_to(1.5, 60.0, 40.0, 80.0)
    edges = np.array([0.9, 1.0, 1.23, 2.0, 2.71, 4.0, 6.0])
    dense = np.array(
        [bench.mean_output_V(np.linspace(a, b, 2001)).mean() for a, b in pairwise(edges)]
    )
    np.testing.assert_allclose(bench.mean_output_V(edges), dense, rtol=1e-10)
    # And each of those short means is the model's value at its middle.
    times = np.linspace(1.9, 2.5, 7)
    short = [bench.mean_output_V(between(t - 1e-6, t + 1e-6))[0] for t in times]
    angle = np.deg2rad(bench.rotation.angle_deg(times))
    i, o = np.sin(angle), np.cos(angle)
    m = TESLA_PER_A * bench.coil("dc").current(times)
    k = {name: float(text.split()[0]) for name, text in BENCH_K.items()}
    model = k["K0"] + k["Ki"] * i + k["Kii"] * i**2 + k["Kiii"] * i**3 + k["Kio"] * i * o
    model += k["Koo"] * o**2 + k["Ko"] * o
    model += m * (k["Km"] + k["Kim"] * i + k["Kom"] * o) + k["Kmm"] * m**2
    np.testing.assert_allclose(short, model, atol=3e-8)


def test_a_mean_over_a_mounting_is_the_mean_of_before_and_after() -> None:
    bench = world(k={"Kp": 1.0, "Ko": 0.5})
    bench.act("mount-io", 2.25)
    assert bench.mean_output_V(np.array([2.0, 3.0, 4.0])) == pytest.approx([0.625, 0.5])


def test_a_meter_may_read_without_a_pause() -> None:
    bench = world({"noise_in_one_second": "3 uV"})
    edges = np.array([1.0, 2.0, 2.0, 3.0, 3.0 - 4e-16, 4.0])
    with np.errstate(divide="raise", invalid="raise"):
        seen = bench.mean_output_V(edges)[::2]
    assert seen == pytest.approx(bench.mean_output_V(np.arange(1.0, 5.0)), abs=1e-12)


def test_the_coil_warms_by_its_power_whenever_somebody_looks() -> None:
    seldom, often = world(), world()
    levels = [(10.0, 8.0), (400.0, -10.0), (900.0, 0.0), (1000.0, 5.0)]
    looks = np.linspace(0.0, 3000.0, 31)
    seen: list[float] = []
    for number, look in enumerate(looks):
        for when, level in levels:
            if (looks[number - 1] if number else -1.0) < when <= look:
                seldom.coil("dc").hold(when, level)
                often.coil("dc").hold(when, level)
        seen += often.coil_temperature_degC(np.array([look])).tolist()
    np.testing.assert_allclose(seldom.coil_temperature_degC(looks), seen, atol=1e-9)

    def slope(time_s: float, rise: np.ndarray) -> np.ndarray:
        current = often.coil("dc").current(np.array([time_s]))[0]
        return (1.9 * current**2 * 0.25 - rise) / 1200.0

    solved = solve_ivp(slope, (0, 3000), [0.0], t_eval=looks, max_step=1.0, rtol=1e-8)
    room = 22.5 + 0.2 * np.sin(2 * np.pi * looks / 10800.0)
    np.testing.assert_allclose(seen, solved.y[0] + room, atol=2e-3)


def test_the_device_warms_by_its_own_power_and_a_share_of_the_coils() -> None:
    own = STILL["warm_up"] | {"temperature_rise": "3 K"}
    bench = world({"warm_up": own, "powered_at_start": False}, room={"swing": "0 K"})
    bench.act("dut-power-on", 0.0)
    bench.coil("dc").hold(0.0, 10.0)
    late = np.array([900.0, 1e5])
    coil = bench.coil_temperature_degC(late) - 22.5
    np.testing.assert_allclose(
        bench.dut_temperature_degC(late) - 22.5 - 0.05 * coil, [3 * (1 - np.exp(-1)), 3.0]
    )
    assert coil[1] == pytest.approx(190 * 0.25, rel=1e-6)


def test_bias_and_scale_factor_follow_the_temperature() -> None:
    changes = {"K0_per_K": "30 uV", "Ki_per_K": "0.0001 V/g", "reference_temperature": "20 degC"}
    bench = world(changes, k={"Ki": 1.0}, room={"swing": "0 K"})
    bench.act("mount-io", 0.0)
    bench.rotation.put(0.0, 90.0)
    assert bench.mean_output_V(between(1, 2))[0] == pytest.approx(1 + 2.5 * 130e-6, abs=1e-12)


@pytest.mark.parametrize(
    ("degC", "ohm"), [(-50.0, 80.3063), (0.0, 100.0), (25.0, 109.7347), (100.0, 138.5055)]
)
def test_the_pt100_follows_the_table_of_iec_60751(degC: float, ohm: float) -> None:
    bench = world(
        {"pt100_at_0_degC": "100 ohm"}, room={"temperature": f"{degC} degC", "swing": "0 K"}
    )
    assert bench.mean_pt100_ohm(between(0, 10))[0] == pytest.approx(ohm, abs=1e-4)


def test_a_device_that_is_off_gives_nothing_and_switched_on_it_warms_up_and_drifts() -> None:
    slow = {"amplitude": "30 uV", "time_constant": "15 min", "temperature_rise": "0 K"}
    changes = {"powered_at_start": False, "warm_up": slow, "drift_in_one_hour": "20 uV"}
    bench = world(changes | {"noise_in_one_second": "3 uV"}, k={"K0": 1e-3})
    assert not bench.mean_output_V(np.arange(5.0)).any()
    assert not bench.dut_powered
    bench = world(changes, k={"K0": 1e-3})
    bench.act("dut-power-on", 10.0)
    assert bench.dut_powered
    times = np.array([9.0, 10.0, 10.001, 909.9995, 910.0005, 7209.9, 7210.1])
    seen = bench.mean_output_V(times)[[0, 1, 3, 5]] - 1e-3
    late = 40e-6 + 30e-6 * np.exp(-8)
    assert seen == pytest.approx([-1e-3, 30e-6, 5e-6 + 30e-6 / np.e, late], abs=1e-9)
    bench.act("dut-power-off", 8000.0)
    assert bench.mean_output_V(between(7999.0, 8001.0))[0] == pytest.approx(5.2e-4, rel=0.01)


def test_the_noise_is_white_and_the_same_whoever_looks() -> None:
    bench = world({"noise_in_one_second": "3 uV"}, k={})
    seconds = bench.mean_output_V(np.arange(4001.0))
    assert seconds.std() == pytest.approx(3e-6, rel=0.05)
    assert bench.mean_output_V(np.arange(0, 4001.0, 0.1)).std() == pytest.approx(9.5e-6, rel=0.05)
    again = bench.mean_output_V(np.arange(1000.0, 1101.0))
    np.testing.assert_allclose(again, seconds[1000:1100], atol=1e-18)
    neighbours = np.corrcoef(seconds[:-1], seconds[1:])[0, 1]
    assert abs(neighbours) < 0.06
    other = world(
        {"noise_in_one_second": "3 uV"},
        k={},
    ).mean_output_V(np.arange(11.0))
    np.testing.assert_allclose(other, seconds[:10], atol=1e-18)


def test_the_probe_feels_the_coil_the_room_and_the_magnet_that_turns_with_the_device() -> None:
    ambient = {"x": "0.02 mT", "y": "-0.004 mT", "z": "-0.04 mT"}
    bench = world({"magnet_at_probe": "3 uT"}, ambient_field=ambient)
    bench.act("mount-io", 0.0)
    bench.coil("dc").hold(0.0, 8.0)
    towards = np.array([10.0, -8.0, 6.0]) / np.sqrt(200.0)
    seen, magnets = [], []
    for k, angle in enumerate((0.0, 90.0, 200.0)):
        bench.rotation.put(100.0 * k, angle)
        seen.append(bench.mean_probe_field_mT(between(100.0 * k + 50, 100.0 * k + 51))[0])
        axis = np.array([np.cos(np.deg2rad(angle)), 0.0, np.sin(np.deg2rad(angle))])
        magnets.append(1.5e-3 * (3 * towards * (towards @ axis) - axis))
    coil = np.array(seen) - magnets - np.array([0.02, -0.004, -0.04])
    np.testing.assert_allclose(coil, coil[[0, 0, 0]], atol=1e-12)
    # Where the probe is, the field of the coil is not quite that of its centre.
    assert abs(coil[0, 0] / (8e3 * TESLA_PER_A) - 1) < 1e-3
    assert coil[0, 0] != pytest.approx(8e3 * TESLA_PER_A, rel=1e-6)


def test_the_probes_mean_follows_a_magnet_that_turns_on() -> None:
    bench = world({"magnet_at_probe": "1 mT"})
    bench.act("mount-io", 0.0)
    bench.rotation.move_to(1.0, 170.0, 60.0, 60.0)
    edges = np.array([0.5, 2.0, 3.3, 6.0])
    dense = [
        bench.mean_probe_field_mT(np.linspace(a, b, 1001)).mean(axis=0) for a, b in pairwise(edges)
    ]
    np.testing.assert_allclose(bench.mean_probe_field_mT(edges), dense, atol=1e-12)


def test_missing_truth_is_named_with_its_place() -> None:
    data = copy.deepcopy(BENCH["simulation"])
    del data["accelerometer"]["coefficients"]["Kom"]
    with pytest.raises(SimulationError, match=r"accelerometer\.coefficients: 'Kom' is missing"):
        AccelerometerBench(Truth(data, "simulation"))


def test_an_act_nobody_knows_is_an_error_that_names_the_known_ones() -> None:
    bench = world()
    for prompt in ("mount", "mount-oi", "io", "make-coffee"):
        with pytest.raises(SimulationError, match="mount-level"):
            bench.act(prompt, 0.0)
    assert bench.act("mount-level", 0.0).endswith(".")


def test_supply_gaussmeter_and_pulse_board_work_in_this_world() -> None:
    clock = VirtualClock()
    with served(clock, BENCH, PROCEDURE) as bench:
        bench.make_ready()
        with Line(bench, "coil_supply.dc", clock) as supply:
            supply.ask("FUNC:MODE CURR;:VOLT 30;:OUTP ON;:CURR 10;*OPC?")
            with Line(bench, "gaussmeter", clock) as gaussmeter:
                gaussmeter.ask("SENS:MODE DC;:SENS:AVER:COUN 50;*OPC?")
                clock.sleep(3.0)
                field_T = [float(x) for x in gaussmeter.ask("FETC:DC? ALL").split(",")]
            report = bench.simulation_report()
        assert field_T[1] == pytest.approx(0.05, rel=0.01)
        assert report["dut_powered"] and report["gyro_powered"]
        assert report["coils"]["dc"]["current_A"] == pytest.approx(10.0, abs=0.01)
        assert list(report["coils"]) == ["x", "y", "z", "dc"]
        with Frames(bench, clock) as board:
            assert board.command(1, 1, 100.0) == 0
            clock.sleep(1.05)
            frames = board.of(0x121)
        assert len(frames) == 10
        assert [frame[2:] for frame in frames] == [b"\0\0\0\0\x00\x80"] * 10
