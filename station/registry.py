"""Procedures, roles, drivers and simulators by entry point, our own and any laboratory's alike.

What is wrong with one package costs its own entries and no others: a name of the station's own
stays its own, and what another package does when it is imported ends nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from importlib.metadata import Distribution, EntryPoint, EntryPoints, distributions
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import Any

from station.errors import InputError, reason_of
from station.files.faults import meant, not_there
from station.packages import DISTRIBUTION, NAMES

PROCEDURES = "station.procedures"
DRIVERS = "station.drivers"
SIMULATORS = "station.simulators"
ROLES = "station.roles"
SIMULATED_BENCH = "bench"
MUST_HAVE = {PROCEDURES: ("title", "steps", "parameters", "evaluate_run")}
"""What every entry of a group has; something else that a package offers there is refused."""
OURS = "station."
OWN = (*NAMES, "station")
"""Where the modules of the station's own entries are."""
LOADS_WITHIN_S = 10.0
"""Real time in which another package has to be imported."""


@lru_cache
def offers() -> tuple[dict[str, dict[str, EntryPoint]], tuple[str, ...]]:
    """Return all entry points by group and name, and a sentence on each package that is odd.

    Of two that have one name, the station's own counts, else that of the package which Python
    finds first.
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
            known = groups.setdefault(entry.group, {})
            first, other = known.setdefault(entry.name, entry), entry
            if is_own(entry) and not is_own(first):
                first, other = entry, first
                known[entry.name] = entry
            if is_own(first) and not is_own(other):
                doubled.append(
                    f"the {kind_in(entry.group)} '{entry.name}' is the station's own; that of the "
                    f"package {name_of(other.dist)} is left out: rename it there, or remove that "
                    "package"
                )
            elif name_of(first.dist) != name_of(package):
                doubled.append(
                    f"the {kind_in(entry.group)} '{entry.name}' is offered by two packages, "
                    f"{name_of(first.dist)}, which is taken, and {name_of(package)}; rename it in "
                    "one of them, or remove that package"
                )
    if odd:
        have_none_where_unreadable()
    return groups, (*odd, *doubled)


def is_own(entry: EntryPoint) -> bool:
    """Whether an entry is the station's own, and not that of a package which only says so."""
    return entry.module.split(".")[0] in OWN and name_of(entry.dist) == DISTRIBUTION


def own_names(group: str) -> list[str]:
    """Return the names of the station's own entries of a group, whatever else is installed."""
    return sorted(name for name, entry in offers()[0].get(group, {}).items() if is_own(entry))


def package_of(group: str, name: str) -> str:
    """Return name and version of the package that offers an entry; empty for no entry."""
    entry = offers()[0].get(group, {}).get(name)
    if entry is None or entry.dist is None:
        return ""
    try:
        version = str(entry.dist.version)
    except Exception:  # metadata that anybody may have written
        version = "of an unknown version"
    return f"{name_of(entry.dist)} {version}"


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


@lru_cache
def name_of(package: Distribution | None) -> str:
    """Return the name of a package, its folder's where its metadata gives none.

    Python parses the whole metadata, with the text on the package, whenever it is asked.
    """
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
        raise InputError(meant(*not_there(f"there is no {kind} '{name}'", name, names(group))))
    try:
        loaded, failed = (entry.load(), None) if is_own(entry) else _loaded_beside(entry)
        if failed is None:
            _refuse_other(group, kind, loaded)
            return loaded
    except Exception as error:  # whatever is wrong with what the package offers
        failed = error
    raise InputError(
        f"the {kind} {name!r} of the package {name_of(entry.dist)} cannot be loaded from "
        f"{entry.value} ({reason_of(failed)}); install what the package needs, repair it or "
        "remove it"
    ) from failed


_hanging: dict[str, Thread] = {}
"""The threads in which modules are still being imported, after all that time."""


def _loaded_beside(entry: EntryPoint) -> tuple[Any, BaseException | None]:
    """Return what another package offers, or what keeps it from being loaded.

    It is imported in a thread of its own: there Ctrl-C of a person cannot be meant by a
    KeyboardInterrupt, and one that hangs is given up. It is never tried again while it hangs.
    """
    came: list[tuple[Any, BaseException | None]] = []

    def load_it() -> None:
        try:
            came.append((entry.load(), None))
        except BaseException as error:  # whatever the package does when it is imported
            came.append((None, error))

    before = _hanging.get(entry.module)
    if before is None or not before.is_alive():
        before = Thread(target=load_it, name=f"import of {entry.module}", daemon=True)
        before.start()
        before.join(LOADS_WITHIN_S)
    if came:
        return came[0]
    _hanging[entry.module] = before
    return None, TimeoutError(f"its import is not done after {LOADS_WITHIN_S:g} s")


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
