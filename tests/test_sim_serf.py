"""The simulated vapour cell against physics worked out here a second time."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp
from sim_bench import SIMULATORS, Frames, Line

from sim_instruments.bench import SimulatedBench
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.serf_bench import SerfBench
from sim_instruments.world.serf_cell import slowing_down
from sim_instruments.world.voltages import VoltageHistory
from station.clock import VirtualClock

PROCEDURE = "serf-nonorthogonality"
SIM = Path(__file__).parent.parent / "config" / "benches" / "sim.yaml"
BENCH: dict[str, Any] = yaml.safe_load(SIM.read_text(encoding="utf-8"))
GAMMA = 2 * np.pi * 28.02495
UPRIGHT = {"towards_x": "0 deg", "towards_y": "0 deg", "towards_z": "0 deg"}
NO_EXCHANGE = "1e15 Hz"
R = 240.0

# What stands in the bench file, without its flaws: one field at a time is added by each test.
IDEAL: dict[str, Any] = {
    "gyro_was_running": False,
    "powered_at_start": True,
    "cell__exchange_rate": NO_EXCHANGE,
    "cell__temperature__swing": "0 K",
    "pump__lean": UPRIGHT,
    "pump__leak": "0 %",
    "pump__light_shift": "0 nT",
    "detector__probe": {"axis": "y", "lean": UPRIGHT},
    "detector__offset": "0 V",
    "detector__noise": "0 V",
    "detector__mains__amplitude": "0 V",
    "detector__full_polarisation": "1 V",
    "coils__angles": {"xy": "90 deg", "xz": "90 deg", "yz": "90 deg"},
    **{f"coils__{axis}__error": "0 %" for axis in "xyz"},
    **{f"coils__{axis}__time_constant": "1e-4 us" for axis in "xyz"},
    "coils__gradient__off_centre": "0 mm",
    **{f"residual_field__{axis}": "0 nT" for axis in "xyz"},
    "residual_field__drift_in_one_hour": dict.fromkeys("xyz", "0 nT"),
}

SHOTS = [(s, 0, 0) for s in (1, -1)]
SHOTS += [(s, r, 0) for s in (1, -1) for r in (1, -1)]
SHOTS += [(s, 0, r) for s in (1, -1) for r in (1, -1)]
SHOTS += [(0, s, r) for s in (1, -1) for r in (1, -1)]


class Stand:
    """A world with an output at each coil; `ideal` unless told otherwise, the pump on from 0 s."""

    def __init__(self, ideal: bool = True, pump: bool = True, **changes: Any) -> None:
        data = copy.deepcopy(BENCH["simulation"])
        for path, value in ((IDEAL if ideal else {}) | changes).items():
            *sections, key = path.split("__")
            place = data["serf"]
            for section in sections:
                place = place[section]
            place[key] = copy.deepcopy(value)
        self.world = SerfBench(Truth(data, "simulation"))
        self.outputs = {name: VoltageHistory() for name in ("x", "y", "z", "gradient")}
        for name, output in self.outputs.items():
            self.world.drive(name, output)
        if pump:
            self.world.pump(0.0, True)

    def field(self, time_s: float, nT: Sequence[float]) -> None:
        """Give the coils what by their nominal constants makes a field."""
        for axis, value in zip("xyz", nT, strict=True):
            self.outputs[axis].set(time_s, value / 20.0)

    def shoot(self, time_s: float, nT: Sequence[float]) -> None:
        """Switch the field on and the pump off at once, and both back after 0.12 s."""
        before = [20.0 * self.outputs[axis].now_V(time_s) for axis in "xyz"]
        self.field(time_s, nT)
        self.world.pump(time_s, False)
        self.field(time_s + 0.12, before)
        self.world.pump(time_s + 0.12, True)

    def spins(self, times: Any) -> np.ndarray:
        return self.world.course.polarisation(np.atleast_1d(np.asarray(times, dtype=float)))

    def seen(self, times: Any) -> np.ndarray:
        return self.world.detector_V(np.atleast_1d(np.asarray(times, dtype=float)))


def turned(spins: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Return the angle by which spins have turned about a field since the first of them, in rad."""
    along = field / np.linalg.norm(field)
    across = spins - np.outer(spins @ along, along)
    first = across[0] / np.linalg.norm(across[0])
    angle = np.arctan2(across @ np.cross(along, first), across @ first)
    return np.unwrap(angle)


def across(spins: np.ndarray, field: np.ndarray) -> np.ndarray:
    along = field / np.linalg.norm(field)
    return np.linalg.norm(spins - np.outer(spins @ along, along), axis=1)


def axes(xy: float, xz: float, yz: float) -> np.ndarray:
    """Return unit vectors with these angles in deg between them, one a row, the first along x."""
    xy, xz, yz = np.deg2rad([xy, xz, yz])
    y = np.array([np.cos(xy), np.sin(xy), 0.0])
    z_y = (np.cos(yz) - np.cos(xz) * np.cos(xy)) / np.sin(xy)
    z = np.array([np.cos(xz), z_y, np.sqrt(1 - np.cos(xz) ** 2 - z_y**2)])
    return np.array([[1.0, 0.0, 0.0], y, z])


@pytest.mark.parametrize(
    ("spin", "unpolarised", "polarised"), [("3/2", 6, 4), ("5/2", 38 / 3, 6), ("7/2", 22, 8)]
)
def test_the_slowing_down_factor_falls_from_unpolarised_to_polarised(
    spin: str, unpolarised: float, polarised: float
) -> None:
    factor = slowing_down(spin, np.linspace(0.0, 1.0, 21) ** 2)
    assert factor[[0, -1]] == pytest.approx([unpolarised, polarised], abs=1e-12)
    assert (np.diff(factor) < 0).all()


@pytest.mark.parametrize("spin", ["3/2", "5/2", "7/2"])
def test_the_phase_follows_the_logarithm_of_the_polarisation(spin: str) -> None:
    stand = Stand(cell__nuclear_spin=spin, pump__rate="360 Hz")
    stand.shoot(5.0, (50.0, 0.0, 0.0))
    times = 5.000001 + np.arange(1000) * 1e-4
    spins = stand.spins(times)
    size = np.linalg.norm(spins, axis=1)
    assert size[0] == pytest.approx(0.6, abs=1e-4)
    phase = turned(spins, np.array([1.0, 0.0, 0.0]))
    expected = GAMMA * 50.0 / R * np.log(size[0] / size)
    np.testing.assert_allclose(phase, expected, atol=1e-9 * expected[-1])
    if spin == "3/2":
        law = size**3 / (1 + size**2)
        decay = np.exp(-R / 2 * (times - times[0]))
        np.testing.assert_allclose(law / law[0], decay, rtol=1e-9 * R / 2 * 0.1)


def test_a_positive_field_along_x_turns_spins_from_z_to_minus_y() -> None:
    stand = Stand()
    stand.shoot(5.0, (50.0, 0.0, 0.0))
    assert stand.seen(5.0002)[0] < -0.01
    assert stand.spins(5.0002)[0] == pytest.approx([0.0, -0.0284, 0.0969], abs=2e-3)


@pytest.mark.parametrize(
    ("shot", "swing"),
    [
        ((1, 0, 0), 1.0),
        ((1, 1, 0), 0.5**0.5),
        ((1, 0, 1), 0.5**0.5),
        ((0, 1, 1), 0.5),
        ((0, 1, 0), 0.0),
        ((0, 0, 1), 0.0),
    ],
)
def test_the_swing_is_that_of_both_angles_and_a_baseline_decays_beside_it(
    shot: tuple[int, int, int], swing: float
) -> None:
    stand = Stand()
    stand.shoot(5.0, 50.0 * np.array(shot))
    times = 5.00001 + np.arange(1000) * 1e-4
    size = np.linalg.norm(stand.spins(times), axis=1)
    phase = GAMMA * 50.0 * np.linalg.norm(shot) / R * np.log(size[0] / size)
    design = np.column_stack([np.cos(phase), np.sin(phase), np.ones(1000)])
    fit, *_ = np.linalg.lstsq(design, stand.seen(times) / size, rcond=None)
    along = np.array(shot) / np.linalg.norm(shot)
    assert np.hypot(*fit[:2]) == pytest.approx(swing, abs=1e-6)
    assert fit[2] == pytest.approx(along[1] * along[2], abs=1e-6)
    np.testing.assert_allclose(design @ fit, stand.seen(times) / size, atol=1e-6)


@pytest.mark.parametrize(
    ("spin", "q", "levels"), [("3/2", 6, 4), ("5/2", 38 / 3, 6), ("7/2", 22, 8)]
)
def test_spin_exchange_pulls_and_broadens_as_two_coupled_levels_do(
    spin: str, q: float, levels: int
) -> None:
    exchange, field = 5e5, 200.0
    stand = Stand(
        cell__nuclear_spin=spin, cell__exchange_rate=f"{exchange} Hz", pump__rate="0.24 Hz"
    )
    stand.shoot(100.0, (field, 0.0, 0.0))
    times = 100.001 + np.linspace(0.0, 0.02, 201)
    spins = stand.spins(times)
    rate = np.polyfit(times, turned(spins, np.array([1.0, 0, 0])), 1)[0]
    fades = -np.polyfit(times, np.log(across(spins, np.array([1.0, 0, 0]))), 1)[0]
    # Two levels that precess in opposite senses and share their spins at spin temperature.
    omega, k = GAMMA * field / levels, exchange * 2 * q / levels**2
    upper, lower = 0.5 * (1 + levels / q), 0.5 * (1 - levels / q)
    coupled = [[1j * omega - k * lower, k * upper], [k * lower, -1j * omega - k * upper]]
    slow = max(np.linalg.eigvals(coupled), key=lambda one: one.real)
    assert rate == pytest.approx(slow.imag, rel=1e-5)
    assert fades - R / q == pytest.approx(-slow.real, rel=3e-3)
    if spin == "3/2":
        bare = GAMMA * field / 6
        assert rate / bare - 1 == pytest.approx(4.444 * (bare / exchange) ** 2, rel=0.02)
        assert fades - R / 6 == pytest.approx(1.667 * bare**2 / exchange, rel=3e-3)


def test_a_whole_shot_is_that_of_the_vector_equation_integrated_in_the_laboratory() -> None:
    stand = Stand(ideal=False, pump__leak="3 %", detector__noise="0 V", gyro_was_running=True)
    world = stand.world
    for prompt in world.preparations:
        world.act(prompt, 0.0)
    stand.field(20.0, (1.0, 2.0, -0.5))
    start = 30.0
    stand.shoot(start, (40.0, -50.0, 30.0))
    times = start + np.arange(1000) * 1e-4
    cell, field_now = world.cell, world.course.field_nT
    q_scale = 1 + 1e-3 * 0.1 * np.sin(2 * np.pi * start / 1200)
    exchange = 5e5 * (1 + 0.06 * 0.1 * np.sin(2 * np.pi * start / 1200))
    # The field varies smoothly while it rises and while the nuclei turn; that is tested apart.
    knots = np.concatenate([np.linspace(0, 5e-4, 4001)[:-1], np.linspace(5e-4, 0.1, 801)])
    fields = field_now(start + knots)

    def slope(after: float, p: np.ndarray) -> np.ndarray:
        b = np.array([np.interp(after, knots, fields[:, k]) for k in range(3)])
        x = p @ p
        bare_q = (6 + 2 * x) / (1 + x)
        q, size = bare_q * q_scale, np.linalg.norm(b)
        w = GAMMA * size / q
        broad = w**2 / exchange * (bare_q**2 - 16) / (2 * bare_q)
        pull = 16 * (bare_q**2 - 16) / (2 * bare_q**2) * (w / exchange) ** 2
        n, pumping = b / size, 0.03 * 27.0
        turn = w * (1 + pull) * np.cross(n, p) - broad * (p - n * (n @ p))
        return turn + (pumping * (cell.pump_axis - p) - R * p) / q

    first = stand.spins(start)[0]
    options = {"rtol": 1e-9, "atol": 1e-12, "max_step": 1e-4}
    done = solve_ivp(slope, (0, 0.02), first, "DOP853", t_eval=times[:200] - start, **options)
    assert np.linalg.norm(first) == pytest.approx(0.1, rel=0.5)
    np.testing.assert_allclose(stand.spins(times)[:200], done.y.T, atol=1e-6)


def test_the_residual_field_moves_the_frequencies_as_the_expansion_says() -> None:
    angles, residual = (91.2, 88.9, 90.6), np.array([1.0, -0.6, 0.8])
    factors = 1 + np.array([1.0, -0.5, 0.8]) / 100
    stand = Stand(
        pump__rate="0.024 Hz",
        coils__angles=dict(zip(("xy", "xz", "yz"), (f"{a} deg" for a in angles), strict=True)),
        **{
            f"coils__{axis}__error": f"{100 * f - 100} %"
            for axis, f in zip("xyz", factors, strict=True)
        },
        **{f"residual_field__{axis}": f"{b} nT" for axis, b in zip("xyz", residual, strict=True)},
    )
    u = axes(*angles)
    squares = {}
    for k, shot in enumerate(SHOTS):
        start = 100.0 + 2.0 * k
        stand.shoot(start, 50.0 * np.array(shot))
        times = start + 1e-4 + np.arange(200) * 1e-4
        field = (50.0 * np.array(shot) * factors) @ u + residual
        angle = turned(stand.spins(times), field)
        squares[shot] = (angle[-1] / (times[-1] - times[0])) ** 2
    a, rho = GAMMA / 6 * 50.0 * factors, GAMMA / 6 * residual
    for shot, square in squares.items():
        s = np.array(shot)
        expected = np.sum((s * a) ** 2) + rho @ rho + 2 * (s * a) @ u @ rho
        expected += np.sum([s[i] * s[j] * 2 * a[i] * a[j] * u[i] @ u[j] for i, j in PAIRS])
        assert square == pytest.approx(expected, rel=1e-6)
    for (i, j), angle in zip(PAIRS, angles, strict=True):
        four = [(s, squares[s]) for s in SHOTS if s[i] and s[j]]
        cosine = sum(s[i] * s[j] * square for s, square in four) / (8 * a[i] * a[j])
        assert cosine == pytest.approx(np.cos(np.deg2rad(angle)), abs=1e-6)


PAIRS = [(0, 1), (0, 2), (1, 2)]


def test_with_the_pump_on_the_detector_shows_the_steady_state_of_the_bloch_equation() -> None:
    stand = Stand()
    for k, field in enumerate(
        [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (2.0, -1.0, 0.7), (0.0, 3.0, 3.0)]
    ):
        stand.field(10.0 * k + 1.0, field)
        bx, by, bz = GAMMA * np.array(field)
        turn = np.array([[0.0, -bz, by], [bz, 0.0, -bx], [-by, bx, 0.0]])
        steady = np.linalg.solve((R + 27.0) * np.eye(3) - turn, [0.0, 0.0, 27.0])
        seen = stand.spins([10.0 * k + 5.0, 10.0 * k + 9.0])
        np.testing.assert_allclose(seen, [steady, steady], atol=1e-9)


def test_a_closed_loop_on_the_measured_response_finds_the_zero_of_the_field() -> None:
    residual = {"x": "1.2 nT", "y": "-0.9 nT", "z": "0.8 nT"}
    stand = Stand(**{f"residual_field__{axis}": text for axis, text in residual.items()})
    field, now = np.zeros(3), 0.0

    def response(change: Sequence[float]) -> float:
        nonlocal now
        now += 1.0
        stand.field(now, field + change)
        return float(stand.seen(now + 0.9)[0])

    def slope(axis: int) -> float:
        step = 0.3 * np.eye(3)[axis]
        return response(step) - response(-step)

    for _ in range(12):
        for axis, shown_by in ((0, None), (1, 2), (2, 1)):
            values = []
            for offset in (-0.2, 0.2):
                field[axis] += offset
                values.append(response(np.zeros(3)) if shown_by is None else slope(shown_by))
                field[axis] -= offset
            gain = (values[1] - values[0]) / 0.4
            field[axis] -= np.clip(np.mean(values) / gain, -0.5, 0.5) if gain else 0.0
    assert field == pytest.approx([-1.2, 0.9, -0.8], abs=1e-3)


def test_after_a_shot_the_pump_fills_the_cell_again_within_a_tenth_of_a_second() -> None:
    stand = Stand()
    stand.shoot(5.0, (50.0, 0.0, 0.0))
    after = np.array([0.0, 0.02, 0.04, 0.1, 0.5, 1.0])
    spins = stand.spins(5.12 + after)[:, 2]
    full = 27.0 / (R + 27.0)
    expected = full - (full - spins[0]) * np.exp(-(R + 27.0) / 6.0 * after)
    assert spins[0] < 0.05 * full
    np.testing.assert_allclose(spins, expected, rtol=0.03)
    assert spins[-1] == pytest.approx(full, rel=1e-9)


def test_light_that_leaks_shortens_the_decay_and_shifts_the_field() -> None:
    x = np.array([1.0, 0.0, 0.0])
    sizes, angles = [], []
    for leak in ("0 %", "20 %"):
        stand = Stand(pump__leak=leak, pump__light_shift="60 nT")
        stand.shoot(5.0, (50.0, 0.0, 0.0))
        spins = stand.spins(5.001 + np.arange(200) * 1e-4)
        field = np.array([50.0, 0.0, 12.0 if leak == "20 %" else 0.0])
        sizes.append(across(spins, field)[-1] / across(spins, field)[0])
        angles.append(turned(spins, field)[-1])
    assert sizes[1] / sizes[0] == pytest.approx(np.exp(-0.2 * 27 / 6 * 0.0199), rel=5e-3)
    assert angles[1] / angles[0] == pytest.approx(np.hypot(50, 12) / 50, rel=1e-3)
    assert x @ stand.world.course.field_nT(np.array([4.0]))[0] == 0.0


def test_the_nuclei_are_a_field_when_the_gyro_was_running_and_only_then() -> None:
    noble = {"field": {"x": "3 nT", "y": "-2 nT", "z": "160 nT"}}
    base = BENCH["simulation"]["serf"]["noble_gas"] | noble
    assert not Stand().world.course.nuclear_nT(np.array([0.0, 10.0])).any()
    stand = Stand(gyro_was_running=True, noble_gas=base)
    field = stand.world.course.nuclear_nT(np.array([0.0, 600.0]))
    np.testing.assert_allclose(field[0], [3.0, -2.0, 160.0], rtol=1e-9)
    np.testing.assert_allclose(field[1], field[0] * np.exp(-600 / 2400), rtol=1e-9)
    np.testing.assert_allclose(stand.world.course.field_nT(np.array([600.0])), field[1:])
    # About an applied field they turn by their own, negative ratio.
    stand.field(700.0, (50.0, 0.0, 0.0))
    turning = stand.world.course.nuclear_nT(700.001 + np.linspace(0.0, 2.0, 21))
    angle = turned(turning, np.array([1.0, 0.0, 0.0]))
    assert angle[-1] == pytest.approx(-2 * np.pi * 0.003361 * 50.0 * 2.0, rel=1e-9)


def test_a_gradient_depolarises_the_nuclei_within_a_second_and_the_electrons_at_once() -> None:
    stand = Stand(gyro_was_running=True)
    stand.outputs["gradient"].set(60.0, 8.0)
    stand.outputs["gradient"].set(63.0, 0.0)
    nuclear = np.linalg.norm(
        stand.world.course.nuclear_nT(np.array([0.0, 60.0, 60.1, 61.0, 64.0])), axis=1
    )
    assert nuclear[1] > 0.97 * nuclear[0]
    # Near zero field diffusion across the cell is the limit; in 300 nT the gradient is.
    assert nuclear[2] / nuclear[1] == pytest.approx(np.exp(-1.6), rel=1e-2)
    assert nuclear[3] < 1e-4 and nuclear[4] < 1e-9
    across2 = 2000.0**2 / 2 * 16 * (0.5 / np.pi) ** 2 / 300.0**2
    decay = stand.world.nuclei.decay_per_s(300.0, 2000.0)
    assert decay == pytest.approx(1 / (1 / across2 + 1 / 16) + 1 / 2400, rel=1e-12)
    spins = stand.spins([59.0, 61.0, 63.05, 65.0])
    assert np.linalg.norm(spins[1]) < 1e-3
    assert 0.05 < spins[2, 2] < spins[3, 2] == pytest.approx(27 / 267, rel=1e-3)


def test_a_gradient_coil_off_its_centre_makes_a_field() -> None:
    stand = Stand(coils__gradient__off_centre="0.4 mm")
    stand.outputs["gradient"].set(5.0, 8.0)
    field = stand.world.course.field_nT(np.array([4.0, 6.0]))
    np.testing.assert_allclose(field, [[0, 0, 0], [0, 0, 80.0]], atol=1e-12)


def test_currents_come_with_the_time_constant_of_each_coil() -> None:
    stand = Stand(coils__x__time_constant="20 us", coils__y__time_constant="40 us")
    stand.field(5.0, (50.0, 30.0, 0.0))
    stand.field(5.00003, (0.0, 30.0, 0.0))
    field = stand.world.course.field_nT(np.array([5.0, 5.00002, 5.00003, 5.00007, 5.01]))
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
        stand = Stand(
            cell__temperature={
                "swing": swing,
                "period": "20 min",
                "slowing_down_per_K": "1 %",
                "exchange_per_K": "6 %",
            },
            pump__rate="0.24 Hz",
        )
        stand.shoot(300.0, (50.0, 0.0, 0.0))
        spins = stand.spins(300.001 + np.arange(200) * 1e-4)
        angles.append(turned(spins, np.array([1.0, 0, 0]))[-1])
    assert angles[0] / angles[1] == pytest.approx(1.01, rel=1e-5)


def fourteen_shots(stand: Stand, pieces: int = 1) -> np.ndarray:
    records = []
    for k, shot in enumerate(SHOTS):
        start = 10.0 + 2.0 * k
        stand.shoot(start, 50.0 * np.array(shot))
        times = start + np.arange(1000) * 1e-4
        records += [stand.seen(part) for part in np.array_split(times, pieces)]
    return np.concatenate(records).reshape(len(SHOTS), 1000)


def ready(**changes: Any) -> Stand:
    stand = Stand(ideal=False, **changes)
    for prompt in stand.world.preparations:
        stand.world.act(prompt, 0.0)
    return stand


def test_the_same_times_give_the_same_values_however_they_are_asked_for() -> None:
    stand = ready()
    records = fourteen_shots(stand)
    again = np.array([stand.seen(10.0 + 2.0 * k + np.arange(1000) * 1e-4) for k in range(14)])
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
    stand = ready()
    fourteen_shots(stand)
    assert stand.world.course.steps <= 14 * 700
    idle = ready()
    for k in range(200):
        idle.shoot(100.0 + 60.0 * k, (50.0, 0.0, 0.0))
    idle.seen(90000.0)
    assert idle.world.course.steps == 0
    idle.seen(100.0 + 60.0 * 199 + np.arange(1000) * 1e-4)
    assert 0 < idle.world.course.steps <= 700


def test_changes_faster_than_the_spins_follow_are_all_felt() -> None:
    slow, fast = Stand(), Stand()
    for k in range(200):
        fast.field(5.0 + 0.001 * k, (0.4 * (-1) ** k, 0.0, 0.0))
    for stand in (slow, fast):
        stand.field(5.2, (0.0, 0.0, 0.0))
    end = fast.spins([5.1, 5.2, 5.21])
    assert np.ptp(end[:, 1]) > 1e-4
    np.testing.assert_allclose(end[:, 2], slow.spins([5.1, 5.2, 5.21])[:, 2], rtol=1e-3)


def test_mains_are_on_the_wire_at_their_phase_and_drift_moves_the_residual_field() -> None:
    mains = {"frequency": "50 Hz", "amplitude": "20 mV", "phase": "90 deg"}
    drift = {"x": "0 nT", "y": "0 nT", "z": "2 nT"}
    stand = Stand(detector__mains=mains, residual_field__drift_in_one_hour=drift)
    seen = stand.seen([7200.0, 7200.005, 7200.01])
    np.testing.assert_allclose(seen, [0.02, 0.0, -0.02], atol=1e-9)
    field = stand.world.course.field_nT(np.array([0.0, 7200.0]))
    np.testing.assert_allclose(field, [[0, 0, 0], [0, 0, 4.0]], atol=1e-9)


def test_a_cold_cell_shows_no_spins_and_a_dark_detector_nothing() -> None:
    stand = Stand(powered_at_start=False, detector__offset="7 mV", residual_field__x="1 nT")
    world = stand.world
    assert world.preparations == ("connect-cables", "dut-power-on", "heat-cell", "gyro-at-rest")
    assert not world.dut_powered and stand.seen(5.0)[0] == 0.0
    assert world.act("dut-power-on", 10.0).endswith(".")
    assert world.dut_powered and stand.seen(15.0)[0] == pytest.approx(7e-3)
    world.act("heat-cell", 20.0)
    assert stand.seen(25.0)[0] < -0.01
    world.act("dut-power-off", 30.0)
    assert not world.dut_powered
    np.testing.assert_allclose(stand.seen([25.0, 35.0])[1], 0.0)
    world.act("dut-power-on", 40.0)
    assert stand.seen(45.0)[0] == pytest.approx(7e-3)


def test_a_person_who_heats_the_cell_switches_it_on() -> None:
    stand = Stand(powered_at_start=False, pump=False)
    stand.world.act("heat-cell", 1.0)
    assert stand.world.dut_powered
    assert not stand.spins(5.0).any()
    stand.world.pump(6.0, True)
    assert stand.spins(9.0)[0, 2] == pytest.approx(27 / 267)


def test_an_act_nobody_knows_is_an_error_that_names_the_known_ones() -> None:
    stand = Stand()
    for prompt in ("mount", "heat", "mount-io"):
        with pytest.raises(SimulationError, match="gyro-at-rest"):
            stand.world.act(prompt, 0.0)
    assert stand.world.act("gyro-at-rest", 0.0).endswith(".")
    assert stand.world.act("connect-cables", 0.0).endswith(".")


def test_a_command_to_the_pump_replaces_what_was_planned_after_it() -> None:
    stand = Stand()
    stand.world.pump(5.01, False)
    stand.world.pump(5.005, True)
    assert stand.spins(6.0)[0, 2] == pytest.approx(27 / 267)


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
        Stand(**changes)


def test_a_coil_that_is_not_there_or_driven_twice_is_an_error() -> None:
    stand = Stand()
    with pytest.raises(SimulationError, match="no coil 'w'"):
        stand.world.drive("w", VoltageHistory())
    with pytest.raises(SimulationError, match="driven by two outputs"):
        stand.world.drive("x", VoltageHistory())


def test_the_instruments_of_the_other_benches_serve_in_this_world() -> None:
    clock = VirtualClock()
    with clock.participant("test"):
        bench = SimulatedBench(BENCH, clock, PROCEDURE, SIMULATORS)
        try:
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
        finally:
            bench.close()
            clock.stop()
