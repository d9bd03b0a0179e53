"""The station's own packages of common names, whatever else has the same name.

`drivers`, `procedures`, `sim_instruments` and `config` are looked for beside `station` alone: a
folder of such a name in the present folder, or on the path before it, hides none of them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]
NAMES = ("drivers", "procedures", "sim_instruments", "config")
DISTRIBUTION = "inertial-station"
MARK = f'DISTRIBUTION = "{DISTRIBUTION}"'
"""Stands in the `__init__.py` of each of them."""
APART = "install one of the two in an environment of its own"


class OwnPackages(MetaPathFinder):
    """Find the station's own packages beside `station`, before any path is searched."""

    @staticmethod
    def find_spec(
        fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where one of `NAMES` is; None leaves every other name to others."""
        return PathFinder.find_spec(fullname, [str(ROOT)]) if fullname in NAMES else None


def take_precedence() -> None:
    """Have the station's own packages imported under their names from now on."""
    if not any(isinstance(finder, OwnPackages) for finder in sys.meta_path):
        sys.meta_path.insert(0, OwnPackages())


def why_broken(root: Path = ROOT) -> str | None:
    """Return which of the station's own packages another one has replaced, None where none is."""
    for name in NAMES:
        first = root / name / "__init__.py"
        try:
            ours = MARK in first.read_text(encoding="utf-8")
        except (OSError, ValueError):
            ours = False
        if not ours:
            return (
                f"{first} is not that of Inertial Station: another package has installed a package "
                f"`{name}` over it, or removed it; reinstall {DISTRIBUTION}, and {APART}"
            )
        loaded = getattr(sys.modules.get(name), "__file__", None)
        if loaded is not None and Path(loaded).resolve() != first.resolve():
            return (
                f"this program has imported another package `{name}` ({loaded}) before Inertial "
                "Station; import `station` first, or rename the other one"
            )
    return None


def clashes(root: Path = ROOT) -> Iterator[str]:
    """Yield a sentence on each other package that is installed under a name of the station's.

    A folder beside the user is none. The station works; the other package may not.
    """
    for name in NAMES:
        other = PathFinder.find_spec(name)
        place = Path(other.origin).parent if other is not None and other.origin else root / name
        if place.resolve() != root / name and place.parent.resolve() != Path.cwd():
            yield (
                f"another package `{name}` is installed in {place.parent}; Inertial Station uses "
                f"its own, and what needs the other one finds no part of it here: {APART}"
            )
    yield from _mixed(root)


def _mixed(root: Path) -> Iterator[str]:
    """Yield a sentence on each package of the station's that holds files of another package."""
    ours = _installed_files(root)
    for name in NAMES if ours else ():
        foreign = sorted(
            path.relative_to(root).as_posix()
            for path in (root / name).rglob("*.py")
            if path.relative_to(root).as_posix() not in ours
        )
        if foreign:
            yield (
                f"another package has installed {foreign[0]}"
                f"{f' and {len(foreign) - 1} more files' if len(foreign) > 1 else ''} into the "
                f"package `{name}` of Inertial Station in {root}: each may have replaced files of "
                f"the other; reinstall {DISTRIBUTION}, and {APART}"
            )


def _installed_files(root: Path) -> frozenset[str]:
    """Return what the installed distribution lists below `root`; nothing in a checkout."""
    for record in root.glob(f"{DISTRIBUTION.replace('-', '_')}-*.dist-info/RECORD"):
        lines = record.read_text(encoding="utf-8").splitlines()
        return frozenset(line.split(",")[0] for line in lines)
    return frozenset()
