"""Find a plan, a bench or data: a path, then `./config`, then what the package brings along."""

from __future__ import annotations

import errno
import stat
from collections.abc import Iterable
from contextlib import suppress
from importlib.resources import files
from pathlib import Path

from station.files.faults import Fault, FaultList, nearest, not_there

PLANS = "plans"
BENCHES = "benches"
_ONE = {PLANS: "plan", BENCHES: "bench"}
_SUFFIX = ".yaml"
NO_FILE = "is a pipe or a device, not a file"


def find(kind: str, name: str, suffix: str = _SUFFIX) -> Path:
    """Return the file of a plan or bench, given as a path or by name, with or without its suffix.

    `kind` is the folder of `config` that holds what has a name. Raises FaultList: of a path, that
    it does not exist; of a name, what was probably meant and what there is.
    """
    as_path = Path(name)
    if is_there(as_path):
        return as_path
    known = _known(kind, suffix)
    wanted = name.removesuffix(suffix)
    if wanted in known:
        return known[wanted]
    wrong = in_place_of_file(as_path)
    if wrong or len(as_path.parts) > 1 or as_path.suffix[1:].isalpha():
        what, hint = wrong or _no_path(as_path), _meant(as_path, known)
    else:
        what = f"there is no such {_ONE.get(kind, 'file')}, neither as a file nor by name"
        what, hint = not_there(what, name, known)
    raise FaultList([Fault(name, 1, 1, "file", what, hint)])


def _no_path(path: Path) -> str:
    """Return what is missing of a path."""
    there = in_place_of_file(path.parent) is not None
    return "the path does not exist" + ("" if there else f": there is no folder {path.parent}")


def _meant(path: Path, known: Iterable[str]) -> str | None:
    """Return the file beside a path that is not there, or else the name, that was meant."""
    beside: dict[str, Path] = {}
    with suppress(OSError, ValueError):
        beside = {file.name: file for file in path.parent.glob(f"*{path.suffix}") if is_there(file)}
    near = nearest(path.name, beside)
    hint = str(beside[near]) if near else nearest(path.stem, known)
    return hint and f"'{hint}'"


def is_there(path: Path) -> bool:
    """Whether a path is that of a file; a name that no file system takes is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_missing(path: Path) -> bool:
    """Whether nothing stands at a path; where this user may not look, something may."""
    try:
        path.lstat()
    except ValueError:  # a name with a NUL
        return True
    except OSError as error:
        return error.errno in (errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG)
    return False


def in_place_of_file(path: Path) -> str | None:
    """Return what stands where a file should be and is none; None where there is nothing."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:  # a name with a NUL is a ValueError
        if getattr(error, "errno", None) == errno.ELOOP:
            return "is a link that leads to itself"
        return "is a link that leads nowhere" if is_link(path) else None
    if stat.S_ISREG(mode):
        return None
    return "is a folder, not a file" if stat.S_ISDIR(mode) else NO_FILE


def is_link(path: Path) -> bool:
    """Whether a path is that of a link; a name that no file system takes is none."""
    try:
        return path.is_symlink()
    except (OSError, ValueError):
        return False


def available(kind: str) -> list[tuple[str, str]]:
    """Return the names of all plans or benches and the place of each."""
    own = Path("config", kind)
    return [
        (name, str(path) if path.parent == own else "comes with the station")
        for name, path in sorted(_known(kind).items())
    ]


def _known(kind: str, suffix: str = _SUFFIX) -> dict[str, Path]:
    """Return the files by name; one in `./config` hides one of the package."""
    packaged = Path(str(files("config"))) / kind
    paths: dict[str, Path] = {}
    for folder in (packaged, Path("config", kind)):
        paths.update({path.stem: path for path in sorted(folder.glob(f"*{suffix}"))})
    return paths
