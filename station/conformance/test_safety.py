"""What an instrument that can harm owes: rest from any state, in time, and proven."""

from __future__ import annotations

from typing import Any

import pytest

from station.conformance.fixture import Fixture
from station.safety.safe_state import make_bench_safe

pytestmark = pytest.mark.energises


def test_it_reads_back_that_it_is_at_rest(fixture: Fixture, made_safe: Any) -> None:
    """After `make_safe` of an instrument nobody touched, `read_safety` says so in words."""
    deadline_s = fixture.clock.now() + fixture.within_s
    made_safe.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s
    reading = made_safe.read_safety()
    assert reading.safe, reading.read_back
    assert reading.read_back, "nothing is said of what was read back"


def test_it_can_be_made_safe_again_and_again(fixture: Fixture, made_safe: Any) -> None:
    """The end of a run may follow a step that made it safe already."""
    for _ in range(3):
        made_safe.make_safe(fixture.clock.now() + fixture.within_s)
        assert made_safe.read_safety().safe


@pytest.mark.parametrize("where", ["ahead", "before", "behind", "after"])
@pytest.mark.parametrize("nth", [1, 2, 3, 5, 8])
def test_a_line_that_nobody_asked_for_does_not_keep_it_from_rest(
    fixture: Fixture, made_safe: Any, where: str, nth: int
) -> None:
    """In two attempts, as at the end of a run, its rest is read back all the same."""
    made_safe.identify()
    if not fixture.stray(where, "0", nth):
        pytest.skip("its simulator sends no stray lines")
    (outcome,) = make_bench_safe({fixture.name: made_safe}, [("", fixture.within_s)], fixture.clock)
    assert outcome.verified, outcome.read_back
