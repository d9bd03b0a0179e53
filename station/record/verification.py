"""The state of a run folder, by its path: for whoever lists, shows or proves runs."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from station.errors import DamagedRecord, InputError, NotPermitted, StationError
from station.files.locks import is_held
from station.files.lookup import is_missing
from station.record.files import is_own_file
from station.record.folder import RESULTS, RunFolder
from station.record.integrity import QUICK, WHOLE, FolderState, differs, state_of
from station.record.layout import (
    EVENTS,
    LOCK,
    MANIFEST,
    REVISIONS,
    SIGNATURES,
    covered_files,
)
from station.record.signatures import States

REMEMBERED = 5000


def verify(folder: Path, *, whole: bool = True) -> FolderState:
    """Return what state a run folder is in, to its last byte or by a quick look.

    `exports/` and the lock are left out: they are no evidence. Raises InputError for what is no run
    folder, for the whole of a run that is going on, and where this user may not read it.
    """
    if not is_own_file(folder / EVENTS) and not is_own_file(folder / MANIFEST):
        no_run = f"{folder} is no run folder: it holds no {EVENTS}"
        raise InputError(f"the path {folder} does not exist" if is_missing(folder) else no_run)
    if whole and is_held(folder / LOCK):
        raise InputError(f"{folder} is being run; verify it once it has ended")
    try:
        return state_of(RunFolder(folder), whole=whole)
    except NotPermitted:
        raise
    except PermissionError as error:
        raise NotPermitted(error.filename or folder) from error
    except (StationError, OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        why = str(error) if isinstance(error, StationError) else f"{folder}: {error}"
        return FolderState(folder, WHOLE if whole else QUICK, altered=(why,))


def quick_look(folder: Path) -> FolderState:
    """Return what state a run folder is in by a quick look, made again where a file was written."""
    if is_held(folder / LOCK):
        return FolderState(folder, QUICK, going_on=True)
    looked_at = (EVENTS, MANIFEST, RESULTS, REVISIONS, SIGNATURES)
    return _quick_look(folder, tuple(_stamp(folder / name) for name in looked_at))


def was_in(folder: Path, head: str) -> bool:
    """Whether a run folder was in the state that a line of its log or a manifest stands for.

    `head` is that one's SHA-256. What the log says was done since is no matter.
    """
    try:
        run = RunFolder(folder)
        return States(folder, run.events, state_of(run, whole=False).heads).after(head) is not None
    except StationError:
        return False


def refuse_unproven(folder: Path, *files: str) -> None:
    """Raise DamagedRecord where what a run has left cannot be shown as its own.

    That is a folder that was altered, one that has no manifest, and any of `files` that is not the
    one of the manifest. A run that goes on has not left it yet.
    """
    state = quick_look(folder)
    if state.unproven:
        raise DamagedRecord(f"{folder.name}: {state.sentence()}")
    listed = covered_files(folder)
    for name in files:
        if name in listed and (difference := differs(folder, name, listed[name])):
            raise DamagedRecord(f"{difference}; `station verify {folder.name}` names all")


@lru_cache(maxsize=REMEMBERED)
def _quick_look(folder: Path, stamps: tuple[object, ...]) -> FolderState:
    return verify(folder, whole=False)


def _stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        facts = path.lstat()
    except OSError:
        return None
    return facts.st_mtime_ns, facts.st_ctime_ns, facts.st_size
