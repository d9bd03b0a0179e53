"""What an instrument that can harm owes: rest from any state, in time, and proven."""

from __future__ import annotations

from typing import Any

import pytest

from station.conformance.stand import Stand

pytestmark = pytest.mark.energises


def test_it_reads_back_that_it_is_at_rest(stand: Stand, made_safe: Any) -> None:
    """After `make_safe` of an instrument nobody touched, `read_safety` says so in words."""
    deadline_s = stand.clock.now() + stand.within_s
    made_safe.make_safe(deadline_s)
    assert stand.clock.now() <= deadline_s
    reading = made_safe.read_safety()
    assert reading.safe, reading.read_back
    assert reading.read_back, "nothing is said of what was read back"


def test_it_can_be_made_safe_again_and_again(stand: Stand, made_safe: Any) -> None:
    """The end of a run may follow a step that made it safe already."""
    for _ in range(3):
        made_safe.make_safe(stand.clock.now() + stand.within_s)
        assert made_safe.read_safety().safe
