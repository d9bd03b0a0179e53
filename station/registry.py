"""Procedures, roles, drivers and simulators by entry point, our own and any laboratory's alike.

What is wrong with one package costs its own entries and no others.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from importlib.metadata import Distribution, EntryPoint, EntryPoints, distributions
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from station.errors import InputError, reason_of

PROCEDURES = "station.procedures"
DRIVERS = "station.drivers"
SIMULATORS = "station.simulators"
ROLES = "station.roles"
SIMULATED_BENCH = "bench"
MUST_HAVE = {PROCEDURES: ("title", "steps", "parameters", "evaluate_run")}
"""What every entry of a group has; something else that a package offers there is refused."""
OURS = "station."


@lru_cache
def offers() -> tuple[dict[str, dict[str, EntryPoint]], tuple[str, ...]]:
    """Return all entry points by group and name, and a sentence on each package that is odd.

    Of two that have one name, that of the package which Python finds first counts.
    """
    groups: dict[str, dict[str, EntryPoint]] = {}
    odd: list[str] = []
    doubled: list[str] = []
    for package in distributions():
        try:
            offered = [
                entry_point
                for entry_point in package.entry_points
                if entry_point.group.startswith(OURS)
            ]
        except Exception as error:  # metadata that anybody may have written
            odd.append(
                f"the entry points of the package {name_of(package)} cannot be read "
                f"({reason_of(error)}); reinstall the package, or remove it"
            )
            continue
        for entry in offered:
            first = groups.setdefault(entry.group, {}).setdefault(entry.name, entry)
            if name_of(first.dist) != name_of(package):
                doubled.append(
                    f"the {kind_in(entry.group)} '{entry.name}' is offered by two packages, "
                    f"{name_of(first.dist)}, which is taken, and {name_of(package)}; rename it in "
                    "one of them, or remove that package"
                )
    if odd:
        have_none_where_unreadable()
    return groups, (*odd, *doubled)


def kind_in(group: str) -> str:
    """Return what a group holds: `driver` of `station.drivers`."""
    return group.removeprefix(OURS).removesuffix("s")


def have_none_where_unreadable() -> None:
    """Let a package whose entry points cannot be read have none, for whoever asks from now on.

    Libraries that look for plug-ins, such as python-can, read those of every package, and fail.
    """
    readable = Distribution.entry_points.fget  # type: ignore[attr-defined]

    def read(package: Distribution) -> EntryPoints:
        try:
            entries: EntryPoints = readable(package)
        except Exception:  # as above
            return EntryPoints()
        return entries

    setattr(Distribution, "entry_points", property(read))  # noqa: B010


def name_of(package: Distribution | None) -> str:
    """Return the name of a package, its folder's where its metadata gives none."""
    try:
        name = package.metadata["Name"] if package is not None else None
    except Exception:  # as above
        name = None
    return str(name or getattr(package, "_path", "of an unknown name"))


@lru_cache
def names(group: str) -> tuple[str, ...]:
    """Return the names of a group in order."""
    return tuple(sorted(offers()[0].get(group, {})))


@lru_cache
def load(group: str, name: str) -> Any:
    """Return the object that a package offers under `name`; InputError when it cannot be loaded."""
    entry = offers()[0].get(group, {}).get(name)
    kind = kind_in(group)
    if entry is None:
        known = ", ".join(names(group)) or "none"
        raise InputError(f"there is no {kind} named {name!r}; there are: {known}")
    try:
        loaded = entry.load()
        _refuse_other(group, kind, loaded)
        return loaded
    except (Exception, SystemExit) as error:  # whatever the package does when it is imported
        raise InputError(
            f"the {kind} {name!r} of the package {name_of(entry.dist)} cannot be loaded from "
            f"{entry.value} ({reason_of(error)}); install what the package needs, repair it or "
            "remove it"
        ) from error


def _refuse_other(group: str, kind: str, loaded: object) -> None:
    lacking = [name for name in MUST_HAVE.get(group, ()) if not hasattr(loaded, name)]
    if lacking:
        raise TypeError(f"{loaded!r:.80} is no {kind}: it has no {lacking[0]}")


def loaded(group: str) -> Iterator[tuple[str, Any]]:
    """Yield name and object of each entry of a group that can be loaded."""
    for name in names(group):
        if not why_not(group, name):
            yield name, load(group, name)


def why_not(group: str, name: str) -> str | None:
    """Return why an entry cannot be loaded, None where it can."""
    try:
        load(group, name)
    except InputError as error:
        return str(error)
    return None


def folder_of(group: str, name: str) -> Path | None:
    """Return the folder of the module that an entry names; None where there is none."""
    entry = offers()[0].get(group, {}).get(name)
    try:
        spec = find_spec(entry.module) if entry else None
    except (ImportError, ValueError):
        return None
    return Path(spec.origin).parent if spec is not None and spec.origin else None
