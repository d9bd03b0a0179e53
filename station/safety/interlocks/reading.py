"""Interlocks of a bench file: their keys, every fault with its place, and the conditions."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

from pydantic import Field, WithJsonSchema

from station.fields import Second, StrictModel, quantity_pattern
from station.files.faults import Fault, listed, nearest, not_there
from station.files.yaml.document import Document, Where
from station.roles.role import CONTACT_STATES, Quantity, kind_of, quantities_of, role_of
from station.safety.interlocks.conditions import (
    STACKS,
    AllOf,
    AnyOf,
    Condition,
    Level,
    Not,
    State,
)
from station.units import UNITS, UnitError, parse_as

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
            for word in STACKS
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
KEYS = ("instrument", "quantity", *TESTS, *STACKS)


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
    entries: Sequence[InterlockEntry], instruments: Collection[str]
) -> tuple[Interlock, ...]:
    """Return the interlocks of a bench; its chain is one, whether it is written there or not."""
    interlocks = []
    reader = ConditionReader(instruments)
    for number, entry in enumerate(entries):
        when = reader.read(entry.when, ("interlocks", number, "when"))
        assert when is not None  # a bench without a fault
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


def interlock_faults(document: Document, instances: Collection[str]) -> Iterator[Fault]:
    """Yield every fault of the interlocks of a bench file that its model does not see."""
    faults: list[Fault] = []
    reader = ConditionReader(
        instances, lambda *what, **at: faults.append(document.fault(*what, **at))
    )
    names: set[str] = set()
    for number, entry in entries_of(document):
        name = entry.get("name")
        if isinstance(name, str) and name in names:
            faults.append(
                document.fault(
                    ("interlocks", number, "name"), f"'{name}' was named before; choose another"
                )
            )
        names.add(str(name))
        if isinstance(entry.get("when"), dict):  # else the model says so
            reader.read(entry["when"], ("interlocks", number, "when"))
    yield from faults


def interlocks_in(document: Document) -> Iterator[tuple[Mapping[str, Any], Condition]]:
    """Yield each interlock of a document with what can be read of its condition."""
    instruments = document.data.get("instruments")
    reader = ConditionReader(instruments if isinstance(instruments, dict) else ())
    for number, entry in entries_of(document):
        when = reader.read(entry.get("when"), ("interlocks", number, "when"))
        if when is not None:
            yield entry, when


def entries_of(document: Document) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield the interlocks of a document that are mappings, with their numbers."""
    entries = document.data.get("interlocks")
    for number, entry in enumerate(entries if isinstance(entries, list) else ()):
        if isinstance(entry, dict):
            yield number, entry


class ConditionReader:
    """Read conditions of a bench file; what is wrong is reported, and the rest is read.

    `fault` gets the place, what is wrong there and a hint, as `Document.fault`.
    """

    def __init__(
        self,
        instances: Collection[str],
        fault: Callable[..., object] = lambda *what, **at: None,
    ) -> None:
        self._instances = instances
        self._fault = fault

    def read(self, when: Any, where: Where) -> Condition | None:
        """Return the condition at a place; None where nothing of it can be read."""
        if not isinstance(when, dict):
            self._fault(where, "must be a mapping, such as {instrument: …, quantity: …}")
            return None
        unknown = [key for key in when if key not in KEYS]
        for key in unknown:
            hint = nearest(key, KEYS)
            what = "is not a key of a condition" + ("" if hint else f"; known are {listed(KEYS)}")
            self._fault((*where, key), what, hint and f"'{hint}'", at_key=True)
        stacked = [key for key in STACKS if key in when]
        if stacked:
            if len(when) - len(unknown) > 1:
                self._fault(where, f"'{stacked[0]}' stands alone; take the other keys out")
                return None
            return self._stack(stacked[0], when[stacked[0]], (*where, stacked[0]))
        missing = [key for key in ("instrument", "quantity") if key not in when]
        # A misspelt key was reported already.
        if (missing or not any(key in when for key in TESTS)) and not unknown:
            what = "needs an instrument, a quantity, and above, below, outside or equals"
            self._fault(where, what)
        return None if missing else self._leaf(when, where)

    def _stack(self, word: str, parts: Any, where: Where) -> Condition | None:
        if word == "not":
            part = self.read(parts, where)
            return None if part is None else Not(part)
        if not isinstance(parts, list) or not parts:
            self._fault(where, "must be a list of at least one condition")
            return None
        read = [self.read(part, (*where, number)) for number, part in enumerate(parts)]
        conditions = tuple(part for part in read if part is not None)
        stack = AnyOf if word == "any" else AllOf
        return stack(conditions) if conditions else None

    def _leaf(self, when: Mapping[str, Any], where: Where) -> Level | State | None:
        instrument, quantity = str(when["instrument"]), str(when["quantity"])
        if instrument not in self._instances:
            hint = nearest(instrument, self._instances)
            what = f"this bench has no instrument '{instrument}'"
            what += "" if hint else f"; it has {listed(self._instances)}"
            self._fault((*where, "instrument"), what, hint and f"'{hint}'")
            return None
        known = quantities_of(instrument)
        if quantity not in known:
            hint = nearest(quantity, known)
            what = f"'{quantity}' is no quantity of a {role_of(instrument)}"
            what += "" if hint else f"; it has {listed(known)}"
            self._fault((*where, "quantity"), what, hint and f"'{hint}'")
            return None
        kind = known[quantity]
        given = [key for key in TESTS if key in when]
        if len(given) > 1:
            self._fault(where, f"has {listed(given)}; keep one, or stack them with any")
        test = given[0] if len(given) == 1 else ""
        if kind.states:
            equals = self._state(test, when.get(test), (*where, test), kind)
            return State(instrument, quantity, equals, where)
        low, high = self._range(test, when.get(test), (*where, test), kind)
        magnitude = kind.magnitude and test != "outside"
        return Level(instrument, quantity, kind.unit, low, high, magnitude, where)

    def _state(self, test: str, given: Any, where: Where, kind: Quantity) -> str:
        if test and test != "equals":
            what = f"{test} is for numbers; this is one of {listed(kind.states)}: write equals"
            self._fault(where, what)
        elif test and given not in kind.states:
            what = f"'{given}' is none of its states"
            self._fault(where, *not_there(what, str(given), kind.states))
        return str(given)

    def _range(self, test: str, given: Any, where: Where, kind: Quantity) -> tuple[float, float]:
        """Return the lowest and the highest value that are no trip."""
        without = (-math.inf, math.inf)
        if test == "equals":
            self._fault(where, "is for states; write above, below or outside for a number")
        if test not in BOUNDS:
            return without
        if test != "outside":
            value = self._number(given, where, kind)
            if value is not None and kind.magnitude and value < 0:
                what = (
                    "means the magnitude and cannot be negative; write outside for one with a sign"
                )
                self._fault(where, what)
            if value is None:
                return without
            return (-math.inf, value) if test == "above" else (value, math.inf)
        if not isinstance(given, list) or len(given) != 2:
            self._fault(where, "must be two values, such as [10 degC, 40 degC]")
            return without
        low, high = (self._number(text, (*where, n), kind) for n, text in enumerate(given))
        if low is None or high is None:
            return without
        if low >= high:
            self._fault(where, "must begin with the lower value")
        return low, high

    def _number(self, text: Any, where: Where, kind: Quantity) -> float | None:
        try:
            return parse_as(text, kind.unit)
        except UnitError as error:
            self._fault(where, error.what, error.hint)
            return None
