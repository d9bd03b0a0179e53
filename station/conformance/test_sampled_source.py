"""What a source of samples owes: its columns, every sample once, and quiet when it is stopped."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from station.conformance.fixture import Fixture
from station.method.verbs import POLL_S, to_rows
from station.roles.base import ARRIVAL
from station.roles.role import role

RECORDED_S = 60.0
QUIET_S = 3.0
LARGEST_GAP = 1.5
"""In sample intervals; what the analysis calls a gap."""


def start(fixture: Fixture, source: Any) -> None:
    """Start a source as its role does."""
    declared = role(fixture.role)
    if declared is None or declared.start_samples is None:
        pytest.skip(f"the role {fixture.role} does not say how its samples are started")
    declared.start_samples(source)


def record(fixture: Fixture, source: Any, seconds: float) -> NDArray[Any]:
    """Drain a source as an acquisition does; return its rows, shape (rows,)."""
    until_s = fixture.clock.now() + seconds
    blocks = []
    while fixture.clock.now() < until_s:
        fixture.clock.sleep(POLL_S)
        blocks.append(to_rows(source.drain()))
    return np.concatenate(blocks)


def steps_of(source: Any, rows: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the differences of each column that counts or stamps, in its own intervals."""
    steps = {}
    for name, meaning in source.columns.items():
        values = rows[name]
        if meaning.startswith("1, ") and "every " in meaning:
            wraps = 2 ** (8 * values.dtype.itemsize) if values.dtype.kind == "u" else 0
            differences = np.diff(values.astype(np.int64))
            steps[name] = differences % wraps if wraps else differences
        elif meaning.startswith("s ") and name.endswith("time_s"):
            differences = np.diff(values)
            steps[name] = differences / np.median(differences)
    return steps


def test_it_delivers_the_columns_it_describes(fixture: Fixture, sampled_source: Any) -> None:
    """Names, units and lengths agree, and no row arrives before the one before it."""
    start(fixture, sampled_source)
    block = None
    for _ in range(10):
        fixture.clock.sleep(POLL_S)
        block = sampled_source.drain()
        if len(block):
            break
    assert block is not None
    assert len(block), "it delivers nothing"
    assert list(block.columns) == list(sampled_source.columns)
    for name, values in block.columns.items():
        assert values.shape == (len(block),), name
        assert values.dtype.kind in "iuf", f"{name} holds no numbers"
        if "NaN" not in sampled_source.columns[name]:  # where a row may lack it, its text says so
            assert np.isfinite(values).all(), name
    for name, meaning in sampled_source.columns.items():
        assert meaning.strip(), f"{name}: unit and meaning are missing"
    arrival_s = block.arrival_time_s
    assert (np.diff(arrival_s) >= 0).all()
    assert arrival_s[-1] <= fixture.clock.now()


def test_nothing_is_lost_in_a_minute(fixture: Fixture, sampled_source: Any) -> None:
    """Its own counter or time stamps ascend in equal steps, from the first row to the last."""
    start(fixture, sampled_source)
    sampled_source.drain()
    rows = record(fixture, sampled_source, RECORDED_S)
    assert len(rows) > 1
    assert (np.diff(rows[ARRIVAL]) >= 0).all()
    steps = steps_of(sampled_source, rows)
    assert steps, "no column counts samples or stamps them; say so in `columns`"
    for name, differences in steps.items():
        assert (differences > 0).all(), f"{name} does not ascend"
        assert (differences < LARGEST_GAP).all(), f"{name} leaves samples out"


def test_it_can_be_started_again(fixture: Fixture, sampled_source: Any) -> None:
    """A second start forgets what the first one left."""
    for _ in range(2):
        start(fixture, sampled_source)
        rows = record(fixture, sampled_source, 5.0)
        for name, differences in steps_of(sampled_source, rows).items():
            assert (differences > 0).all(), f"{name} does not ascend after another start"


def test_it_is_quiet_once_stopped(fixture: Fixture, sampled_source: Any) -> None:
    """What came before the stop can be drained; nothing comes after it."""
    if not hasattr(sampled_source, "stop"):
        pytest.skip("its role knows no stop")
    start(fixture, sampled_source)
    fixture.clock.sleep(QUIET_S)
    sampled_source.stop()
    assert len(sampled_source.drain()), "what came before the stop is lost"
    fixture.clock.sleep(QUIET_S)
    assert not len(sampled_source.drain()), "samples come after the stop"
    sampled_source.stop()
