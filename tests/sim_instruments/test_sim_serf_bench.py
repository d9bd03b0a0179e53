"""The simulated bench of the vapour cell: light, nuclei, coils, acts, noise, and its thrift."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from cell_fixture import BENCH, SHOTS, Fixture, R, across, turned
from sim_bench import Frames, Line, served

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.serf import SerfBench
from sim_instruments.world.serf_coils import VoltageHistory
from station.clock import VirtualClock

PROCEDURE = "serf-nonorthogonality"


def test_after_a_shot_the_pump_fills_the_cell_again_within_a_tenth_of_a_second() -> None:
    fixture = Fixture()
    fixture.shoot(5.0, (50.0, 0.0, 0.0))
    after = np.array([0.0, 0.02, 0.04, 0.1, 0.5, 1.0])
    spins = fixture.spins(5.12 + after)[:, 2]
    full = 27.0 / (R + 27.0)
    expected = full - (full - spins[0]) * np.exp(-(R + 27.0) / 6.0 * after)
    assert spins[0] < 0.05 * full
    np.testing.assert_allclose(spins, expected, rtol=0.03)
    assert spins[-1] == pytest.approx(full, rel=1e-9)


def test_light_that_leaks_shortens_the_decay_and_shifts_the_field() -> None:
    x = np.array([1.0, 0.0, 0.0])
    sizes, angles = [], []
    for leak in ("0 %", "20 %"):
        fixture = Fixture(pump__leak=leak, pump__light_shift="60 nT")
        fixture.shoot(5.0, (50.0, 0.0, 0.0))
        spins = fixture.spins(5.001 + np.arange(200) * 1e-4)
        field = np.array([50.0, 0.0, 12.0 if leak == "20 %" else 0.0])
        sizes.append(across(spins, field)[-1] / across(spins, field)[0])
        angles.append(turned(spins, field)[-1])
    assert sizes[1] / sizes[0] == pytest.approx(np.exp(-0.2 * 27 / 6 * 0.0199), rel=5e-3)
    assert angles[1] / angles[0] == pytest.approx(np.hypot(50, 12) / 50, rel=1e-3)
    assert x @ fixture.world.trajectory.field_nT(np.array([4.0]))[0] == 0.0


def test_the_nuclei_are_a_field_when_the_gyro_was_running_and_only_then() -> None:
    noble = {"field": {"x": "3 nT", "y": "-2 nT", "z": "160 nT"}}
    base = BENCH["simulation"]["serf"]["noble_gas"] | noble
    assert not Fixture().world.trajectory.nuclear_nT(np.array([0.0, 10.0])).any()
    fixture = Fixture(gyro_was_running=True, noble_gas=base)
    field = fixture.world.trajectory.nuclear_nT(np.array([0.0, 600.0]))
    np.testing.assert_allclose(field[0], [3.0, -2.0, 160.0], rtol=1e-9)
    np.testing.assert_allclose(field[1], field[0] * np.exp(-600 / 2400), rtol=1e-9)
    np.testing.assert_allclose(fixture.world.trajectory.field_nT(np.array([600.0])), field[1:])
    # About an applied field they turn by their own, negative ratio.
    fixture.field(700.0, (50.0, 0.0, 0.0))
    turning = fixture.world.trajectory.nuclear_nT(700.001 + np.linspace(0.0, 2.0, 21))
    angle = turned(turning, np.array([1.0, 0.0, 0.0]))
    assert angle[-1] == pytest.approx(-2 * np.pi * 0.003361 * 50.0 * 2.0, rel=1e-9)


def test_a_gradient_depolarises_the_nuclei_within_a_second_and_the_electrons_at_once() -> None:
    fixture = Fixture(gyro_was_running=True)
    fixture.outputs["gradient"].set(60.0, 8.0)
    fixture.outputs["gradient"].set(63.0, 0.0)
    nuclear = np.linalg.norm(
        fixture.world.trajectory.nuclear_nT(np.array([0.0, 60.0, 60.1, 61.0, 64.0])), axis=1
    )
    assert nuclear[1] > 0.97 * nuclear[0]
    # Near zero field diffusion across the cell is the limit; in 300 nT the gradient is.
    assert nuclear[2] / nuclear[1] == pytest.approx(np.exp(-1.6), rel=1e-2)
    assert nuclear[3] < 1e-4 and nuclear[4] < 1e-9
    across2 = 2000.0**2 / 2 * 16 * (0.5 / np.pi) ** 2 / 300.0**2
    decay = fixture.world.nuclei.decay_per_s(300.0, 2000.0)
    assert decay == pytest.approx(1 / (1 / across2 + 1 / 16) + 1 / 2400, rel=1e-12)
    spins = fixture.spins([59.0, 61.0, 63.05, 65.0])
    assert np.linalg.norm(spins[1]) < 1e-3
    assert 0.05 < spins[2, 2] < spins[3, 2] == pytest.approx(27 / 267, rel=1e-3)


def test_a_gradient_coil_off_its_centre_makes_a_field() -> None:
    fixture = Fixture(coils__gradient__off_centre="0.4 mm")
    fixture.outputs["gradient"].set(5.0, 8.0)
    field = fixture.world.trajectory.field_nT(np.array([4.0, 6.0]))
    np.testing.assert_allclose(field, [[0, 0, 0], [0, 0, 80.0]], atol=1e-12)


def test_currents_come_with_the_time_constant_of_each_coil() -> None:
    fixture = Fixture(coils__x__time_constant="20 us", coils__y__time_constant="40 us")
    fixture.field(5.0, (50.0, 30.0, 0.0))
    fixture.field(5.00003, (0.0, 30.0, 0.0))
    field = fixture.world.trajectory.field_nT(np.array([5.0, 5.00002, 5.00003, 5.00007, 5.01]))
    x = 50 * (1 - np.exp(-np.array([0.0, 1.0, 1.5])))
    np.testing.assert_allclose(field[:3, 0], x, atol=1e-5)
    assert field[3, 0] == pytest.approx(x[2] * np.exp(-2.0), abs=1e-5)
    np.testing.assert_allclose(
        field[:4, 1], 30 * -np.expm1(-np.array([0, 0.5, 0.75, 1.75])), atol=1e-5
    )
    np.testing.assert_allclose(field[4], [0.0, 30.0, 0.0], atol=1e-9)


def test_a_warmer_cell_has_another_slowing_down_factor() -> None:
    angles = []
    for swing in ("0 K", "1 K"):
        fixture = Fixture(
            cell__temperature={
                "swing": swing,
                "period": "20 min",
                "slowing_down_per_K": "1 %",
                "exchange_per_K": "6 %",
            },
            pump__rate="0.24 Hz",
        )
        fixture.shoot(300.0, (50.0, 0.0, 0.0))
        spins = fixture.spins(300.001 + np.arange(200) * 1e-4)
        angles.append(turned(spins, np.array([1.0, 0, 0]))[-1])
    assert angles[0] / angles[1] == pytest.approx(1.01, rel=1e-5)


def fourteen_shots(fixture: Fixture, pieces: int = 1) -> np.ndarray:
    records = []
    for k, shot in enumerate(SHOTS):
        start = 10.0 + 2.0 * k
        fixture.shoot(start, 50.0 * np.array(shot))
        times = start + np.arange(1000) * 1e-4
        records += [fixture.seen(part) for part in np.array_split(times, pieces)]
    return np.concatenate(records).reshape(len(SHOTS), 1000)


def ready(**changes: Any) -> Fixture:
    fixture = Fixture(ideal=False, **changes)
    for prompt in fixture.world.preparations:
        fixture.world.act(prompt, 0.0)
    return fixture


def test_the_same_times_give_the_same_values_however_they_are_asked_for() -> None:
    fixture = ready()
    records = fourteen_shots(fixture)
    again = np.array([fixture.seen(10.0 + 2.0 * k + np.arange(1000) * 1e-4) for k in range(14)])
    np.testing.assert_array_equal(again, records)
    np.testing.assert_array_equal(fourteen_shots(ready(), pieces=7), records)
    late = ready()
    for k, shot in enumerate(SHOTS):
        late.shoot(10.0 + 2.0 * k, 50.0 * np.array(shot))
    for k in (13, 4, 0):
        times = 10.0 + 2.0 * k + np.arange(1000) * 1e-4
        np.testing.assert_array_equal(late.seen(times), records[k])


def test_another_seed_is_another_noise_and_it_is_white() -> None:
    quiet, noisy = ready(detector__noise="0 V"), ready()
    times = 5.0 + np.arange(20000) * 1e-4
    noise = noisy.seen(times) - quiet.seen(times)
    assert noise.std() == pytest.approx(5e-3, rel=0.03)
    assert abs(np.corrcoef(noise[:-1], noise[1:])[0, 1]) < 0.03
    data = copy.deepcopy(BENCH["simulation"]) | {"seed": 2}
    assert (SerfBench(Truth(data, "simulation")).detector_V(times) != noisy.seen(times)).all()


def test_fourteen_shots_take_some_hundred_steps_each_and_idle_time_none() -> None:
    fixture = ready()
    fourteen_shots(fixture)
    assert fixture.world.trajectory.steps <= 14 * 700
    idle = ready()
    for k in range(200):
        idle.shoot(100.0 + 60.0 * k, (50.0, 0.0, 0.0))
    idle.seen(90000.0)
    assert idle.world.trajectory.steps == 0
    idle.seen(100.0 + 60.0 * 199 + np.arange(1000) * 1e-4)
    assert 0 < idle.world.trajectory.steps <= 700


def test_changes_faster_than_the_spins_follow_are_all_felt() -> None:
    slow, fast = Fixture(), Fixture()
    for k in range(200):
        fast.field(5.0 + 0.001 * k, (0.4 * (-1) ** k, 0.0, 0.0))
    for fixture in (slow, fast):
        fixture.field(5.2, (0.0, 0.0, 0.0))
    end = fast.spins([5.1, 5.2, 5.21])
    assert np.ptp(end[:, 1]) > 1e-4
    np.testing.assert_allclose(end[:, 2], slow.spins([5.1, 5.2, 5.21])[:, 2], rtol=1e-3)


def test_mains_are_on_the_wire_at_their_phase_and_drift_moves_the_residual_field() -> None:
    mains = {"frequency": "50 Hz", "amplitude": "20 mV", "phase": "90 deg"}
    drift = {"x": "0 nT", "y": "0 nT", "z": "2 nT"}
    fixture = Fixture(detector__mains=mains, residual_field__drift_in_one_hour=drift)
    seen = fixture.seen([7200.0, 7200.005, 7200.01])
    np.testing.assert_allclose(seen, [0.02, 0.0, -0.02], atol=1e-9)
    field = fixture.world.trajectory.field_nT(np.array([0.0, 7200.0]))
    np.testing.assert_allclose(field, [[0, 0, 0], [0, 0, 4.0]], atol=1e-9)


def test_a_cold_cell_shows_no_spins_and_a_dark_detector_nothing() -> None:
    fixture = Fixture(powered_at_start=False, detector__offset="7 mV", residual_field__x="1 nT")
    world = fixture.world
    assert world.preparations == ("connect-cables", "dut-power-on", "heat-cell", "gyro-at-rest")
    assert not world.dut_powered and fixture.seen(5.0)[0] == 0.0
    assert world.act("dut-power-on", 10.0).endswith(".")
    assert world.dut_powered and fixture.seen(15.0)[0] == pytest.approx(7e-3)
    world.act("heat-cell", 20.0)
    assert fixture.seen(25.0)[0] < -0.01
    world.act("dut-power-off", 30.0)
    assert not world.dut_powered
    np.testing.assert_allclose(fixture.seen([25.0, 35.0])[1], 0.0)
    world.act("dut-power-on", 40.0)
    assert fixture.seen(45.0)[0] == pytest.approx(7e-3)


def test_a_person_who_heats_the_cell_switches_it_on() -> None:
    fixture = Fixture(powered_at_start=False, pump=False)
    fixture.world.act("heat-cell", 1.0)
    assert fixture.world.dut_powered
    assert not fixture.spins(5.0).any()
    fixture.world.pump(6.0, True)
    assert fixture.spins(9.0)[0, 2] == pytest.approx(27 / 267)


def test_an_act_nobody_knows_is_an_error_that_names_the_known_ones() -> None:
    fixture = Fixture()
    for prompt in ("mount", "heat", "mount-io"):
        with pytest.raises(SimulationError, match="gyro-at-rest"):
            fixture.world.act(prompt, 0.0)
    assert fixture.world.act("gyro-at-rest", 0.0).endswith(".")
    assert fixture.world.act("connect-cables", 0.0).endswith(".")


def test_a_command_to_the_pump_replaces_what_was_planned_after_it() -> None:
    fixture = Fixture()
    fixture.world.pump(5.01, False)
    fixture.world.pump(5.005, True)
    assert fixture.spins(6.0)[0, 2] == pytest.approx(27 / 267)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"cell__nuclear_spin": "1/2"}, "one of 3/2, 5/2, 7/2, got '1/2'"),
        ({"cell__relaxation_rate": "0 Hz"}, "relaxation_rate: must be positive"),
        ({"pump__axis": "w"}, "pump.axis: x, y or z was expected"),
        (
            {"coils__angles__xz": "20 deg", "coils__angles__yz": "20 deg"},
            "no three axes have these angles",
        ),
        ({"coils__x__time_constant": "0 s"}, "time constants must be positive"),
        ({"noble_gas": {}}, "noble_gas: 'field' is missing"),
    ],
)
def test_a_wrong_truth_is_named_with_its_place(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SimulationError, match=said):
        Fixture(**changes)


def test_a_coil_that_is_not_there_or_driven_twice_is_an_error() -> None:
    fixture = Fixture()
    with pytest.raises(SimulationError, match="no coil 'w'"):
        fixture.world.drive("w", VoltageHistory())
    with pytest.raises(SimulationError, match="driven by two outputs"):
        fixture.world.drive("x", VoltageHistory())


def test_the_instruments_of_the_other_benches_serve_in_this_world() -> None:
    clock = VirtualClock()
    with served(clock, BENCH, PROCEDURE) as bench:
        bench.make_ready()
        with Line(bench, "coil_supply.x", clock) as supply:
            supply.ask("FUNC:MODE CURR;:VOLT 10;:OUTP ON;:CURR 2;*OPC?")
        with Line(bench, "gaussmeter", clock) as gaussmeter:
            gaussmeter.ask("SENS:MODE DC;:SENS:AVER:COUN 50;*OPC?")
            clock.sleep(3.0)
            field_T = [float(x) for x in gaussmeter.ask("FETC:DC? ALL").split(",")]
        report = bench.simulation_report()
        assert abs(field_T[1]) < 1e-4
        assert report["dut_powered"]
        assert report["coils"]["x"]["current_A"] == pytest.approx(2.0, abs=0.01)
        with Frames(bench, clock) as board:
            assert board.command(1, 1, 100.0) == 0
