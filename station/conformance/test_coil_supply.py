"""What a coil supply owes: its limits, its sine, and a way down that no coil minds."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from station.conformance.fixture import Fixture
from station.errors import InstrumentError

pytestmark = pytest.mark.energises

FREQUENCY_HZ = 0.1
SHARE_OF_LIMIT = 0.25
LOOKS_A_PERIOD = 40
WATCH_S = 0.02
LOOKS_AT_REST = 3
NOT_A_ZERO_S = 1.7
"""After this time, and after twice of it, a sine that began at zero is far from zero."""

ONE_STEP_S = 0.1
"""A ramp in steps may stand above its line by what the slew limit gives in this time."""

BEYOND_ANY_RATING_A = 1e4


def amplitude_A(fixture: Fixture) -> float:
    """Return a current that the bench allows, A."""
    return SHARE_OF_LIMIT * fixture.limits["current"]


def running(fixture: Fixture, supply: Any) -> None:
    """Let the supply run its sine."""
    supply.programme_limits()
    supply.load_sine(FREQUENCY_HZ, amplitude_A(fixture))
    supply.start_sine()


def run_for_a_while(fixture: Fixture, supply: Any) -> None:
    """Let the supply run its sine until much current flows."""
    running(fixture, supply)
    fixture.clock.sleep(NOT_A_ZERO_S)


def refused(fixture: Fixture, supply: Any) -> None:
    """Ask for more than the bench allows, while the sine runs."""
    run_for_a_while(fixture, supply)
    with pytest.raises(InstrumentError):
        supply.load_sine(FREQUENCY_HZ, 1.01 * fixture.limits["current"])


STATES: dict[str, Callable[[Fixture, Any], None]] = {
    "just-opened": lambda fixture, supply: None,
    "limits-programmed": lambda fixture, supply: supply.programme_limits(),
    "sine-loaded": lambda fixture, supply: (
        supply.programme_limits(),
        supply.load_sine(FREQUENCY_HZ, amplitude_A(fixture)),
    )[0],
    "sine-running": run_for_a_while,
    "a-request-refused": refused,
}


def at_rest(fixture: Fixture, supply: Any) -> None:
    """Assert that the supply reads back as safe and that no current flows, now and later."""
    reading = supply.read_safety()
    assert reading.safe, reading.read_back
    for _ in range(LOOKS_AT_REST):
        current_A = supply.current_A()
        assert abs(current_A) <= fixture.limits["zero_current"], f"{current_A:.3f} A flows"
        fixture.clock.sleep(NOT_A_ZERO_S)


def test_the_limits_go_into_the_instrument(fixture: Fixture, coil_supply: Any) -> None:
    """The instrument's own limits hold when the program does not."""
    coil_supply.identify()
    assert fixture.heard, "the driver passes nothing to the `trace` of its place"
    fixture.heard.clear()
    coil_supply.programme_limits()
    sent = [data for _, direction, data in fixture.heard if direction == ">"]
    assert sent, "programme_limits sends nothing"


def test_a_limit_beyond_the_rating_is_refused(fixture: Fixture, coil_supply: Any) -> None:
    """A bench file that allows more than the instrument can limit is wrong."""
    coil_supply.close()  # some instruments take one client at a time
    limits = {**fixture.limits, "current": BEYOND_ANY_RATING_A}
    supply = fixture.open(limits=limits)
    with pytest.raises(InstrumentError):
        supply.programme_limits()


def test_a_sine_beyond_the_limit_is_refused(fixture: Fixture, coil_supply: Any) -> None:
    """What the bench file forbids is not tried."""
    coil_supply.programme_limits()
    with pytest.raises(InstrumentError) as raised:
        coil_supply.load_sine(FREQUENCY_HZ, 1.01 * fixture.limits["current"])
    assert raised.value.instrument == fixture.name
    assert abs(coil_supply.current_A()) <= fixture.limits["zero_current"]


def test_no_current_flows_before_the_sine_starts(fixture: Fixture, coil_supply: Any) -> None:
    """A loaded sine is a sine at zero output."""
    coil_supply.programme_limits()
    coil_supply.load_sine(FREQUENCY_HZ, amplitude_A(fixture))
    assert abs(coil_supply.current_A()) <= fixture.limits["zero_current"]


def test_the_sine_runs_with_its_amplitude_and_frequency(fixture: Fixture, coil_supply: Any) -> None:
    """Its peaks and its period are read back from the output."""
    coil_supply.programme_limits()
    wanted_A, period_s = amplitude_A(fixture), 1 / FREQUENCY_HZ
    given_Hz = coil_supply.load_sine(FREQUENCY_HZ, wanted_A)
    assert math.isclose(given_Hz, FREQUENCY_HZ, rel_tol=0.01)
    coil_supply.start_sine()
    assert not coil_supply.read_safety().safe, "a running sine reads back as safe"
    began_s, seen = fixture.clock.now(), []
    for look in range(2 * LOOKS_A_PERIOD):
        fixture.clock.sleep_until(began_s + look * period_s / LOOKS_A_PERIOD)
        seen.append((fixture.clock.now() - began_s, coil_supply.current_A()))
    margin_A = 0.05 * wanted_A + fixture.limits["zero_current"]
    assert abs(max(current for _, current in seen) - wanted_A) <= margin_A
    assert abs(min(current for _, current in seen) + wanted_A) <= margin_A
    angle = 2 * math.pi * given_Hz
    in_phase = sum(current * math.sin(angle * time_s) for time_s, current in seen)
    across = sum(current * math.cos(angle * time_s) for time_s, current in seen)
    found_A = 2 * math.hypot(in_phase, across) / len(seen)
    assert abs(found_A - wanted_A) <= margin_A, "the current is no sine of this frequency"
    coil_supply.stop()
    at_rest(fixture, coil_supply)


@pytest.mark.parametrize("state", STATES)
def test_it_comes_to_rest_from_any_state(fixture: Fixture, coil_supply: Any, state: str) -> None:
    """`make_safe` brings it to zero before its deadline and can prove it."""
    STATES[state](fixture, coil_supply)
    deadline_s = fixture.clock.now() + fixture.within_s
    coil_supply.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s, "it came to rest after its deadline"
    at_rest(fixture, coil_supply)


@pytest.mark.parametrize("after_s", [0.7, 2.4, 7.6])
def test_it_comes_down_no_faster_than_its_slew_limit(
    fixture: Fixture, coil_supply: Any, after_s: float
) -> None:
    """A second reader watches the current while `stop` works, near zero and near both peaks."""
    clock, limits = fixture.clock, fixture.limits
    running(fixture, coil_supply)
    clock.sleep(after_s)
    seen: list[tuple[float, float]] = []
    stopped = False

    def watch() -> None:
        while not stopped:
            before_s = clock.now()
            current_A = coil_supply.current_A()
            seen.append(((before_s + clock.now()) / 2, current_A))
            clock.sleep(WATCH_S)

    watcher = clock.start("watch the current", watch)
    clock.sleep(5 * WATCH_S)
    coil_supply.stop()
    clock.sleep(5 * WATCH_S)
    stopped = True
    clock.sleep(10 * WATCH_S)
    watcher.join(5.0)
    at_rest(fixture, coil_supply)
    assert len(seen) > 5
    for (before_s, before_A), (after_s_, after_A) in pairwise(seen):
        allowed_A = limits["slew"] * (after_s_ - before_s + ONE_STEP_S) + limits["zero_current"]
        assert abs(after_A - before_A) <= allowed_A, (
            f"from {before_A:.3f} A to {after_A:.3f} A within {after_s_ - before_s:.3f} s; the "
            f"bench allows {limits['slew']:g} A/s"
        )
