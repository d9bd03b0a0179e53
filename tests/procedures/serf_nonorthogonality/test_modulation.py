"""What tones on the coils tell of the residual field, against the simulated cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from cell_fixture import GAMMA, UPRIGHT, Fixture, R
from scipy.integrate import solve_ivp

from procedures.serf_nonorthogonality.modulation import (
    NotNulled,
    Reading,
    Tone,
    answer,
    demodulated,
    residual_of,
)

HERTZ, TONE_NT, BIAS_NT, NT_PER_V = 8.0, 0.4, 0.6, 20.0
PUMPING = 27.0
FLAWED: dict[str, Any] = {"ideal": False, "gyro_was_running": False, "powered_at_start": True}


def shield(*residual_nT: float) -> dict[str, str]:
    return {f"residual_field__{a}": f"{b} nT" for a, b in zip("xyz", residual_nT, strict=True)}


def tones(fixture: Fixture) -> list[Tone]:
    """Send a tone on each coil in turn, to either side of zero, and return what comes back."""
    result, time_s = [], 5.0
    for k, coil in enumerate("xyz"):
        for side in (1.0, -1.0):
            middle_nT, swing_nT = np.full(3, side * BIAS_NT), TONE_NT * np.eye(3)[k]
            fixture.field(time_s, (middle_nT - swing_nT).tolist())
            start_s = time_s + 0.5
            for half in range(21):
                level_nT = middle_nT[k] + (TONE_NT if half % 2 == 0 else -TONE_NT)
                fixture.outputs[coil].then(start_s + half / HERTZ / 2, level_nT / NT_PER_V)
            after_s = np.arange(0.25, 1.25, 1 / 4000)
            lines_V, u_V = demodulated(after_s, fixture.seen(start_s + after_s), HERTZ, 50.0)
            result.append(Tone(coil, TONE_NT, middle_nT, lines_V, u_V))
            time_s = start_s + 2.0
    return result


def read(**changes: Any) -> Reading:
    return residual_of(tones(Fixture(**changes)), HERTZ, "z", "y")


def bloch(levels_nT: Sequence[Sequence[float]], q: float) -> np.ndarray:
    """Return the lines along y that Bloch's equation gives, integrated cycle by cycle."""
    half_s, total = 0.5 / HERTZ, R + PUMPING
    begin, rows = np.zeros(3), []
    for half in range(12):
        field = GAMMA / q * np.array(levels_nT[half % 2])

        def slope(_: float, p: np.ndarray, field: np.ndarray = field) -> np.ndarray:
            return np.cross(field, p) + (PUMPING * np.array([0, 0, 1]) - total * p) / q

        after_s = np.arange(500) * half_s / 500
        ended = solve_ivp(
            slope, (0, half_s), begin, t_eval=[*after_s, half_s], rtol=1e-10, atol=1e-12
        )
        begin = ended.y[:, -1]
        rows.append(ended.y[1, :-1])
    cycle = np.concatenate(rows[-2:])
    return 2.0 * np.fft.fft(cycle)[1:4] / len(cycle)


LEVELS = [(0.3, -0.2, 0.9), (0.3, -0.2, -0.1)]


def test_the_model_is_blochs_equation() -> None:
    q, total = 5.95, R + PUMPING
    levels = np.array([LEVELS]) * GAMMA / total
    pump, probe = np.eye(3)[2], np.eye(3)[1]
    lines = PUMPING / total * answer(levels, 0.5 / HERTZ, total / q, pump, probe)[0]
    # The integration's samples begin at the edge, where those of a spectrum lie about it.
    np.testing.assert_allclose(lines, bloch(LEVELS, q), atol=2e-3 * np.abs(lines).max())


def test_the_simulated_cell_answers_a_tone_as_bloch_has_it() -> None:
    fixture = Fixture()
    fixture.field(5.0, LEVELS[1])
    for half in range(24):
        fixture.outputs["z"].then(6.0 + half / HERTZ / 2, LEVELS[half % 2][2] / NT_PER_V)
    after_s = np.arange(0.25, 1.25, 1 / 8000)
    lines, _ = demodulated(after_s, fixture.seen(6.0 + after_s), HERTZ, None)
    expected = bloch(LEVELS, 5.96)
    np.testing.assert_allclose(lines, expected, atol=5e-3 * np.abs(expected).max())
    # The line of a tone along the pump light tells the field along the probe, sign and size.
    turned = fixture_line((0.3, 0.2, 0.9), (0.3, 0.2, -0.1))
    assert np.real(lines[0]) * np.real(turned) < 0.0


def fixture_line(*levels_nT: Sequence[float]) -> complex:
    return complex(bloch(levels_nT, 5.96)[0])


@pytest.mark.parametrize("residual_nT", [(0, 0, 0), (1.2, -0.9, 0.8), (-4.0, 3.0, 2.0)])
def test_the_residual_field_comes_back_of_any_sign_and_to_several_widths(
    residual_nT: tuple[float, float, float],
) -> None:
    reading = read(**shield(*residual_nT))
    assert list(reading.residual_nT.values()) == pytest.approx(residual_nT, rel=2e-3, abs=2e-3)
    assert reading.width_nT == pytest.approx((R + PUMPING) / GAMMA, rel=5e-3)


def test_coils_and_light_that_lean_are_within_its_uncertainty() -> None:
    reading = read(**FLAWED, pump__light_shift="0 nT")
    for axis, true_nT in zip("xyz", (1.2, -0.9, 0.8), strict=True):
        assert abs(reading.residual_nT[axis] - true_nT) < 3 * reading.u_nT[axis] + 0.01 * 1.2


def test_light_that_shines_is_a_field_along_it() -> None:
    with_light = read(pump__light_shift="0.15 nT", pump__lean=UPRIGHT)
    assert with_light.residual_nT["z"] == pytest.approx(0.15, abs=2e-3)


@pytest.mark.parametrize("coil", "xyz")
def test_a_coil_without_current_is_named(coil: str) -> None:
    with pytest.raises(NotNulled, match=f"the tone on coil {coil}: it carries no current"):
        read(**FLAWED, **{f"coils__{coil}__error": "-100 %"})


@pytest.mark.parametrize("coil", "xyz")
def test_a_coil_that_is_connected_the_wrong_way_round_is_said(coil: str) -> None:
    with pytest.raises(NotNulled, match="left-handed triad: one of the coils x, y, z"):
        read(**FLAWED, **{f"coils__{coil}__constant": "-20 nT/V"})


@pytest.mark.parametrize("coil", "xyz")
def test_a_coil_constant_that_is_far_off_is_named(coil: str) -> None:
    with pytest.raises(NotNulled, match=rf"coil {coil} makes 0\.3 times"):
        read(**FLAWED, **{f"coils__{coil}__error": "-70 %"})


def test_no_light_is_no_answer() -> None:
    with pytest.raises(NotNulled, match="no tone is answered"):
        read(**FLAWED, pump__rate="0 Hz")


def test_the_demodulator_tells_lines_from_mains_and_noise() -> None:
    rng = np.random.default_rng(3)
    time_s = 0.25 + np.arange(4000) / 4000
    angle = 2 * np.pi * HERTZ * time_s
    signal = 0.3 * np.cos(angle + 0.5) + 0.02 * np.sin(2 * angle) + 0.2 * np.sin(314.16 * time_s)
    lines, u_V = demodulated(time_s, 1.0 + signal + rng.normal(0, 5e-3, 4000), HERTZ, 50.0)
    assert u_V == pytest.approx(5e-3 * np.sqrt(2 / 4000), rel=0.2)
    expected = np.array([0.3 * np.exp(0.5j), -0.02j, 0.0])
    assert np.abs(lines - expected).max() < 5 * u_V
