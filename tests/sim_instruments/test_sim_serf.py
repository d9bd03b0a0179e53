"""The spins of the simulated vapour cell against physics worked out here a second time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from cell_fixture import GAMMA, SHOTS, Fixture, R, across, turned
from scipy.integrate import solve_ivp

from sim_instruments.world.serf_cell import slowing_down

PAIRS = [(0, 1), (0, 2), (1, 2)]


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
    fixture = Fixture(cell__nuclear_spin=spin, pump__rate="360 Hz")
    fixture.shoot(5.0, (50.0, 0.0, 0.0))
    times = 5.000001 + np.arange(1000) * 1e-4
    spins = fixture.spins(times)
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
    fixture = Fixture()
    fixture.shoot(5.0, (50.0, 0.0, 0.0))
    assert fixture.seen(5.0002)[0] < -0.01
    assert fixture.spins(5.0002)[0] == pytest.approx([0.0, -0.0284, 0.0969], abs=2e-3)


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
    fixture = Fixture()
    fixture.shoot(5.0, 50.0 * np.array(shot))
    times = 5.00001 + np.arange(1000) * 1e-4
    size = np.linalg.norm(fixture.spins(times), axis=1)
    phase = GAMMA * 50.0 * np.linalg.norm(shot) / R * np.log(size[0] / size)
    design = np.column_stack([np.cos(phase), np.sin(phase), np.ones(1000)])
    fit, *_ = np.linalg.lstsq(design, fixture.seen(times) / size, rcond=None)
    along = np.array(shot) / np.linalg.norm(shot)
    assert np.hypot(*fit[:2]) == pytest.approx(swing, abs=1e-6)
    assert fit[2] == pytest.approx(along[1] * along[2], abs=1e-6)
    np.testing.assert_allclose(design @ fit, fixture.seen(times) / size, atol=1e-6)


@pytest.mark.parametrize(
    ("spin", "q", "levels"), [("3/2", 6, 4), ("5/2", 38 / 3, 6), ("7/2", 22, 8)]
)
def test_spin_exchange_pulls_and_broadens_as_two_coupled_levels_do(
    spin: str, q: float, levels: int
) -> None:
    exchange, field = 5e5, 200.0
    fixture = Fixture(
        cell__nuclear_spin=spin, cell__exchange_rate=f"{exchange} Hz", pump__rate="0.24 Hz"
    )
    fixture.shoot(100.0, (field, 0.0, 0.0))
    times = 100.001 + np.linspace(0.0, 0.02, 201)
    spins = fixture.spins(times)
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
    fixture = Fixture(ideal=False, pump__leak="3 %", detector__noise="0 V", gyro_was_running=True)
    world = fixture.world
    for prompt in world.preparations:
        world.act(prompt, 0.0)
    fixture.field(20.0, (1.0, 2.0, -0.5))
    start = 30.0
    fixture.shoot(start, (40.0, -50.0, 30.0))
    times = start + np.arange(1000) * 1e-4
    cell, field_now = world.cell, world.trajectory.field_nT
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

    first = fixture.spins(start)[0]
    options = {"rtol": 1e-9, "atol": 1e-12, "max_step": 1e-4}
    done = solve_ivp(slope, (0, 0.02), first, "DOP853", t_eval=times[:200] - start, **options)
    assert np.linalg.norm(first) == pytest.approx(0.1, rel=0.5)
    np.testing.assert_allclose(fixture.spins(times)[:200], done.y.T, atol=1e-6)


def test_the_residual_field_moves_the_frequencies_as_the_expansion_says() -> None:
    angles, residual = (91.2, 88.9, 90.6), np.array([1.0, -0.6, 0.8])
    factors = 1 + np.array([1.0, -0.5, 0.8]) / 100
    fixture = Fixture(
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
        fixture.shoot(start, 50.0 * np.array(shot))
        times = start + 1e-4 + np.arange(200) * 1e-4
        field = (50.0 * np.array(shot) * factors) @ u + residual
        angle = turned(fixture.spins(times), field)
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


def test_with_the_pump_on_the_detector_shows_the_steady_state_of_the_bloch_equation() -> None:
    fixture = Fixture()
    for k, field in enumerate(
        [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (2.0, -1.0, 0.7), (0.0, 3.0, 3.0)]
    ):
        fixture.field(10.0 * k + 1.0, field)
        bx, by, bz = GAMMA * np.array(field)
        turn = np.array([[0.0, -bz, by], [bz, 0.0, -bx], [-by, bx, 0.0]])
        steady = np.linalg.solve((R + 27.0) * np.eye(3) - turn, [0.0, 0.0, 27.0])
        seen = fixture.spins([10.0 * k + 5.0, 10.0 * k + 9.0])
        np.testing.assert_allclose(seen, [steady, steady], atol=1e-9)


def test_a_closed_loop_on_the_measured_response_finds_the_zero_of_the_field() -> None:
    residual = {"x": "1.2 nT", "y": "-0.9 nT", "z": "0.8 nT"}
    fixture = Fixture(**{f"residual_field__{axis}": text for axis, text in residual.items()})
    field, now = np.zeros(3), 0.0

    def response(change: Sequence[float]) -> float:
        nonlocal now
        now += 1.0
        fixture.field(now, field + change)
        return float(fixture.seen(now + 0.9)[0])

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
