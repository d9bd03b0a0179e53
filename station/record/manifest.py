"""manifest.json: the SHA-256 of every file of a run folder but itself."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from station.errors import DamagedRecord
from station.record.files import write_whole_file

MANIFEST = "manifest.json"
LOCK = "run.lock"
NOT_COVERED = ("exports", "revisions", LOCK)
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


def write_manifest(folder: Path) -> None:
    """Write the manifest of `folder`: relative paths with `/`, in order."""
    files = {
        path.relative_to(folder).as_posix(): file_hash(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
        and path.name != MANIFEST
        and path.relative_to(folder).parts[0] not in NOT_COVERED
    }
    text = json.dumps({"algorithm": "sha256", "files": files}, indent=1)
    write_whole_file(folder / MANIFEST, f"{text}\n".encode())
