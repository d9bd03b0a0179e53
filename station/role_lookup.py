"""The roles that drivers may fill, by entry point, and whether a driver has a role's verbs."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

from pydantic import BaseModel

from station import registry
from station.safety.interlocks.quantities import QUANTITIES

ROLES = "station.roles"
"""Entry points of this group are modules; a role `coil_supply` is their Protocol `CoilSupply`."""


@dataclass(frozen=True)
class Role:
    """A role: its verbs with the names of their parameters, and its attributes."""

    name: str
    protocol: type
    verbs: dict[str, tuple[str, ...]]
    attributes: tuple[str, ...]

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


@lru_cache
def role(name: str) -> Role | None:
    """Return the role `name`, or None where no installed package says what it can do."""
    wanted = "".join(part.capitalize() for part in name.split("_"))
    for _, module in registry.loaded(ROLES):
        protocol = getattr(module, wanted, None)
        if isinstance(protocol, type):
            return Role(name, protocol, verbs_of(protocol), attributes_of(protocol))
    return None


class SafeState(Protocol):
    """What an instrument of a role is brought to at the end of a run, and what proves it."""

    brought_to: str
    proven_by: str


@lru_cache
def role_settings() -> Mapping[str, type[BaseModel]]:
    """Return by role the settings that procedures read, whatever the model."""
    found: dict[str, type[BaseModel]] = {}
    for _, module in registry.loaded(ROLES):
        found.update(getattr(module, "SETTINGS", {}))
    return found


@lru_cache
def safe_states() -> Mapping[str, SafeState]:
    """Return by role how an instrument is made safe; a role that is not there cannot harm."""
    found: dict[str, SafeState] = {}
    for _, module in registry.loaded(ROLES):
        found.update(getattr(module, "SAFE_STATES", {}))
    return found


def roles_of(driver: type) -> list[str]:
    """Return the roles of a bench whose verbs a driver class has.

    A driver that has the verbs of a role without being one says what it is in its `roles`.
    """
    if hasattr(driver, "roles"):
        return list(driver.roles)
    known = [one for one in map(role, QUANTITIES) if one is not None]
    return [one.name for one in known if not list(one.missing_verbs(driver))]


def parameters_of(method: Any) -> tuple[str, ...]:
    """Return the names of a function's parameters."""
    return tuple(inspect.signature(method).parameters)


def verbs_of(protocol: type) -> dict[str, tuple[str, ...]]:
    """Return the public methods of a Protocol with the names of their parameters, self left out."""
    return {
        name: parameters_of(method)[1:]
        for name, method in inspect.getmembers(protocol, inspect.isfunction)
        if not name.startswith("_")
    }


def attributes_of(protocol: type) -> tuple[str, ...]:
    """Return the attributes that a Protocol and those before it declare."""
    named = (getattr(one, "__annotations__", {}) for one in reversed(protocol.__mro__))
    return tuple(
        dict.fromkeys(name for names in named for name in names if not name.startswith("_"))
    )
