"""One run per instrument: locks on each instrument's address, and on who it says it is.

Every user of the computer finds the same locks, whatever bench file an address stands in.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from station.errors import InstrumentError, InstrumentInUse
from station.files.locks import FileLock, LockHeld, remove_if_free
from station.instruments.addresses import forms_of
from station.roles.base import UNTOLD

PREFIX = "inertial-station"
PLACES = ("/run/lock", "/tmp", "/var/tmp")
NO_SERIAL = "0-. /?"
"""What a serial number that says nothing is made of."""


def lock_folder() -> Path:
    """Return the folder of the system in which every user may put locks and remove only its own.

    It is the same for every user and whatever the environment says.
    """
    if sys.platform == "win32":
        return Path(os.environ.get("PROGRAMDATA", "C:\\ProgramData"))
    for place in PLACES:
        about = Path(place).stat() if Path(place).is_dir() else None
        if about and about.st_uid == 0 and about.st_mode & stat.S_ISVTX and about.st_mode & 0o002:
            return Path(place)
    return Path(PLACES[1])


def lock_place(what: str) -> Path:
    """Return the file whose lock stands for something."""
    digest = hashlib.sha256(what.encode()).hexdigest()[:24]
    return lock_folder() / f"{PREFIX}-{digest}.lock"


class Identity(Protocol):
    """Who answered: maker, model, serial number and firmware, as the instrument says them."""

    maker: str
    model: str
    serial: str
    firmware: str


class InstrumentLocks:
    """The instruments that this process has; instruments on one bus share its lock.

    `holder` is what another process reads of this one. `world` sets the instruments of a served
    simulated bench apart from those of another, at the same port or with the same serial number.
    """

    def __init__(self, holder: str, world: str = "") -> None:
        self._holder = holder
        self.world = world
        self._held: dict[Path, FileLock] = {}
        self._addresses: set[str] = set()

    def take(self, name: str, address: str) -> None:
        """Take the instrument at an address, until `release` or until this process ends.

        Raises InstrumentError, before any byte is sent to it, where another process has it.
        """
        if address not in self._addresses:
            for form in sorted(forms_of(address)):
                self._take(name, f"take {address}", self._here(form))
            self._addresses.add(address)

    def take_identity(self, name: str, identity: Identity) -> None:
        """Take the instrument that reports this identity, whatever way it is reached.

        Raises InstrumentError where another process has it. One without a serial number cannot be
        distinguished from others like it.
        """
        if identity.serial != UNTOLD and identity.serial.strip(NO_SERIAL):
            who = " ".join(f"{identity.maker} {identity.model} {identity.serial}".split())
            self._take(name, f"take {who}", self._here(f"identity {who.lower()}"))

    def _here(self, what: str) -> str:
        """Return what a lock stands for in this world: a port may be another bench's tomorrow."""
        return f"{what} {self.world}".rstrip()

    def to_hand_on(self) -> Iterator[tuple[list[str], list[int]]]:
        """Yield what is held for `handed_on` in another process: names and open files."""
        for place, lock in self._held.items():
            yield [str(place), *sorted(self._addresses)], lock.files

    def handed_on(self, names: list[str], files: list[int]) -> None:
        """Hold a lock, too, that another process has handed on."""
        place, *addresses = names
        if Path(place) in self._held:
            FileLock.handed_on(Path(place), files).release()  # it came before
        else:
            self._held[Path(place)] = FileLock.handed_on(Path(place), files)
        self._addresses.update(addresses)

    def say(self, holder: str) -> None:
        """Let others read from now on who holds the locks."""
        self._holder = holder
        for lock in self._held.values():
            lock.say(f"{holder}\n")

    def holds(self, address: str) -> bool:
        """Whether this process has what is at an address."""
        return address in self._addresses or any(
            lock_place(self._here(form)) in self._held for form in forms_of(address)
        )

    def release(self) -> None:
        """Give all of them back."""
        for lock in self._held.values():
            lock.release()
        self._held.clear()
        self._addresses.clear()
        remove_leftovers()

    def _take(self, name: str, attempted: str, what: str) -> None:
        place = lock_place(what)
        if place in self._held:
            return
        try:
            self._held[place] = FileLock(place, everybody=True)
        except LockHeld as error:
            raise InstrumentInUse(name, attempted, said_by_holder(place)) from error
        except OSError as error:
            raise InstrumentError(
                name,
                attempted,
                f"its lock {place} cannot be had ({error.strerror or error})",
                "look at who made that file, and remove it",
            ) from error
        self._held[place].say(f"{self._holder}\n")


def remove_leftovers() -> None:
    """Remove the files of locks whose processes were killed."""
    for place in lock_folder().glob(f"{PREFIX}-*.lock"):
        remove_if_free(place)


def said_by_holder(place: Path) -> str:
    """Return what the holder of a lock says of itself, if anything."""
    try:
        with place.open(encoding="utf-8", errors="replace") as file:
            return file.read(1000).strip()
    except OSError:
        return ""
