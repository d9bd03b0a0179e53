"""What a role declares, and the roles of all installed packages by name.

A role is declared once, beside its Protocol. From that follow the instruments and limits that a
bench file may name, the JSON Schema, the check of each driver, the interlocks, the safe state and
the conformance tests.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

from pydantic import BaseModel

from station import registry
from station.units import dimension_of

BUILT_IN = "built-in"
"""The entry point of the station's own roles."""


@dataclass(frozen=True)
class Limit:
    """A limit that a bench file may give an instrument: its unit, and what it means.

    `needed`: no instrument of the role is energised without it. `signed`: it may be zero or
    negative. Two limits `NAME_low` and `NAME_high` are the ends of a range.
    """

    unit: str
    meaning: str
    needed: bool = False
    signed: bool = False

    def __post_init__(self) -> None:
        dimension_of(self.unit)


@dataclass(frozen=True)
class Quantity:
    """A quantity as drivers publish it: the unit of a number, or the states it may have.

    `period_s` is how often an interlock looks where its own `period` does not say. `magnitude`:
    `above` and `below` mean the magnitude, for what flows or turns either way. `while_on`: looked
    at that often only while something is energised or moves. `energised` is the state that says so
    of the instrument. `limit` names the limit of the bench file on this very quantity.
    """

    unit: str = ""
    states: tuple[str, ...] = ()
    period_s: float = 1.0
    magnitude: bool = False
    while_on: bool = False
    energised: str = ""
    limit: str = ""

    def __post_init__(self) -> None:
        if not self.states:
            dimension_of(self.unit)


CONTACT_STATES = ("closed", "open")
CONTACT = Quantity(states=CONTACT_STATES)
OUTPUT = Quantity(states=("on", "off"), energised="on")
TEMPERATURE = Quantity("degC", period_s=10.0)


@dataclass(frozen=True)
class Witness:
    """What an instrument of a role shows of what others drive: a vector in `unit`.

    `read` asks an opened instrument for its components now, NaN what it does not see and infinite
    what is beyond its range; a driver without the verb `verb` is no witness. In its record they
    are the `columns`, each times `scale`. `expected` returns what a source with these bounds of a
    command and these settings of the bench file should change, None where that is not known.
    """

    unit: str
    verb: str
    columns: tuple[str, ...]
    scale: float
    expected: Callable[[Mapping[str, float], Mapping[str, Any]], float | None]

    def can_read(self, instrument: object) -> bool:
        """Whether a driver has the verb."""
        return callable(getattr(instrument, self.verb, None))

    def read(self, instrument: object) -> tuple[float, ...]:
        """Return the components now; raises InstrumentError."""
        components: tuple[float, ...] = getattr(instrument, self.verb)()
        return components


@dataclass(frozen=True)
class SafeState:
    """What `make_safe` brings an instrument of a role to, and what `read_safety` reads to prove it.

    Where several orders are thinkable the order of the words is that in which it is done. `rank`:
    a bench file that `station scan` drafts brings the lowest to rest first.
    """

    brought_to: str
    proven_by: str
    rank: int


@dataclass(frozen=True)
class Role:
    """A role: its verbs, and all that the station asks of an instrument in it.

    `members` are the places of a bench where it has several, as `x` of `coil_supply.x`. `settings`
    are those that procedures read, whatever the model. `quantities` are what interlocks may watch.
    A role without a `safe_state` cannot harm. `start_samples` starts a source of samples for the
    conformance tests. `reads_device`: what it records is the output of the device under test.
    `witness`: it sees what instruments of other roles drive, and is asked when all is to be off.
    """

    name: str
    protocol: type
    members: tuple[str, ...] = ()
    settings: type[BaseModel] | None = None
    limits: Mapping[str, Limit] = field(default_factory=dict)
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    safe_state: SafeState | None = None
    start_samples: Callable[[Any], None] | None = None
    reads_device: bool = False
    witness: Witness | None = None

    def __post_init__(self) -> None:
        for name in (self.name, *self.members, *self.limits, *self.quantities):
            if not name.isidentifier():
                raise ValueError(f"role {self.name!r}: {name!r} is no name such as zero_current")
        for name, quantity in self.quantities.items():
            if quantity.limit and quantity.limit not in self.limits:
                raise ValueError(f"role {self.name!r}: {name} names no limit of it")
        if not isinstance(self.protocol, type):
            raise ValueError(f"role {self.name!r}: {self.protocol!r} is no Protocol")

    @property
    def instances(self) -> tuple[str, ...]:
        """The names of its instruments in a bench file."""
        return tuple(f"{self.name}.{member}" for member in self.members) or (self.name,)

    @property
    def needed_limits(self) -> tuple[str, ...]:
        """The limits without which no instrument of the role is energised."""
        return tuple(name for name, limit in self.limits.items() if limit.needed)

    @cached_property
    def verbs(self) -> dict[str, tuple[str, ...]]:
        """The public methods of the Protocol with the names of their parameters, without self."""
        return {
            name: parameters_of(method)[1:]
            for name, method in inspect.getmembers(self.protocol, inspect.isfunction)
            if not name.startswith("_")
        }

    @cached_property
    def attributes(self) -> tuple[str, ...]:
        """The attributes that the Protocol and those before it declare."""
        named = (
            getattr(class_, "__annotations__", {}) for class_ in reversed(self.protocol.__mro__)
        )
        return tuple(
            dict.fromkeys(name for names in named for name in names if not name.startswith("_"))
        )

    def missing_verbs(self, driver: object) -> Iterator[str]:
        """Yield each verb that a driver, a class or an instance, lacks or takes otherwise."""
        on_class = isinstance(driver, type)
        for verb, wanted in self.verbs.items():
            method = getattr(driver, verb, None)
            if not callable(method):
                yield f"{verb}({', '.join(wanted)}) is missing"
                continue
            has = parameters_of(method)[1 if on_class else 0 :]
            if has[: len(wanted)] != wanted:
                yield f"{verb} takes ({', '.join(has)}), the role gives ({', '.join(wanted)})"

    def missing_attributes(self, instrument: object) -> list[str]:
        """Return the attributes that an opened instrument lacks."""
        return [name for name in self.attributes if not hasattr(instrument, name)]


def parameters_of(method: Any) -> tuple[str, ...]:
    """Return the names of a function's parameters."""
    return tuple(inspect.signature(method).parameters)


@lru_cache
def collected() -> tuple[Mapping[str, Role], tuple[str, ...]]:
    """Return the roles by name, the station's own first, and why each other one is left out.

    An entry of the group `station.roles` is a Role, or a module with `ROLES`.
    """
    by_name: dict[str, Role] = {}
    left_out: list[str] = []
    for entry in sorted(registry.names(registry.ROLES), key=lambda name: name != BUILT_IN):
        reason = registry.why_not(registry.ROLES, entry)
        if reason is not None:
            left_out.append(reason)
            continue
        for role in offered_by(entry):
            reason = _why_refused(role, by_name)
            if reason is not None:
                left_out.append(f"the role '{entry}' is left out: {reason}")
                continue
            by_name[role.name] = role
    return by_name, tuple(left_out)


def offered_by(entry: str) -> tuple[Any, ...]:
    """Return what an entry point of the group `station.roles` offers as roles."""
    offered = registry.load(registry.ROLES, entry)
    several = getattr(offered, "ROLES", None)
    return tuple(several) if isinstance(several, tuple | list) else (offered,)


def _why_refused(offered: object, known: Mapping[str, Role]) -> str | None:
    """Return why something that a package offers cannot be a role beside those before it."""
    if not isinstance(offered, Role):
        return f"{offered!r:.80} is no Role"
    if offered.name in known:
        return f"there is a role '{offered.name}' already; choose another name"
    for role_before in known.values():
        for name, limit in offered.limits.items():
            before = role_before.limits.get(name)
            if before is not None and (before.unit, before.signed) != (limit.unit, limit.signed):
                return (
                    f"its limit '{name}' is in {limit.unit}, that of a {role_before.name} in "
                    f"{before.unit}, or only one of them may be negative; choose another name"
                )
    return None


def roles() -> Mapping[str, Role]:
    """Return the roles of all installed packages by name, in the order of a bench."""
    return collected()[0]


def role(name: str) -> Role | None:
    """Return the role `name`, or None where no installed package declares it."""
    return roles().get(name)


def role_of(instance: str) -> str:
    """Return the name of an instance's role: `coil_supply` of `coil_supply.x`."""
    return instance.split(".")[0]


def safe_states() -> Mapping[str, SafeState]:
    """Return by role how an instrument is made safe, in the order of their ranks."""
    states = {
        name: declared.safe_state
        for name, declared in roles().items()
        if declared.safe_state is not None
    }
    return dict(sorted(states.items(), key=lambda item: item[1].rank))


def instances() -> tuple[str, ...]:
    """Return the names of all instruments that a bench file may have."""
    return tuple(name for declared in roles().values() for name in declared.instances)


def limits() -> Mapping[str, Limit]:
    """Return the limits that a bench file may give, by name; the first role says what one means."""
    by_name: dict[str, Limit] = {}
    for declared in roles().values():
        for name, limit in declared.limits.items():
            by_name.setdefault(name, limit)
    return by_name


def quantities_of(instance: str) -> Mapping[str, Quantity]:
    """Return what can be watched of an instance, by name."""
    declared = role(role_of(instance))
    return {} if declared is None else declared.quantities


def kind_of(instance: str, quantity: str) -> Quantity:
    """Return the declaration of a quantity of an instance."""
    return quantities_of(instance)[quantity]


def energised_states(instance: str) -> Mapping[str, str]:
    """Return by quantity the state that says of an instance that it is energised or moves."""
    declared = quantities_of(instance).items()
    return {name: quantity.energised for name, quantity in declared if quantity.energised}


def turns(instance: str) -> bool:
    """Whether an instrument turns what stands on it."""
    declared = role(role_of(instance))
    if declared is None or declared.safe_state is None:
        return False
    return any(limit.unit == "deg/s" for limit in declared.limits.values())


def roles_of(driver: type) -> list[str]:
    """Return the roles whose verbs a driver class has.

    A driver that has the verbs of a role without being one says what it is in its `roles`.
    """
    if hasattr(driver, "roles"):
        return list(driver.roles)
    return [name for name, declared in roles().items() if not list(declared.missing_verbs(driver))]
