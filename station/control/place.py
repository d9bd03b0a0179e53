"""Where a run listens: an address that only its own user can open, and the key that proves it.

A Unix socket and a key file in a folder of mode 0700, or a named pipe on Windows. The name is a
digest of the run folder's path: the address of a Unix socket ends at about a hundred characters.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from station.safety.acknowledgement import APPLICATION, state_folder

LONGEST_ADDRESS = 100
"""Linux takes 107 bytes, macOS 103."""
PRIVATE_FOLDER, PRIVATE_FILE = 0o700, 0o600
OF_OTHERS = 0o077
KEY_BYTES = 32
PIPE = rf"\\.\pipe\{APPLICATION}-"


@dataclass(frozen=True)
class Place:
    """The address of one run's channel, and the file that holds its key."""

    address: str
    family: str
    key_file: Path

    def prepare(self) -> bytes:
        """Make the folder, drop what a dead process left, and return a new key; raises OSError.

        Whoever comes here holds the lock of the run folder: what lies here is nobody's any more.
        """
        make_private(self.key_file.parent)
        self.remove()
        key = secrets.token_bytes(KEY_BYTES)
        handle = os.open(self.key_file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE_FILE)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump({"key": key.hex()}, file)
        return key

    def key(self) -> bytes | None:
        """Return the key of who listens; None where nobody of this user does."""
        try:
            if not is_private(self.key_file.parent):
                return None
            return bytes.fromhex(json.loads(self.key_file.read_text(encoding="utf-8"))["key"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def remove(self) -> None:
        """Remove the files."""
        for path in [self.key_file, *([Path(self.address)] if self.family == "AF_UNIX" else [])]:
            with suppress(OSError):
                path.unlink()


def places(run: Path) -> Iterator[Place]:
    """Yield the places at which a run may listen, the best one first."""
    digest = hashlib.sha256(os.path.normcase(run.resolve()).encode()).hexdigest()[:16]
    for folder in folders():
        key_file = folder / f"{digest}.key"
        if sys.platform == "win32":
            yield Place(PIPE + digest, "AF_PIPE", key_file)
            continue
        address = str(folder / f"{digest}.sock")
        if len(os.fsencode(address)) <= LONGEST_ADDRESS:
            yield Place(address, "AF_UNIX", key_file)


def folders() -> Iterator[Path]:
    """Yield the folders for sockets and keys; a terminal without some variable finds them too."""
    if sys.platform != "win32":
        runtime = os.environ.get("XDG_RUNTIME_DIR")
        known = Path(f"/run/user/{os.getuid()}")
        for parent in dict.fromkeys([*([Path(runtime)] if runtime else []), known]):
            if parent.is_dir():
                yield parent / APPLICATION
    yield state_folder() / "control"
    if sys.platform != "win32":
        yield Path(tempfile.gettempdir()) / f"{APPLICATION}-{os.getuid()}"


def make_private(folder: Path) -> None:
    """Create a folder that only this user can open, or make it one; raises OSError."""
    folder.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
    if sys.platform != "win32" and folder.lstat().st_uid == os.getuid() and not folder.is_symlink():
        folder.chmod(PRIVATE_FOLDER)
    if not is_private(folder):
        raise PermissionError(f"{folder} belongs to another user")


def is_private(folder: Path) -> bool:
    """Whether a folder is this user's and nobody else can open it; raises OSError."""
    if sys.platform == "win32":  # below the user's own profile, which others cannot open
        return folder.is_dir()
    facts = folder.lstat()
    own = stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid()
    return own and not facts.st_mode & OF_OTHERS
