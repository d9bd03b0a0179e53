"""Notes of tripped interlocks that every user of the computer finds, a file for each instrument.

They stand in a fixed place of the system where there is one, else in the user's own state folder;
all places are read. A note only refuses, so that one which somebody forged is a nuisance and no
danger. Nobody deletes one: `station acknowledge` writes who acknowledged it beside it.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

FOLDER = "trips"
EVERYBODY = 0o1777
"""As /tmp: everybody may add, nobody removes what belongs to another."""
READABLE = 0o644
LARGEST_BYTES = 1 << 16
ACKNOWLEDGED = ".acknowledged"
LOOKED_INTO = 0o755
BY_DESCRIPTOR = os.open in os.supports_dir_fd
"""Not on Windows, where a user makes no links for others either."""
NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)

WAY = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | NO_LINK


def system_places() -> tuple[Path, ...]:
    """Return where this computer keeps what holds for all of its users, best first.

    The first needs an administrator to make it, once; anybody can make the second.
    """
    if sys.platform == "win32":
        return (Path(os.environ.get("PROGRAMDATA", r"C:\ProgramData")) / "inertial-station",)
    return (Path("/var/lib/inertial-station"), Path("/var/tmp/inertial-station"))


def digest(key: str) -> str:
    """Return what stands for a key in the name of a file."""
    return hashlib.sha256(key.encode()).hexdigest()[:24]


def address_key(address: str) -> str:
    """Return the key of an instrument's address, however it is written."""
    return f"address {address.strip().lower().replace('localhost', '127.0.0.1')}"


def identity_key(model: str, serial: str) -> str | None:
    """Return the key of what an instrument says of itself; None where it says no serial number."""
    number = serial.strip().lower()
    if not any(digit in "123456789" for digit in number):
        return None
    return f"identity {model.strip().lower()} {number}"


@dataclass(frozen=True)
class TripNote:
    """A trip as it stands in a place: its id, its text, None where it cannot be read."""

    place: Path
    trip: str
    text: str | None


def find(places: tuple[Path, ...], keys: list[str]) -> Iterator[TripNote]:
    """Yield every note on one of these keys that nobody has acknowledged."""
    wanted = {digest(key) for key in keys}
    for place in places:
        try:
            with opened(place / FOLDER) as folder:
                names = sorted(folder.names())
                done = {name.removesuffix(ACKNOWLEDGED) for name in names if ACKNOWLEDGED in name}
                for name in names:
                    of, _, rest = name.partition("-")
                    trip, is_note, _ = rest.partition(".json")
                    if of in wanted and is_note and trip not in done:
                        yield TripNote(place, trip, folder.read(name))
        except OSError:
            continue  # a place that is not there, or may not be read


def write(places: tuple[Path, ...], keys: list[str], trip: str, text: str) -> Path:
    """Note a trip on these keys in the first place that takes it; raises OSError if none does."""
    failed: OSError | None = None
    for place in places:
        try:
            make(place)
            with opened(place / FOLDER) as folder:
                for key in keys:
                    folder.write(f"{digest(key)}-{trip}.json", text)
            return place
        except OSError as error:
            failed = failed or error
    raise failed or FileNotFoundError("there is no place for it")


def acknowledge(note: TripNote, text: str) -> None:
    """Write beside a note who acknowledged its trip; raises OSError."""
    with opened(note.place / FOLDER) as folder, suppress(FileExistsError):
        folder.write(f"{note.trip}{ACKNOWLEDGED}", text)


def make(place: Path) -> None:
    """Make a place and its folder where they are missing; raises OSError."""
    shared = place in system_places()
    with suppress(FileExistsError):
        place.mkdir(parents=not shared)
    if not BY_DESCRIPTOR:
        (place / FOLDER).mkdir(exist_ok=True)
        return
    inside = os.open(place, WAY)
    try:
        os.mkdir(FOLDER, dir_fd=inside)
        if shared and os.fstat(inside).st_uid == os.getuid():
            os.fchmod(inside, LOOKED_INTO)
    except FileExistsError:
        return
    finally:
        os.close(inside)
    if shared:
        with opened(place / FOLDER) as folder:
            folder.open_to_everybody()


@contextmanager
def opened(folder: Path) -> Iterator[Folder]:
    """Open a folder of notes; no link from its place to a file is followed; raises OSError."""
    if not BY_DESCRIPTOR:
        yield Folder(folder, None)
        return
    place = os.open(folder.parent, WAY)
    try:
        inside = os.open(folder.name, WAY, dir_fd=place)
    finally:
        os.close(place)
    try:
        yield Folder(folder, inside)
    finally:
        os.close(inside)


@dataclass(frozen=True)
class Folder:
    """An open folder of notes."""

    path: Path
    descriptor: int | None

    def names(self) -> list[str]:
        """Return the names of the files in it."""
        with os.scandir(self.path if self.descriptor is None else self.descriptor) as entries:
            return [entry.name for entry in entries]

    def read(self, name: str) -> str | None:
        """Return a file's text; None where it is none that can be read."""
        try:
            file = self._open(name, os.O_RDONLY)
        except OSError:
            return None
        try:
            if not stat.S_ISREG(os.fstat(file).st_mode):
                return None
            return os.read(file, LARGEST_BYTES).decode("utf-8", "replace")
        except OSError:
            return None
        finally:
            os.close(file)

    def write(self, name: str, text: str) -> None:
        """Write a new file that everybody can read; raises OSError, also where it is there."""
        file = self._open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
        try:
            os.write(file, text.encode())
            if hasattr(os, "fchmod"):
                os.fchmod(file, READABLE)
        finally:
            os.close(file)

    def open_to_everybody(self) -> None:
        """Let everybody add to it, and nobody remove what belongs to another; raises OSError."""
        if self.descriptor is not None:
            os.fchmod(self.descriptor, EVERYBODY)

    def _open(self, name: str, flags: int) -> int:
        if self.descriptor is None:
            return os.open(self.path / name, flags | NO_LINK, READABLE)
        return os.open(name, flags | NO_LINK, READABLE, dir_fd=self.descriptor)


def whole(text: str | None) -> dict[str, object] | None:
    """Return the data of a note, None where it is damaged."""
    try:
        data = json.loads(text or "")
    except ValueError:
        return None
    return data if isinstance(data, dict) else None
