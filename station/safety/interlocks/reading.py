"""Interlocks of a bench file: their keys, every fault with its place, and the conditions."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, WithJsonSchema

from station.fields import Second, StrictModel, quantity_pattern
from station.files.faults import Fault, listed, nearest
from station.roles.role import CONTACT_STATES, Quantity, kind_of, quantities_of, role_of
from station.safety.interlocks.conditions import AllOf, AnyOf, Condition, Level, Not, State
from station.units import UNITS, UnitError, parse_as

if TYPE_CHECKING:
    from station.files.yaml.document import Document


BOUND = {
    "type": "string",
    "pattern": quantity_pattern(UNITS),
    "description": "a number with its unit",
}
LEVEL: dict[str, Any] = {
    "type": "object",
    "properties": {
        "instrument": {"type": "string", "description": "an instrument of this bench"},
        "quantity": {"type": "string"},
        "above": BOUND,
        "below": BOUND,
        "outside": {"type": "array", "items": BOUND, "minItems": 2, "maxItems": 2},
        "equals": {"type": "string", "description": "a state, such as open"},
    },
    "required": ["instrument", "quantity"],
    "additionalProperties": False,
}
PARTS = {"type": "array", "items": {"type": "object"}, "minItems": 1}
WHEN = {
    "anyOf": [
        LEVEL,
        *(
            {
                "type": "object",
                "properties": {word: PARTS if word != "not" else {"type": "object"}},
                "required": [word],
                "additionalProperties": False,
            }
            for word in ("any", "all", "not")
        ),
    ],
    "description": "a level or a state of a quantity, or any, all, not of such conditions",
}


class InterlockEntry(StrictModel):
    """One interlock: when it trips, for how long that may be so, and how often it is looked at."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
    when: Annotated[dict[str, Any], WithJsonSchema(WHEN)]
    grace_s: Annotated[Second, Field(ge=0)] = 0.0
    period_s: Annotated[Second, Field(gt=0)] | None = None


CHAIN = "interlock_chain"
BOUNDS = ("above", "below", "outside")
TESTS = (*BOUNDS, "equals")
STACKS = ("any", "all", "not")
KEYS = ("instrument", "quantity", *TESTS, *STACKS)
Where = tuple[str | int, ...]


@dataclass(frozen=True)
class Interlock:
    """A condition that ends a run when it has been true for longer than its grace, s."""

    name: str
    when: Condition
    grace_s: float = 0.0
    period_s: float = 1.0

    @cached_property
    def instruments(self) -> frozenset[str]:
        """The instruments that must be open for it to be watched."""
        return frozenset(instrument for instrument, _ in self.when.watched)

    @cached_property
    def on_contacts(self) -> bool:
        """Whether contacts that are open or closed are all that it depends on."""
        return all(kind_of(*watched).states == CONTACT_STATES for watched in self.when.watched)

    @cached_property
    def only_while_on(self) -> bool:
        """Whether only an energised bench can make it true."""
        return all(kind_of(*watched).while_on for watched in self.when.watched)


def interlocks_of(
    entries: Iterable[InterlockEntry], instruments: Collection[str]
) -> tuple[Interlock, ...]:
    """Return the interlocks of a bench; its chain is one, whether it is written there or not."""
    interlocks = []
    for entry in entries:
        when = condition_of(entry.when)
        period_s = entry.period_s or min(kind_of(*watched).period_s for watched in when.watched)
        interlocks.append(Interlock(entry.name, when, entry.grace_s, period_s))
    if CHAIN in instruments and not any(CHAIN in interlock.instruments for interlock in interlocks):
        period_s = kind_of(CHAIN, "chain").period_s
        interlocks.append(
            Interlock("interlock-chain", State(CHAIN, "chain", "open"), 0.0, period_s)
        )
    return tuple(interlocks)


def watched_in_a_run(interlocks: Sequence[Interlock], used: Collection[str]) -> list[Interlock]:
    """Return the interlocks that a run which uses these instruments must watch.

    Those that look at an instrument of the run, and those of the chain; not one on, say, a coil
    supply that this plan leaves alone and that may not even be there.
    """
    return [
        interlock
        for interlock in interlocks
        if CHAIN in interlock.instruments or interlock.instruments & set(used)
    ]


def condition_of(when: Mapping[str, Any]) -> Condition:
    """Return the condition that data without a fault describe."""
    if "any" in when:
        return AnyOf(tuple(condition_of(part) for part in when["any"]))
    if "all" in when:
        return AllOf(tuple(condition_of(part) for part in when["all"]))
    if "not" in when:
        return Not(condition_of(when["not"]))
    instrument, quantity = when["instrument"], when["quantity"]
    if "equals" in when:
        return State(instrument, quantity, when["equals"])
    kind = kind_of(instrument, quantity)
    low, high = -math.inf, math.inf
    if "outside" in when:
        low, high = (parse_as(text, kind.unit) for text in when["outside"])
        return Level(instrument, quantity, kind.unit, low, high)
    if "above" in when:
        high = parse_as(when["above"], kind.unit)
    else:
        low = parse_as(when["below"], kind.unit)
    return Level(instrument, quantity, kind.unit, low, high, kind.magnitude)


def interlock_faults(document: Document, instances: Collection[str]) -> Iterator[Fault]:
    """Yield every fault of the interlocks of a bench file that its model does not see."""
    entries = document.data.get("interlocks")
    names: set[str] = set()
    for number, entry in enumerate(entries if isinstance(entries, list) else ()):
        if not isinstance(entry, dict):
            continue
        where: Where = ("interlocks", number)
        name = entry.get("name")
        if isinstance(name, str) and name in names:
            yield document.fault((*where, "name"), f"'{name}' was named before; choose another")
        names.add(str(name))
        if "when" in entry:
            yield from _when_faults(document, (*where, "when"), entry["when"], instances)


def _when_faults(
    document: Document, where: Where, when: Any, instances: Collection[str]
) -> Iterator[Fault]:
    if not isinstance(when, dict):
        # At the first level the model says so.
        if len(where) > 3:
            yield document.fault(where, "must be a mapping, such as {instrument: …, quantity: …}")
        return
    unknown = [key for key in when if key not in KEYS]
    for key in unknown:
        hint = nearest(key, KEYS)
        what = "is not a key of a condition" + ("" if hint else f"; known are {listed(KEYS)}")
        yield document.fault((*where, key), what, hint and f"'{hint}'", at_key=True)
    stacked = [key for key in STACKS if key in when]
    if stacked:
        if len(when) - len(unknown) > 1:
            yield document.fault(where, f"'{stacked[0]}' stands alone; take the other keys out")
            return
        yield from _stack_faults(document, (*where, stacked[0]), when[stacked[0]], instances)
        return
    missing = [key for key in ("instrument", "quantity") if key not in when]
    if missing or not any(key in when for key in TESTS):
        # A misspelt key was reported already.
        if not unknown:
            what = "needs an instrument, a quantity, and above, below, outside or equals"
            yield document.fault(where, what)
        if missing:
            return
    yield from _level_faults(document, where, when, instances)


def _stack_faults(
    document: Document, where: Where, parts: Any, instances: Collection[str]
) -> Iterator[Fault]:
    if where[-1] == "not":
        yield from _when_faults(document, where, parts, instances)
    elif not isinstance(parts, list) or not parts:
        yield document.fault(where, "must be a list of at least one condition")
    else:
        for number, part in enumerate(parts):
            yield from _when_faults(document, (*where, number), part, instances)


def _level_faults(
    document: Document, where: Where, when: Mapping[str, Any], instances: Collection[str]
) -> Iterator[Fault]:
    instrument, quantity = str(when["instrument"]), str(when["quantity"])
    if instrument not in instances:
        hint = nearest(instrument, instances)
        what = f"this bench has no instrument '{instrument}'"
        what += "" if hint else f"; it has {listed(instances)}"
        yield document.fault((*where, "instrument"), what, hint and f"'{hint}'")
        return
    known = quantities_of(instrument)
    if quantity not in known:
        hint = nearest(quantity, known)
        what = f"'{quantity}' is no quantity of a {role_of(instrument)}"
        what += "" if hint else f"; it has {listed(known)}"
        yield document.fault((*where, "quantity"), what, hint and f"'{hint}'")
        return
    given = [key for key in TESTS if key in when]
    if len(given) > 1:
        yield document.fault(where, f"has {listed(given)}; keep one, or stack them with any")
        return
    for key in given:
        yield from _test_faults(document, (*where, key), key, when[key], known[quantity])


def _test_faults(
    document: Document, where: Where, key: str, given: Any, kind: Quantity
) -> Iterator[Fault]:
    if kind.states:
        if key != "equals":
            what = f"{where[-1]} is for numbers; this is one of {listed(kind.states)}: write equals"
            yield document.fault(where, what)
        elif given not in kind.states:
            hint = nearest(str(given), kind.states)
            what = f"'{given}' is none of its states, {listed(kind.states)}"
            yield document.fault(where, what, hint and f"'{hint}'")
        return
    if key == "equals":
        yield document.fault(where, "is for states; write above, below or outside for a number")
        return
    if key == "outside" and (not isinstance(given, list) or len(given) != 2):
        yield document.fault(where, "must be two values, such as [10 degC, 40 degC]")
        return
    numbers = []
    for number, text in enumerate(given if key == "outside" else [given]):
        place = (*where, number) if key == "outside" else where
        try:
            numbers.append(parse_as(text, kind.unit))
        except UnitError as error:
            yield document.fault(place, error.what, error.hint)
    if len(numbers) == 2 and numbers[0] >= numbers[1]:
        yield document.fault(where, "must begin with the lower value")
    if key != "outside" and kind.magnitude and numbers and numbers[0] < 0:
        what = "means the magnitude and cannot be negative; write outside for one with a sign"
        yield document.fault(where, what)
