"""A contact under test is excused while the bench reads back as off, and nothing else is."""

from __future__ import annotations

from functools import partial

import pytest
from interlock_helpers import CHAIN, SUPPLY, Watched, bench_with, watched

from station.errors import InterlockTripped
from station.safety.interlocks.contact_test import ContactTest
from station.safety.safe_state import not_off

OPENS_S, CLOSES_S = 5.0, 15.0
FAULT = {
    "instrument": CHAIN,
    "fault": "chain-open",
    "contact": "e-stop",
    "at": f"{OPENS_S:g} s",
    "for": f"{CLOSES_S - OPENS_S:g} s",
}


def e_stop(fixture: Watched) -> ContactTest:
    fixture.monitor.check_once()
    fixture.monitor.start()
    return ContactTest({CHAIN: "e-stop"}, partial(not_off, fixture.instruments))


def test_a_contact_under_test_trips_nothing_and_counts_again_afterwards() -> None:
    with watched(bench_with(None, [FAULT])) as fixture:
        with fixture.monitor.testing(e_stop(fixture)):
            fixture.clock.sleep(OPENS_S + 3.0)
            (look,) = (one for one in fixture.monitor.looks() if one.name == "chain")
            assert "opened by hand for its test" in look.said
            fixture.clock.sleep(CLOSES_S - OPENS_S)
        assert fixture.monitor.trip is None


def test_a_test_that_ends_with_its_contact_open_trips() -> None:
    with (
        watched(bench_with(None, [FAULT])) as fixture,
        pytest.raises(InterlockTripped, match="open: e-stop"),
        fixture.monitor.testing(e_stop(fixture)),
    ):
        fixture.clock.sleep(OPENS_S + 3.0)


def test_a_bench_that_is_energised_is_excused_nothing() -> None:
    with watched(bench_with(None, [FAULT])) as fixture:
        test = e_stop(fixture)
        fixture.energise()
        with (
            pytest.raises(InterlockTripped, match=f"not off during the test: {SUPPLY}"),
            fixture.monitor.testing(test),
        ):
            fixture.clock.sleep(OPENS_S + 3.0)


def test_switching_on_ends_a_test() -> None:
    with (
        watched(bench_with(None, [FAULT])) as fixture,
        pytest.raises(InterlockTripped, match="open: e-stop"),
        fixture.monitor.testing(e_stop(fixture)),
    ):
        fixture.clock.sleep(OPENS_S + 2.0)
        fixture.energise()
        fixture.clock.sleep(3.0)
