"""What a signal generator owes: its limits, two channels that do not mix, rest from any state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from station.conformance.fixture import Fixture
from station.errors import InstrumentError

pytestmark = pytest.mark.energises

CHANNELS = (1, 2)
SHARE_OF_LIMIT = 0.25
DURATION_S = 0.1
BEYOND_ANY_RATING_V = 1e4
NO_CHANNEL = 3


def some_V(fixture: Fixture) -> float:
    """Return a voltage that the bench allows twice over."""
    return SHARE_OF_LIMIT * fixture.limits["voltage"]


def holding(fixture: Fixture, generator: Any) -> None:
    """Have both channels hold voltages, of either sign."""
    generator.programme_limits()
    generator.hold(1, some_V(fixture))
    generator.hold(2, -some_V(fixture))


def armed(fixture: Fixture, generator: Any) -> None:
    """Have both channels wait for a trigger, for a step up and one down."""
    holding(fixture, generator)
    generator.prepare_step(1, some_V(fixture), DURATION_S)
    generator.prepare_step(2, -some_V(fixture), DURATION_S)


def refused(fixture: Fixture, generator: Any) -> None:
    """Ask for more than the bench allows, while one channel holds and the other is armed."""
    holding(fixture, generator)
    generator.prepare_step(1, some_V(fixture), DURATION_S)
    with pytest.raises(InstrumentError):
        generator.hold(2, 1.01 * fixture.limits["voltage"])


STATES: dict[str, Callable[[Fixture, Any], None]] = {
    "just-opened": lambda fixture, generator: None,
    "limits-programmed": lambda fixture, generator: generator.programme_limits(),
    "holding": holding,
    "armed": armed,
    "a-request-refused": refused,
}


def test_limits_and_load_go_into_the_instrument(fixture: Fixture, signal_generator: Any) -> None:
    """The instrument's own limits hold when the program does not, and no output is on by then."""
    signal_generator.identify()
    assert fixture.heard, "the driver passes nothing to the `trace` of its place"
    fixture.heard.clear()
    signal_generator.programme_limits()
    sent = [data for _, direction, data in fixture.heard if direction == ">"]
    assert sent, "programme_limits sends nothing"
    assert signal_generator.read_safety().safe


def test_a_limit_beyond_the_rating_is_refused(fixture: Fixture, signal_generator: Any) -> None:
    """A bench file that allows more than the instrument can give is wrong."""
    signal_generator.close()  # some instruments take one client at a time
    generator = fixture.open(limits={**fixture.limits, "voltage": BEYOND_ANY_RATING_V})
    with pytest.raises(InstrumentError):
        generator.programme_limits()


@pytest.mark.parametrize("sign", [1, -1])
def test_a_voltage_beyond_the_limit_is_refused(
    fixture: Fixture, signal_generator: Any, sign: int
) -> None:
    """Held, or held and stepped together: what the bench file forbids is not tried."""
    signal_generator.programme_limits()
    with pytest.raises(InstrumentError) as raised:
        signal_generator.hold(1, sign * 1.01 * fixture.limits["voltage"])
    assert raised.value.instrument == fixture.name
    assert signal_generator.read_safety().safe
    signal_generator.hold(1, sign * some_V(fixture))
    with pytest.raises(InstrumentError):
        signal_generator.prepare_step(1, sign * 0.8 * fixture.limits["voltage"], DURATION_S)
    signal_generator.prepare_step(1, -sign * 0.8 * fixture.limits["voltage"], DURATION_S)


@pytest.mark.parametrize("duration_s", [0.0, -DURATION_S, float("nan"), float("inf")])
def test_a_step_without_a_length_is_refused(
    fixture: Fixture, signal_generator: Any, duration_s: float
) -> None:
    """A step that never ends would leave its field on."""
    signal_generator.programme_limits()
    with pytest.raises(InstrumentError):
        signal_generator.prepare_step(1, some_V(fixture), duration_s)


def test_a_channel_that_is_not_there_is_refused(fixture: Fixture, signal_generator: Any) -> None:
    """Nothing is sent for it, whatever is asked."""
    signal_generator.programme_limits()
    asked: list[Callable[[], object]] = [
        lambda: signal_generator.hold(NO_CHANNEL, some_V(fixture)),
        lambda: signal_generator.prepare_step(NO_CHANNEL, some_V(fixture), DURATION_S),
        lambda: signal_generator.disarm(NO_CHANNEL),
        lambda: signal_generator.switch_off(NO_CHANNEL),
    ]
    for ask in asked:
        with pytest.raises(InstrumentError):
            ask()


def test_each_channel_is_switched_off_by_itself(fixture: Fixture, signal_generator: Any) -> None:
    """A generator is safe when the last of its channels is off."""
    holding(fixture, signal_generator)
    for channel in CHANNELS:
        assert not signal_generator.read_safety().safe
        signal_generator.switch_off(channel)
    assert signal_generator.read_safety().safe
    signal_generator.hold(2, 0.0)
    assert not signal_generator.read_safety().safe, "a voltage of zero is no output off"


def test_a_step_is_armed_again_and_again(fixture: Fixture, signal_generator: Any) -> None:
    """Of either sign and any length, again and again at one trigger, the one before taken back."""
    holding(fixture, signal_generator)
    for sign, factor in ((1, 1.0), (-1, 10.0), (-1, 0.1), (1, 3.0)):
        signal_generator.prepare_step(1, sign * some_V(fixture), factor * DURATION_S)
        if factor < 1.0:
            signal_generator.disarm(1)
            signal_generator.disarm(1)
        signal_generator.hold(2, sign * some_V(fixture))
    signal_generator.prepare_step(1, some_V(fixture), DURATION_S, cycles=3)


@pytest.mark.parametrize("state", STATES)
def test_it_comes_to_rest_from_any_state(
    fixture: Fixture, signal_generator: Any, state: str
) -> None:
    """`make_safe` switches both channels off before its deadline and can prove it."""
    STATES[state](fixture, signal_generator)
    deadline_s = fixture.clock.now() + fixture.within_s
    signal_generator.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s, "it came to rest after its deadline"
    reading = signal_generator.read_safety()
    assert reading.safe, reading.read_back
