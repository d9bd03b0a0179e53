"""What every driver is given, gives back and can do."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, partial, wraps
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TypeVar, cast, runtime_checkable

from pydantic import ValidationError

from station.clock import Clock
from station.errors import InstrumentError, QuantityNotRead
from station.fields import StrictModel, key_of
from station.roles.kept_settings import KeptSettings
from station.roles.patience import patience
from station.roles.sources import not_confirmed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Tracer = Callable[[str, bytes], None]
"""Takes a direction (`>` sent, `<` received, `!` fault, `-` remark) and the bytes or the words."""


EXCHANGE_DEADLINE_S = 0.5
"""Run time in which an instrument answers, unless its driver or the bench file gives it longer."""
MAX_DEADLINE_S = 5.0
"""Half of what the watch for standstill allows; what takes longer is started, polled, fetched."""
TRIES = 3
"""How often a message that does no harm twice is sent before its error is believed."""
ANSWER_TIME = "answer-time"
"""The event of an answer that took a larger share of its deadline than any before it."""
NOTED_SHARE, NOTED_GROWTH = 0.1, 1.1
"""An answer time is noted beyond this share of its deadline, and again where it grows so much."""


class Exchanges:
    """How long each exchange with one instrument may wait for its answer, and how long one did."""

    def __init__(self, deadline_s: float = EXCHANGE_DEADLINE_S) -> None:
        self.deadline_s = deadline_s
        """Of every exchange; one whose kind the driver gives longer has that."""
        self._until_s = math.inf
        self._largest_share = 0.0

    def deadline_of_s(self, stated_s: float, now_s: float) -> float:
        """Return the deadline of an exchange that begins at run time `now_s`, in s from then.

        `stated_s` is what the driver states of its kind. On the way to rest none goes beyond the
        time that the instrument has for it, but for the usual deadline.
        """
        deadline_s = max(stated_s, self.deadline_s)
        return max(EXCHANGE_DEADLINE_S, min(deadline_s, self._until_s - now_s))

    @contextmanager
    def until(self, time_s: float) -> Iterator[None]:
        """Let no exchange wait beyond run time `time_s` until exit."""
        before, self._until_s = self._until_s, min(self._until_s, time_s)
        try:
            yield
        finally:
            self._until_s = before

    def is_noteworthy(self, took_s: float, deadline_s: float) -> bool:
        """Whether an answer took a larger share of its deadline than any before, and much of it."""
        share = took_s / deadline_s
        if share < max(NOTED_SHARE, NOTED_GROWTH * self._largest_share):
            return False
        self._largest_share = share
        return True


class Place(Protocol):
    """Where an instrument is attached, and what the bench file says of it."""

    @property
    def name(self) -> str:
        """The instance name of the bench file, `coil_supply.x`."""
        ...

    @property
    def address(self) -> str:
        """A VISA resource name, a serial port, a URL such as `can://pcan/…`, or empty."""
        ...

    @property
    def clock(self) -> Clock:
        """The run's clock; whatever waits or stamps uses it."""
        ...

    @property
    def settings(self) -> Mapping[str, Any]:
        """The driver's own settings, quantities as text: `2 A/s`."""
        ...

    @property
    def limits(self) -> Mapping[str, float]:
        """The bench's limits in A, V, A/s, mT, deg/s, degC."""
        ...

    @property
    def exchanges(self) -> Exchanges:
        """How long each exchange may wait for its answer."""
        ...

    def publish(self, quantity: str, value: float | str, unit: str = "") -> None:
        """Put up a reading, or the word of a state, for interlocks and panel."""
        ...

    def note(self, kind: str, **details: Any) -> None:
        """Have an event of the line written to the run's log; never blocks."""
        ...

    @property
    def trace(self) -> Tracer | None:
        """Who receives what goes over the wire; None where nobody does, as in most runs."""
        ...

    @property
    def shared(self) -> Mapping[str, Any]:
        """The opened instruments over whose lines this one is reached (`shares`), by name."""
        ...

    def ask(self, prompt_id: str, text: str) -> str:
        """Put a request to the operator and return the answer."""
        ...

    def ask_at_the_end(self, prompt_id: str, text: str) -> None:
        """Put a request that no step waits for.

        Where a person has to be waited for, the run asks when the bench is at rest and the results
        are written.
        """
        ...


UNTOLD = "untold"
"""In the place of a serial number that an instrument has and does not tell over its line."""


@dataclass(frozen=True)
class Identity:
    """Who answered: maker, model, serial number and firmware, as the instrument says them."""

    maker: str
    model: str
    serial: str
    firmware: str


ARRIVAL = "arrival_time_s"
"""The column of a raw file that holds when a row reached the computer."""


@dataclass(frozen=True)
class Block:
    """Rows of a stream in the instrument's own units and time base.

    `columns` maps names that carry their unit to arrays of shape (rows,); `arrival_time_s` is the
    run time, shape (rows,), at which each row reached the computer.
    """

    columns: Mapping[str, NDArray[Any]]
    arrival_time_s: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.arrival_time_s)


@dataclass(frozen=True)
class SafetyReading:
    """What an instrument reads back of its safe state."""

    safe: bool
    read_back: str
    dormant: bool = False
    """Not brought to rest by anybody, and yet it drives nothing: as after power-on."""


class DriverSettings(StrictModel):
    """What a bench file may write under `settings`, and what each key means; here nothing."""

    @classmethod
    def read(cls, settings: Mapping[str, Any]) -> Self:
        """Return these settings of a bench file's; other keys belong to other models.

        Raises ValidationError, a ValueError, for one that is wrong or missing.
        """
        keys = {key_of(cls, name) for name in cls.model_fields}
        given = {key: value for key, value in settings.items() if key in keys}
        return cls.model_validate_json(json.dumps(given), strict=True)

    @classmethod
    def of(cls, place: Place) -> Self:
        """Return these settings of an instrument; InstrumentError where one is wrong or missing.

        A bench file that is to be used has been refused by then, with line and column.
        """
        try:
            return cls.read(place.settings)
        except ValidationError as error:
            wrong = error.errors(include_url=False)[0]
            key = ".".join(("settings", *map(str, wrong["loc"])))
            reason = wrong["msg"].removeprefix("Value error, ")
            raise InstrumentError(
                place.name,
                "read the bench file",
                f"its settings are wrong ({key}: {reason})",
                f"correct {key}; `station validate` says where it stands",
            ) from error


Read = TypeVar("Read", bound=Callable[..., Any])
States = tuple[str, str] | None
"""The words for True and False of a reading that is one of two states."""


def published(name: str, unit: str = "", states: States = None) -> Callable[[Read], Read]:
    """Have a driver's method publish what it returns, in `unit`; None is not published."""

    def decorate(read: Read) -> Read:
        @wraps(read)
        def reading(self: Driver, *args: Any) -> Any:
            value = read(self, *args)
            if value is not None:
                word = value if states is None else states[not value]
                self.place.publish(name, word, unit)
            return value

        reading.publishes = name, unit, states  # type: ignore[attr-defined]
        return cast("Read", reading)

    return decorate


def quantity(name: str, unit: str = "", states: States = None) -> Callable[[Read], Read]:
    """Declare the method that reads a quantity now for interlocks; it is `published`, too.

    It returns None while there is nothing to be known.
    """

    def decorate(read: Read) -> Read:
        reading = published(name, unit, states)(read)
        reading.watched = True  # type: ignore[attr-defined]
        return reading

    return decorate


@dataclass(frozen=True)
class Shares:
    """Whose lines a driver may be reached over: instruments, or drivers, of a `kind`.

    `otherwise` and `do_now` say what others lack and what to write; `needed` where it has no line.
    """

    kind: type
    otherwise: str
    do_now: str
    needed: bool = False

    def why_not(self, shared: Mapping[str, object]) -> str | None:
        """Return why it cannot be reached over these; None where it can."""
        wrong = [name for name, each in shared.items() if not self._fits(each)]
        if wrong:
            return f"{', '.join(wrong)} {self.otherwise}"
        return "it shares no line" if self.needed and not shared else None

    def need(self, place: Place) -> None:
        """Raise InstrumentError where it cannot be reached over what is shared."""
        if why := self.why_not(place.shared):
            raise InstrumentError(place.name, "read the bench file", why, self.do_now)

    def _fits(self, each: object) -> bool:
        return (
            issubclass(each, self.kind) if isinstance(each, type) else isinstance(each, self.kind)
        )


class Driver:
    """What every driver has: the settings that it takes, and the quantities that it reads.

    `Settings` is the model of its settings. `quantities` has, by name, what reads a quantity for an
    interlock; methods declared with `quantity` are entered by themselves. `wired_by` names the
    setting without which a quantity is not wired. A driver's line is its `_line`.

    Its way to rest and its looks (`PATIENT_VERBS`, `read_quantity`) have `patience`. Where its
    `make_safe` fails, its `last_attempt`, if it has one, switches it off, and the error is raised.

    `deadline_s` is the run time in which its model answers any exchange; `deadlines` has that of
    what takes longer, by a regular expression that is searched for in the message. None is above
    5 s. Each states its reason.
    """

    Settings: ClassVar[type[DriverSettings]] = DriverSettings
    quantities: ClassVar[Mapping[str, Callable[[Any], float | str | None]]] = {}
    wired_by: ClassVar[Mapping[str, str]] = {}
    deadline_s: ClassVar[float] = EXCHANGE_DEADLINE_S
    deadlines: ClassVar[Mapping[str, float]] = {}
    shares: ClassVar[Shares | None] = None
    """Over whose lines it may be reached; None where it has a line of its own alone."""
    on_can: ClassVar[bool | None] = None
    """Whether it is reached over CAN; None where its address says that."""
    without_limits: ClassVar[str] = "nothing is switched on"
    """What is so where the bench file does not give a limit that the driver needs."""
    place: Place

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        declared = {
            read.publishes[0]: partial(_in_words, method, read.publishes[2])
            for method, read in vars(cls).items()
            if getattr(read, "watched", False)
        }
        cls.quantities = {**cls.quantities, **declared}
        for verb, hold in PATIENT_VERBS.items():
            # Its own, or of a class beside it that is no driver.
            owner = next((base for base in cls.__mro__ if verb in vars(base)), Driver)
            if owner is not cls and issubclass(owner, Driver):
                continue
            act: Callable[..., Any] = vars(owner)[verb]
            if callable(act):  # a driver may have something else of this name
                setattr(cls, verb, patience()(hold(act)))

    def error(self, attempted: str, came_back: str, do_now: str) -> InstrumentError:
        """Return an error of this instrument: what was attempted, what came back, what to do."""
        return InstrumentError(self.place.name, attempted, came_back, do_now)

    def check_rating(
        self,
        limit: str,
        rating: float,
        unit: str,
        *,
        whose: str = "the instrument",
        rounded: float = 0.0,
    ) -> None:
        """Raise InstrumentError where the bench allows more than the instrument is rated for."""
        if self.limit(limit) > rating + rounded:
            raise self.error(
                f"limit the {limit} to {self.limit(limit):g} {unit}",
                f"{whose} ends at {rating:g} {unit}",
                f"lower limits.{limit} in the bench file",
            )

    def check_set(self, what: str, wanted: str, has: str, *, agrees: bool) -> None:
        """Raise InstrumentError where a setting reads back otherwise than it was set."""
        if not agrees:
            do_now = "check that nobody works at its front panel, then run again"
            raise self.error(f"set {what} to {wanted}", f"it reads back {has}", do_now)

    def limit(self, name: str) -> float:
        """Return a limit of the bench file; InstrumentError where it gives none."""
        if name not in self.place.limits:
            raise self.error(
                "read the bench file",
                f"it gives no limits.{name}",
                f"write it there; {self.without_limits} without it",
            )
        return self.place.limits[name]

    @cached_property
    def kept(self) -> KeptSettings:
        """What the instrument keeps after a run; the run puts it back at its end."""
        return KeptSettings(self.place.note)

    def met(self, variant: str) -> None:
        """Have the run's log say which of an instrument's several forms is met; each once."""
        if variant not in self._variants:
            self._variants.add(variant)
            self.place.note("instrument-variant", met=variant)

    @cached_property
    def _variants(self) -> set[str]:
        return set()

    def open_questions(self) -> list[str]:
        """Return questions of the command table that are not confirmed and do no harm."""
        asked = map(self._as_sent, not_confirmed(type(self)))
        harmless = getattr(self, "repeatable", ())
        return [message for message in asked if "?" in message and message in harmless]

    def ask_openly(self, question: str) -> str:
        """Return what the instrument answers one of these questions; InstrumentError for none."""
        return self._line.query(question)  # type: ignore[attr-defined,no-any-return]

    def _as_sent(self, command: str) -> str:
        return command

    def close(self) -> None:
        """Give the line back."""
        self._line.close()  # type: ignore[attr-defined]  # each driver has its own

    def await_rest(self, deadline_s: float) -> None:
        """Give what was switched off blindly the time in which it comes to rest; here none."""

    @patience()
    def read_quantity(self, quantity: str) -> float | str | None:
        """Return a quantity now; None while there is nothing to be known.

        Raises QuantityNotRead, an InputError, for one that it does not read or is not wired.
        """
        QuantityNotRead.refuse(self.place.name, self, quantity, self.place.settings)
        return self.quantities[quantity](self)


def _as_it_is(verb: Callable[..., Any]) -> Callable[..., Any]:
    return verb


def _bounded(make_safe: Callable[[Any, float], None]) -> Callable[[Any, float], None]:
    """Return a driver's way to rest, none of whose exchanges waits beyond its time.

    Where it fails, what one command switches off is sent that, and the error is raised.
    """

    @wraps(make_safe)
    def bounded(driver: Driver, deadline_s: float) -> None:
        with driver.place.exchanges.until(deadline_s):
            try:
                make_safe(driver, deadline_s)
            except InstrumentError:
                if isinstance(driver, SwitchedOffBlindly):
                    with suppress(InstrumentError), patience(granted=False):
                        driver.last_attempt()
                    driver.await_rest(deadline_s)
                raise

    return bounded


def _held_to_reading(read_safety: Callable[[Any], object]) -> Callable[[Any], SafetyReading]:
    """Return a driver's look whether it is at rest; InstrumentError where it returns no reading."""

    @wraps(read_safety)
    def held(driver: Driver) -> SafetyReading:
        reading = read_safety(driver)
        if not isinstance(reading, SafetyReading):
            of = f"{type(driver).__module__}.{type(driver).__name__}"
            raise driver.error(
                "read whether it is at rest",
                f"read_safety of its driver {of} returned {reading!r:.80}, no SafetyReading",
                "repair the driver, and look at the instrument itself",
            )
        return reading

    return held


PATIENT_VERBS: Mapping[str, Callable[[Any], Callable[..., Any]]] = {
    "make_safe": _bounded,
    "read_safety": _held_to_reading,
    "open_contacts": _as_it_is,
    "pause": _as_it_is,
}
"""The verbs of any driver that have patience, and what each is held to besides."""


def _in_words(method: str, states: States, driver: Driver) -> float | str | None:
    """Return what a declared method of a driver reads, one of two states by its word."""
    value = getattr(driver, method)()
    return value if states is None or value is None else states[not value]


@runtime_checkable
class Instrument(Protocol):
    """Anything with a line, or an operator, at its other end."""

    place: Place

    def identify(self) -> Identity:
        """Ask who is there."""
        ...

    def close(self) -> None:
        """Give the line back; never raises for a line that is already gone."""
        ...


@runtime_checkable
class KeepsErrors(Protocol):
    """An instrument with an error queue that can be read."""

    def take_errors(self) -> list[str]:
        """Return the errors that it keeps, the oldest first, and leave its queue empty.

        Raises InstrumentError where the queue does not come to its end.
        """
        ...


@runtime_checkable
class MadeSafe(Protocol):
    """An instrument that can harm, and how it is brought to rest."""

    def make_safe(self, deadline_s: float) -> None:
        """Bring the instrument to rest before run time `deadline_s`."""
        ...

    def read_safety(self) -> SafetyReading:
        """Read back whether it is at rest; nothing is assumed from what was commanded."""
        ...


@runtime_checkable
class SwitchedOffBlindly(Protocol):
    """An instrument that one command switches off, however often it comes: none that toggles."""

    def last_attempt(self) -> None:
        """Send that command, whatever lies on the line, and wait for no answer.

        Raises InstrumentError where it cannot be sent.
        """
        ...


@runtime_checkable
class SampledSource(Instrument, Protocol):
    """A source of samples that number or stamp themselves."""

    source: str
    """The name of its raw files."""

    columns: Mapping[str, str]
    """Column name to unit and meaning, for whoever opens the raw file.

    The text begins with the unit. A running number of equal intervals says how far they are apart,
    as in `1, number of the sample, every 0.1 s`: exports make its time axis of that.
    """

    def drain(self) -> Block:
        """Return all rows that came since the last call, possibly none."""
        ...
