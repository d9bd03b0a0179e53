"""Conditions on the level of quantities, stacked with any, all and not; and what reads a quantity.

A condition keeps no state and knows no clock: it is given a reader of quantities, which knows how
old a reading may be and asks the instrument where the newest published one is older. What cannot be
read is neither true nor false, and goes through any, all and not as the third value of Kleene's
logic: `any` of an unreadable and a true one is true, `all` of an unreadable and a false one is
false. Whoever acts on a condition takes what remains unknown as true.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple, Protocol

from station.clock import Clock, ClockError, ClockStopped
from station.errors import InputError, InstrumentError
from station.files.yaml.document import Where
from station.roles.role import kind_of
from station.safety.readings import Reading, Readings, Value

STACKS = ("any", "all", "not")

Watched = tuple[str, str]
"""An instrument and one of its quantities."""


class ReadsQuantities(Protocol):
    """Whoever can read a quantity."""

    def look(self, instrument: str, quantity: str) -> LatestReading:
        """Return what is to be seen of a quantity now; never raises for an instrument."""
        ...


class LatestReading(NamedTuple):
    """A reading; or none, with the reason why, and whether the instrument may say nothing now."""

    reading: Reading | None
    why: str = ""
    excused: bool = False


class Judgement(NamedTuple):
    """Whether a condition is true, None where that is unknown; and in words what was seen."""

    true: bool | None
    said: str
    value: float | str | None = None
    limit: str | None = None


class Condition(Protocol):
    """Something that is true or not of a bench at a moment."""

    @property
    def watched(self) -> frozenset[Watched]:
        """The quantities that it depends on."""
        ...

    def evaluate(self, reader: ReadsQuantities) -> Judgement:
        """Return whether it is true now."""
        ...

    def leaves(self, *through: str) -> Iterator[Level | State]:
        """Yield what it compares, `through` these stacks: `any`, `all`, `not`."""
        ...


@dataclass(frozen=True)
class Level:
    """A number beyond its limits: above `high`, below `low`, or either (`outside`).

    `magnitude`: the sign of the reading is left out. `place`: where it stands in the bench file.
    """

    instrument: str
    quantity: str
    unit: str
    low: float = -math.inf
    high: float = math.inf
    magnitude: bool = False
    place: Where = field(default=(), compare=False)

    @property
    def place_of_high(self) -> Where:
        """Where its upper limit stands in the bench file."""
        above: Where = (*self.place, "above")
        return above if self.low == -math.inf else (*self.place, "outside", 1)

    @property
    def watched(self) -> frozenset[Watched]:
        """The one quantity."""
        return frozenset({(self.instrument, self.quantity)})

    @cached_property
    def limit(self) -> str:
        """The limit in words: `above 8.2 A`."""
        if self.low == -math.inf:
            return f"above {self.high:g} {self.unit}"
        if self.high == math.inf:
            return f"below {self.low:g} {self.unit}"
        return f"outside {self.low:g} {self.unit} to {self.high:g} {self.unit}"

    def leaves(self, *through: str) -> Iterator[Level | State]:
        """Yield itself."""
        yield self

    def evaluate(self, reader: ReadsQuantities) -> Judgement:
        """Compare the present reading; no number is unknown."""
        seen = reader.look(self.instrument, self.quantity)
        name = f"{self.instrument} {self.quantity}"
        if seen.reading is None:
            return Judgement(
                False if seen.excused else None, f"{name} {seen.why}", None, self.limit
            )
        value = seen.reading.value
        if isinstance(value, str) or math.isnan(value):
            return Judgement(None, f"{name} reads {value}, which is no number", None, self.limit)
        level = abs(value) if self.magnitude else value
        beyond = level > self.high or level < self.low
        if math.isinf(value):
            sentence = f"{name} is beyond the range of the instrument, {self.limit}"
            return Judgement(beyond, sentence, None, self.limit)
        if beyond:
            sentence = f"{name} is {value:.4g} {self.unit}, {self.limit}"
        else:
            sentence = f"{name} is {value:.4g} {self.unit}, not {self.limit}"
        return Judgement(beyond, sentence, value, self.limit)


@dataclass(frozen=True)
class State:
    """A state that an instrument is in: a chain that is open, an output that is on."""

    instrument: str
    quantity: str
    equals: str
    place: Where = field(default=(), compare=False)

    @property
    def watched(self) -> frozenset[Watched]:
        """The one quantity."""
        return frozenset({(self.instrument, self.quantity)})

    def leaves(self, *through: str) -> Iterator[Level | State]:
        """Yield itself."""
        yield self

    def evaluate(self, reader: ReadsQuantities) -> Judgement:
        """Compare the present state."""
        seen = reader.look(self.instrument, self.quantity)
        name = f"{self.instrument} {self.quantity}"
        if seen.reading is None:
            excused = False if seen.excused else None
            return Judgement(excused, f"{name} {seen.why}", None, self.equals)
        value = str(seen.reading.value)
        return Judgement(value == self.equals, f"{name} is {value}", value, self.equals)


@dataclass(frozen=True)
class Several(ABC):
    """Conditions that are judged in order; the first that is true, or false, decides for all."""

    parts: Sequence[Condition]
    word: ClassVar[str]
    decides: ClassVar[bool]

    @property
    def watched(self) -> frozenset[Watched]:
        """What its parts watch."""
        return frozenset().union(*(part.watched for part in self.parts))

    def leaves(self, *through: str) -> Iterator[Level | State]:
        """Yield those of its parts."""
        for part in self.parts if self.word in through else ():
            yield from part.leaves(*through)

    def evaluate(self, reader: ReadsQuantities) -> Judgement:
        """Judge the parts; one that decides, else one that is unknown, else what all agree on."""
        judged = []
        for part in self.parts:
            judgement = part.evaluate(reader)
            if judgement.true is self.decides:
                return judgement
            judged.append(judgement)
        unknown = [judgement for judgement in judged if judgement.true is None]
        return unknown[0] if unknown else self._agreed(judged)

    @abstractmethod
    def _agreed(self, judged: Sequence[Judgement]) -> Judgement:
        """Return what follows where no part decides and none is unknown."""


class AnyOf(Several):
    """True when one of its parts is."""

    word = "any"
    decides = True

    def _agreed(self, judged: Sequence[Judgement]) -> Judgement:
        return Judgement(False, _joined(judged, "and"))


class AllOf(Several):
    """True when all of its parts are."""

    word = "all"
    decides = False

    def _agreed(self, judged: Sequence[Judgement]) -> Judgement:
        return Judgement(True, _joined(judged, "and"), judged[-1].value, judged[-1].limit)


@dataclass(frozen=True)
class Not:
    """True when its part is false."""

    part: Condition

    @property
    def watched(self) -> frozenset[Watched]:
        """What its part watches."""
        return self.part.watched

    def leaves(self, *through: str) -> Iterator[Level | State]:
        """Yield those of its part."""
        if "not" in through:
            yield from self.part.leaves(*through)

    def evaluate(self, reader: ReadsQuantities) -> Judgement:
        """Turn the part's judgement over; unknown stays unknown."""
        judgement = self.part.evaluate(reader)
        turned = None if judgement.true is None else not judgement.true
        limit = f"not {judgement.limit}" if judgement.limit else None
        return Judgement(turned, judgement.said, judgement.value, limit)


def _joined(judged: Sequence[Judgement], word: str) -> str:
    return f" {word} ".join(judgement.said for judgement in judged)


YOUNGER = 0.99
"""A reading made at the last look is not fresh at the next, whatever the last bit says."""


@dataclass(frozen=True)
class QuantityReader:
    """Look at the quantities of opened instruments; a reading is fresh for `fresh_s`."""

    readings: Readings
    instruments: Mapping[str, object]
    clock: Clock
    fresh_s: float

    def look(self, instrument: str, quantity: str) -> LatestReading:
        """Return the newest reading while it is fresh, else ask the instrument.

        Raises InputError where the bench file watches what its driver cannot be asked for.
        """
        newest = self.readings.newest(instrument, quantity)
        if newest is not None and self.clock.now() - newest.time_s < YOUNGER * self.fresh_s:
            return in_unit_of_role(newest, instrument, quantity)
        read = getattr(self.instruments.get(instrument), "read_quantity", None)
        if read is None:
            raise InputError(
                f"{instrument}: its driver cannot be asked for its {quantity}; take that interlock "
                "out of the bench file"
            )
        try:
            value: Value | None = read(quantity)
        except (ClockStopped, ClockError, InputError):
            raise
        except Exception as error:  # whatever it is, what cannot be read protects nobody
            return LatestReading(None, f"cannot be read: {error}")
        if value is None:
            return LatestReading(None, "is not measured now", excused=True)
        newest = self.readings.newest(instrument, quantity)
        if newest is None or newest.value != value or newest.time_s != self.clock.now():
            # The driver has not published it by itself.
            unit = kind_of(instrument, quantity).unit
            self.readings.publish(instrument, quantity, value, unit)
            newest = Reading(value, unit, self.clock.now())
        return in_unit_of_role(newest, instrument, quantity)

    def explained(self, watched: Collection[Watched]) -> str:
        """Return in brackets what instruments say to explain a state: which contact is open."""
        sentences = []
        for instrument, quantity in sorted(watched):
            explain = getattr(self.instruments.get(instrument), "explain", None)
            if explain is not None:
                with suppress(InstrumentError):  # the trip itself is reported all the same
                    sentences.append(str(explain(quantity)))
        explained = ", ".join(sentence for sentence in sentences if sentence)
        return f" ({explained})" if explained else ""


def in_unit_of_role(reading: Reading, instrument: str, quantity: str) -> LatestReading:
    """Return a reading as seen; as none where its number is in another unit than its limits."""
    wanted = kind_of(instrument, quantity).unit
    if isinstance(reading.value, str) or reading.unit == wanted:
        return LatestReading(reading)
    return LatestReading(
        None, f"is published in {reading.unit or 'no unit'} instead of {wanted} by its driver"
    )
