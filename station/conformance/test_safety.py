"""What an instrument that can harm owes: rest from any state, in time, and proven."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from station.conformance import (
    test_cell_heater,
    test_coil_supply,
    test_pump_laser,
    test_rotary_stage,
    test_signal_generator,
    test_thermal_chamber,
    test_turntable,
)
from station.conformance.fixture import Fixture
from station.errors import InstrumentError
from station.roles.base import SafetyReading, SwitchedOffBlindly
from station.roles.role import energised_states
from station.safety.safe_state import make_bench_safe

pytestmark = pytest.mark.energises

ENERGISED: dict[str, Callable[[Fixture, Any], object]] = {
    "cell_heater": test_cell_heater.on,
    "coil_supply": test_coil_supply.run_for_a_while,
    "dut_power": lambda fixture, supply: supply.switch_on(),
    "pump_laser": test_pump_laser.STATES["open"],
    "rotary_stage": test_rotary_stage.turning,
    "signal_generator": test_signal_generator.holding,
    "thermal_chamber": test_thermal_chamber.on,
    "turntable": test_turntable.turning,
}
"""By role, what brings an instrument out of its rest."""

SETTLES_S = 2.0
LONGER_S = 5.0
"""What an exchange may take beyond the time for coming to rest."""


def energise(fixture: Fixture, instrument: Any) -> None:
    """Bring an instrument out of its rest."""
    if fixture.role not in ENERGISED:
        pytest.skip(f"the tests do not know what energises a {fixture.role}")
    ENERGISED[fixture.role](fixture, instrument)


def energised_words(fixture: Fixture, instrument: Any) -> dict[str, bool]:
    """Return, of each quantity that says whether it is energised, whether it says so now."""
    return {
        quantity: instrument.read_quantity(quantity) == word
        for quantity, word in energised_states(fixture.name).items()
        if quantity in getattr(instrument, "quantities", {})
    }


def check_rest(fixture: Fixture, instrument: Any) -> None:
    """By what it reads back, by what interlocks see of it, and by what its simulator knows."""
    reading = instrument.read_safety()
    assert isinstance(reading, SafetyReading), "read_safety returns no SafetyReading"
    assert reading.safe, reading.read_back
    for quantity, says in energised_words(fixture, instrument).items():
        assert not says, f"at rest its {quantity} reads as energised"
    assert not fixture.energised(), "its simulator is still energised"


def test_opening_and_asking_it_energises_nothing(fixture: Fixture, made_safe: Any) -> None:
    """Who only looks at a bench moves nothing on it."""
    if fixture.simulation is None:
        pytest.skip("on a real bench it may be energised already")
    made_safe.identify()
    fixture.clock.sleep(SETTLES_S)
    energised_words(fixture, made_safe)
    reading = made_safe.read_safety()
    assert isinstance(reading, SafetyReading), "read_safety returns no SafetyReading"
    assert reading.safe or reading.dormant, reading.read_back
    assert not fixture.energised(), "opening it, or asking who it is, has energised it"


def test_it_reads_back_that_it_is_energised(fixture: Fixture, made_safe: Any) -> None:
    """By what it reads back and by what interlocks see; and at rest neither says so."""
    energise(fixture, made_safe)
    assert not made_safe.read_safety().safe, "energised, it reads back as safe"
    for quantity, says in energised_words(fixture, made_safe).items():
        assert says, f"energised, its {quantity} reads as at rest"
    made_safe.make_safe(fixture.clock.now() + fixture.within_s)
    check_rest(fixture, made_safe)


def test_silence_is_not_rest(fixture: Fixture, made_safe: Any) -> None:
    """Where no answer comes nothing is known, and the way to rest ends all the same."""
    made_safe.identify()
    made_safe.make_safe(fixture.clock.now() + fixture.within_s)
    if not fixture.silence():
        pytest.skip("its simulator cannot fall silent")
    with suppress(InstrumentError):
        assert not made_safe.read_safety().safe, "it reads back as safe while nothing answers"
    deadline_s = fixture.clock.now() + fixture.within_s
    with suppress(InstrumentError):
        made_safe.make_safe(deadline_s)
    late_s = fixture.clock.now() - deadline_s
    assert late_s <= LONGER_S, f"while nothing answers make_safe ends {late_s:.3g} s late"


@pytest.mark.parametrize("before", ["at-rest", "energised"])
def test_its_last_attempt_brings_it_to_rest(fixture: Fixture, made_safe: Any, before: str) -> None:
    """However often it comes: a guardian sends it where it understands no answer."""
    if not issubclass(type(made_safe), SwitchedOffBlindly):
        pytest.skip("it has no last_attempt")
    made_safe.identify()
    if before == "energised":
        energise(fixture, made_safe)
    else:
        made_safe.make_safe(fixture.clock.now() + fixture.within_s)
    for _ in range(2):
        made_safe.last_attempt()
        fixture.clock.sleep(SETTLES_S)
    reading = made_safe.read_safety()
    assert reading.safe, reading.read_back
    assert not fixture.energised(), "its simulator is still energised"


@pytest.mark.parametrize("where", ["ahead", "before"])
@pytest.mark.parametrize("nth", [1, 2, 3])
def test_an_answer_from_before_is_no_proof_of_rest(
    fixture: Fixture, made_safe: Any, where: str, nth: int
) -> None:
    """What it said at rest comes once more, unasked, while it is energised."""
    made_safe.identify()
    made_safe.make_safe(fixture.clock.now() + fixture.within_s)
    fixture.heard.clear()
    made_safe.read_safety()
    answers = {
        data.decode("latin-1").strip() for _, direction, data in fixture.heard if direction == "<"
    }
    energise(fixture, made_safe)
    for answer in sorted(answers - {""}):
        if not fixture.stray(where, answer, nth):
            pytest.skip("its simulator sends no stray lines")
        with suppress(InstrumentError):
            safe = made_safe.read_safety().safe
            assert not safe or fixture.energised() is False, f"{answer!r} is taken for its rest"


def test_it_reads_back_that_it_is_at_rest(fixture: Fixture, made_safe: Any) -> None:
    """After `make_safe` of an instrument nobody touched, `read_safety` says so in words."""
    deadline_s = fixture.clock.now() + fixture.within_s
    made_safe.make_safe(deadline_s)
    assert fixture.clock.now() <= deadline_s
    check_rest(fixture, made_safe)
    assert made_safe.read_safety().read_back, "nothing is said of what was read back"


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
