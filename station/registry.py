"""Procedures, drivers and simulators by entry point, our own and any laboratory's alike."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from station.errors import InputError

if TYPE_CHECKING:
    from station.procedure import Procedure

PROCEDURES = "station.procedures"
DRIVERS = "station.drivers"
SIMULATORS = "station.simulators"
SIMULATED_BENCH = "bench"


@lru_cache
def names(group: str) -> tuple[str, ...]:
    """Return the names of a group in order."""
    return tuple(sorted({entry.name for entry in entry_points(group=group)}))


@lru_cache
def load(group: str, name: str) -> Any:
    """Return the object that a package offers under `name`; InputError when it cannot be loaded."""
    found: list[EntryPoint] = [entry for entry in entry_points(group=group) if entry.name == name]
    if not found:
        kind = group.removeprefix("station.").removesuffix("s")
        known = ", ".join(names(group)) or "none"
        raise InputError(f"there is no {kind} named {name!r}; there are: {known}")
    try:
        return found[0].load()
    except ImportError as error:
        raise InputError(
            f"{name} ({found[0].value}) cannot be loaded: {error}; install the package it needs"
        ) from error


def procedure(name: str) -> Procedure:
    """Return the procedure `name`."""
    loaded: Procedure = load(PROCEDURES, name)
    return loaded


class Procedures:
    """All procedures as a mapping that loads one when it is asked for."""

    def __contains__(self, name: object) -> bool:
        return name in names(PROCEDURES)

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(names(PROCEDURES))

    def __len__(self) -> int:
        return len(names(PROCEDURES))

    def __getitem__(self, name: str) -> Procedure:
        if name not in self:
            raise KeyError(name)
        return procedure(name)
