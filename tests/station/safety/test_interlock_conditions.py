"""Conditions on levels and states, and Kleene's logic of what cannot be read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product

import pytest

from station.safety.interlocks.conditions import (
    AllOf,
    AnyOf,
    Condition,
    Judgement,
    LatestReading,
    Level,
    Not,
    State,
    in_unit_of_role,
)
from station.safety.readings import Reading

ABOVE = Level("coil_supply.x", "current", "A", high=8.2, magnitude=True)
BELOW = Level("thermal_chamber", "temperature", "degC", low=-45.0)
OUTSIDE = Level("turntable", "angle", "deg", low=-10.0, high=10.0)
OPEN = State("interlock_chain", "chain", "open")
CHAIN = ("interlock_chain", "chain")


class Stated:
    """A reader of the quantities that it is given, and of no other."""

    def __init__(self, seen: Mapping[tuple[str, str], float | str | LatestReading]) -> None:
        self._seen = seen

    def look(self, instrument: str, quantity: str) -> LatestReading:
        found = self._seen[instrument, quantity]
        return found if isinstance(found, LatestReading) else LatestReading(Reading(found, "", 0.0))


def judged(condition: Condition, value: float | str | LatestReading) -> Judgement:
    (watched,) = condition.watched
    return condition.evaluate(Stated({watched: value}))


@pytest.mark.parametrize(
    ("condition", "value", "true"),
    [
        (ABOVE, 8.2, False),
        (ABOVE, 8.3, True),
        (ABOVE, -8.3, True),
        (BELOW, -45.0, False),
        (BELOW, -45.1, True),
        (BELOW, 60.0, False),
        (OUTSIDE, -10.5, True),
        (OUTSIDE, 0.0, False),
        (OUTSIDE, 10.5, True),
        (OPEN, "open", True),
        (OPEN, "closed", False),
    ],
)
def test_a_level_or_a_state_is_true_beyond_its_limit_only(
    condition: Condition, value: float | str, true: bool
) -> None:
    assert judged(condition, value).true is true


def test_a_judgement_names_instrument_value_and_limit() -> None:
    beyond = judged(ABOVE, -9.43210)
    assert beyond.said == "coil_supply.x current is -9.432 A, above 8.2 A"
    assert (beyond.value, beyond.limit) == (-9.43210, "above 8.2 A")
    assert judged(OUTSIDE, 0.0).said == "turntable angle is 0 deg, not outside -10 deg to 10 deg"
    assert judged(OPEN, "open").said == "interlock_chain chain is open"


def test_beyond_the_range_of_the_instrument_is_beyond_every_upper_limit() -> None:
    found = judged(ABOVE, math.inf)
    assert found.true
    assert found.value is None
    assert found.said == (
        "coil_supply.x current is beyond the range of the instrument, above 8.2 A"
    )


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (math.nan, "current reads nan, which is no number"),
        ("9.9", "current reads 9.9, which is no number"),
        (LatestReading(None, "cannot be read: no answer"), "current cannot be read: no answer"),
    ],
)
def test_what_cannot_be_read_is_neither_true_nor_false(
    value: float | str | LatestReading, said: str
) -> None:
    found = judged(ABOVE, value)
    assert found.true is None
    assert said in found.said


def test_what_need_not_be_there_now_is_false() -> None:
    assert judged(ABOVE, LatestReading(None, "is not measured now", excused=True)).true is False
    assert judged(OPEN, LatestReading(None, "is not measured now", excused=True)).true is False


WORDS: dict[bool | None, float | LatestReading] = {
    True: 9.0,
    False: 1.0,
    None: LatestReading(None, "is silent"),
}
TWO = [Level("first", "current", "A", high=8.0), Level("second", "current", "A", high=8.0)]
KLEENE_AND = {(True, True): True, (True, None): None, (None, None): None}
KLEENE_OR = {(False, False): False, (False, None): None, (None, None): None}


@pytest.mark.parametrize(("one", "other"), list(product((True, False, None), repeat=2)))
def test_any_and_all_follow_kleenes_logic(one: bool | None, other: bool | None) -> None:
    reader = Stated({("first", "current"): WORDS[one], ("second", "current"): WORDS[other]})
    pair = {(one, other), (other, one)}
    both = next((KLEENE_AND[two] for two in pair if two in KLEENE_AND), False)
    either = next((KLEENE_OR[two] for two in pair if two in KLEENE_OR), True)
    assert AllOf(TWO).evaluate(reader).true is both
    assert AnyOf(TWO).evaluate(reader).true is either
    # De Morgan.
    turned = AnyOf([Not(part) for part in TWO]).evaluate(reader).true
    assert Not(AllOf(TWO)).evaluate(reader).true is turned


def test_a_stack_says_what_decided_it() -> None:
    reader = Stated({("first", "current"): 1.0, ("second", "current"): 9.5})
    assert AnyOf(TWO).evaluate(reader).said == "second current is 9.5 A, above 8 A"
    said = AllOf([Not(TWO[0]), TWO[1]]).evaluate(reader)
    assert said.said == "first current is 1 A, not above 8 A and second current is 9.5 A, above 8 A"
    assert (said.value, said.limit) == (9.5, "above 8 A")
    assert AllOf([Not(TWO[0]), TWO[1]]).watched == {("first", "current"), ("second", "current")}


def test_a_reading_in_another_unit_than_its_limit_cannot_be_read() -> None:
    seen = in_unit_of_role(Reading(0.009, "kA", 0.0), "coil_supply.x", "current")
    assert judged(ABOVE, seen).true is None
    assert "in kA instead of A" in judged(ABOVE, seen).said
