"""What a recorder did to a record is found, and noise alone is not."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.common.frozen import repeated_rows, stuck_rows
from procedures.estimation.recorder import largest_jump, piled_up, resolution


def test_what_a_recorder_did_is_found_and_noise_alone_is_not() -> None:
    for seed in range(40):
        generator = np.random.default_rng(seed)
        step = 10.0 ** -int(generator.integers(1, 5))
        noise = step * np.round(0.2 * generator.standard_normal(2000) / step)
        assert resolution(noise) == pytest.approx(step)
        assert piled_up(noise, step, 0.2, np.zeros(2000)) == (0.0, 0.0)
        assert stuck_rows(noise, step) is None
        assert repeated_rows(noise, step) is None
        assert largest_jump(noise, 100.0, 0.0) is None
    noise = np.round(0.2 * np.random.default_rng(1).standard_normal(2000), 4)
    held, again, up = noise.copy(), noise.copy(), noise.copy()
    held[500:600] = held[500]
    again[900:1100] = again[300:500]
    up[1200:] += 0.4
    assert stuck_rows(held, 1e-4) == (500, 599)
    assert repeated_rows(again, 1e-4) == (300, 900, 200)
    assert largest_jump(up, 100.0, 0.0) == (
        pytest.approx(1200, abs=30),
        pytest.approx(0.4, abs=0.1),
    )
    # A sine without noise stands longest at its peaks; a limit is none of it.
    sine = np.round(np.sin(2.0 * np.pi * np.arange(2000) / 100.0 + 0.1), 4)
    assert piled_up(sine, 1e-4, 3e-5) == (0.0, 0.0)
    assert piled_up(np.clip(sine, -2.0, 0.9), 1e-4, 0.03)[0] > 0.1
    # A few values that were filled in between the steps of counts make them no finer.
    counted = np.floor(23.4 + np.random.default_rng(2).random(500))
    counted[[50, 300]] = 23.417, 23.392
    assert resolution(counted) == 1.0
