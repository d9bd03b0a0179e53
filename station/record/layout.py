"""A run folder: its names, its making, its manifest, its lock, and the software it was made with.

It is whole from its first moment, whatever happens while it is made.
"""

from __future__ import annotations

import hashlib
import json
import platform
import shutil
import socket
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from station import __version__
from station.errors import DamagedRecord, RecordError
from station.files.locks import FileLock
from station.record.files import (
    A_COPY,
    ANOTHER_DISK,
    READ_ONLY,
    not_written,
    sync_folder,
    write_whole_file,
)

EVENTS = "events.jsonl"
RAW = "raw"
RUN = "run.json"
REVISIONS = "revisions"
EXPORTS = "exports"
"""What is made of a run, in no manifest: nobody needs a copy of it."""
GUARDIAN_LOG = "guardian.jsonl"
PLAN, BENCH = "plan.resolved.yaml", "bench.resolved.yaml"
BENCH_AS_WRITTEN = "bench.yaml"
MAX_OF_ONE_NAME = 1000


def new_folder(parent: Path, name: str) -> Path:
    """Create and return `parent/name`, or `name-2`, `name-3` where that exists already.

    Raises RecordError when the parent cannot be written.
    """
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:  # a file, or a link that leads nowhere
        raise RecordError(
            f"cannot make the folder {parent}: {error.strerror}; choose another place with --output"
        ) from error
    for number in range(1, MAX_OF_ONE_NAME):
        path = parent / numbered(name, number)
        try:
            path.mkdir()
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordError(
                f"cannot create the run folder {path}: {error.strerror}; "
                "choose another place with --output"
            ) from error
        return path
    raise RecordError(f"{parent} holds a thousand runs of this second; choose another --output")


def folder_with_head(parent: Path, name: str, head: Mapping[str, str | bytes]) -> Path:
    """Create `parent/name` that holds `head`, contents by file name, from its first moment on.

    It is built beside its place, under a name that begins with a dot, and then moved there: a run
    that was killed at its very beginning leaves no folder that does not open.
    """
    being_built = new_folder(parent, f".new-{name}")
    try:
        (being_built / RAW).mkdir()
        for file, content in {**head, EVENTS: ""}.items():
            (being_built / file).parent.mkdir(exist_ok=True)
            data = content if isinstance(content, bytes) else content.encode()
            write_whole_file(being_built / file, data)
        place = moved(being_built, parent, name)
        sync_folder(parent)
    except BaseException:
        shutil.rmtree(being_built, ignore_errors=True)
        raise
    return place


def moved(folder: Path, parent: Path, name: str) -> Path:
    """Move a folder to the first free one of `parent/name`, `name-2`, `name-3`."""
    for number in range(1, MAX_OF_ONE_NAME):
        place = parent / numbered(name, number)
        if place.exists():
            continue
        try:
            folder.rename(place)
        except OSError:
            if place.exists():  # another run was faster
                continue
            raise
        return place
    raise RecordError(f"{parent} holds a thousand runs of this second; choose another --output")


def numbered(name: str, number: int) -> str:
    """Return `name`, `name-2`, `name-3` …"""
    return name if number == 1 else f"{name}-{number}"


def raw_file(folder: Path, source: str, segment: int) -> Path:
    """Return the raw file of a source that one process of a run writes."""
    return folder / RAW / f"{source}-{segment:03d}.mcap"


def next_segment(raw: Path) -> int:
    """Return the number after those of the raw files that are there, 0 where there are none."""
    numbers = [int(path.stem.rpartition("-")[2]) for path in raw.glob("*-[0-9][0-9][0-9].mcap")]
    return max(numbers, default=-1) + 1


MANIFEST = "manifest.json"
LOCK = "run.lock"
SIGNATURES = "signatures"
CERTIFICATES = "certificates"
DRAFT = ".new-"
"""How the name begins of what is not whole yet: a revision, a certificate. It is neither."""
NOT_COVERED = (EXPORTS, REVISIONS, SIGNATURES, LOCK)
"""Remade reports are no evidence; each revision has a manifest of its own; the lock is empty."""


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def covered_files(folder: Path) -> dict[str, str]:
    """Return the files that a folder's manifest names, with their SHA-256; none without one.

    Raises DamagedRecord where the manifest itself cannot be read.
    """
    manifest = folder / MANIFEST
    if not manifest.is_file():
        return {}
    try:
        files = json.loads(manifest.read_text(encoding="utf-8"))["files"]
        right = all(isinstance(digest, str) for digest in files.values())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        right = False
    if not right:
        raise DamagedRecord(f"{manifest} was altered: it is no list of files with their SHA-256")
    return dict(files)


def hashes_of_files(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of what a manifest of `folder` covers: relative paths with `/`, in order.

    What is no plain file is left out.
    """
    return {
        path.relative_to(folder).as_posix(): file_hash(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
        and path.name != MANIFEST
        and path.relative_to(folder).parts[0] not in NOT_COVERED
        and not is_draft(path.relative_to(folder).as_posix())
    }


def is_draft(name: str) -> bool:
    """Whether a file of a run folder is a certificate that was not issued to its end."""
    return name.startswith(f"{CERTIFICATES}/{DRAFT}")


def issued_file(folder: Path, name: str) -> Path:
    """Return where a file of a run folder is, a certificate also where its issue was killed."""
    file = folder / name
    draft = file.with_name(f"{DRAFT}{file.name}")
    return draft if name.startswith(f"{CERTIFICATES}/") and not file.exists() else file


def write_manifest(
    folder: Path, files: Mapping[str, str] | None = None, otherwise: str = ANOTHER_DISK
) -> None:
    """Write the manifest of `folder`, of its files as they are unless their SHA-256 are given."""
    files = hashes_of_files(folder) if files is None else files
    write_whole_file(folder / MANIFEST, manifest_text(files).encode(), otherwise)


def manifest_text(files: Mapping[str, str]) -> str:
    """Return a manifest as it is written, to the byte."""
    return f"{json.dumps({'algorithm': 'sha256', 'files': files}, indent=1)}\n"


class Presence:
    """A folder as it was when this began; raises OSError where there is none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._identity = self._seen()

    def check(self) -> None:
        """Raise RecordError where another folder, or none, is at its place."""
        try:
            if self._seen() == self._identity:
                return
        except OSError:
            pass
        raise RecordError(
            f"the run folder {self._path} was removed, moved or unmounted while the run went on; "
            "what was recorded is in it, wherever it is now"
        )

    def cause_of(self, error: Exception) -> Exception:
        """Return why something failed: a file that cannot be read may be gone with its folder."""
        if isinstance(error, OSError):
            try:
                self.check()
            except RecordError as gone:
                return gone
        return error

    def _seen(self) -> tuple[int, int]:
        facts = self._path.stat()
        return facts.st_dev, facts.st_ino


def run_lock(folder: Path) -> FileLock:
    """Take the lock that says that a process is at work on a run; raises RecordError."""
    try:
        return FileLock(folder / LOCK)
    except OSError as error:
        if error.errno in READ_ONLY:
            raise not_written(folder / LOCK, error, A_COPY) from error
        raise RecordError(
            f"cannot lock {folder / LOCK}: {error.strerror or error}; choose another place, on a "
            "local disk, with --output"
        ) from error


PACKAGES = (
    "numpy",
    "scipy",
    "GTC",
    "mcap",
    "pydantic",
    "pyvisa",
    "pyvisa-py",
    "python-can",
)


def versions() -> dict[str, Any]:
    """Return host, interpreter, package versions and, in a checkout, the git commit."""
    return {
        "host": socket.gethostname(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        "station": __version__,
        "packages": {name: package_version(name) for name in PACKAGES},
        "git_commit": git_commit(),
    }


@cache
def package_version(name: str) -> str | None:
    """Return the installed version of a package, None where it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def git_commit() -> str | None:
    """Return the commit of the checkout this code runs from, None outside one."""
    try:
        done = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
