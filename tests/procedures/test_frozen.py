"""Samples that were there before are noticed, whatever the digits that their readings have."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.common.frozen import repeated_windows


@pytest.mark.parametrize("digits", [np.float32, np.float64])
def test_noise_never_repeats_itself_and_a_copy_does(digits: type) -> None:
    noise = np.random.default_rng(1).normal(size=400_000).astype(digits).astype(float)
    assert not repeated_windows([noise])[0].any()
    noise[5000:5015] = noise[1000:1015]
    assert np.flatnonzero(repeated_windows([noise])[0]).tolist() == [*range(5000, 5015)]


def test_short_records_repeat_as_a_whole_and_only_among_themselves() -> None:
    long, short = np.arange(40.0), np.arange(7.0)
    marks = repeated_windows([long, short, short, short[:4]])
    assert [mark.sum() for mark in marks] == [0, 0, 7, 0]
