"""A tripped interlock is remembered until a person has acknowledged it.

On a real bench it is remembered for the instruments, by their addresses and by what they say of
themselves, whatever bench file names them and whoever runs it. The instruments of a simulated bench
have no fixed addresses and one set of serial numbers: there it is remembered for the user and the
bench file.
"""

from __future__ import annotations

import getpass
import hashlib
import json
import os
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from station.clock import utc_now
from station.errors import NotAcknowledged
from station.files.faults import FaultList
from station.files.yaml.reading import read_yaml
from station.safety import trip_notes
from station.safety.trip_notes import TripNote, address_key, identity_key, system_places

APPLICATION = "inertial-station"
HISTORY = "acknowledged.jsonl"
TRIPPED = "tripped"
WITNESS = "witness"
"""In the place of an interlock: a second instrument contradicts a source that says it is off."""


@dataclass(frozen=True)
class Trip:
    """What tripped on a bench, when (UTC) and in which run folder."""

    bench: str
    interlock: str
    message: str
    tripped_utc: str
    run: str


def state_folder() -> Path:
    """Return the folder of what the station remembers between runs, for this user.

    `XDG_STATE_HOME` where it is set, else the place that the system has for it.
    """
    given = os.environ.get("XDG_STATE_HOME")
    if given:
        return Path(given) / APPLICATION
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA")
        return (Path(local) if local else Path.home() / "AppData" / "Local") / APPLICATION
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / APPLICATION
    return Path.home() / ".local" / "state" / APPLICATION


def places() -> tuple[Path, ...]:
    """Return every place in which a trip of instruments may be noted, the first to be used first.

    The user's own stands last: it is where no place of the system can be written.
    """
    return (*system_places(), state_folder())


def place_of(bench: Path) -> Path:
    """Return the file that remembers a trip for a user and this bench file."""
    whole = str(bench.resolve())
    digest = hashlib.sha256(whole.encode()).hexdigest()[:12]
    return state_folder() / TRIPPED / f"{bench.stem}-{digest}.json"


def addresses_in(bench: Path) -> list[str]:
    """Return the addresses in a bench file as far as it can be read, whatever else is wrong."""
    try:
        data = read_yaml(bench).data
        if data.get("simulation") is not None:
            return []
        entries = dict(data["instruments"]).values()
        return [str(entry["address"]) for entry in entries if entry.get("address")]
    except (FaultList, OSError, LookupError, TypeError, ValueError, AttributeError):
        return []


def remember(
    bench: Path,
    name: str,
    message: str,
    run: Path,
    instruments: Mapping[str, tuple[str, str]] | None = None,
) -> None:
    """Remember that the bench may not be used until somebody has looked; raises OSError.

    `instruments` are those of a real bench that this concerns: address to model and serial number,
    as they state them. None remembers it for the bench file.
    """
    place = place_of(bench)
    keys = list(keys_of(instruments or {}))
    if not keys and place.exists():  # what nobody has acknowledged yet stays
        earlier = read_note(place).message
        message = earlier if message in earlier else f"{earlier}; {message}"
    tripped = Trip(
        str(bench.resolve()),
        name,
        message,
        utc_now().isoformat(timespec="seconds"),
        str(run.resolve()),
    )
    text = json.dumps(asdict(tripped), indent=1, ensure_ascii=False) + "\n"
    if keys:
        trip_notes.write(places(), keys, trip_notes.digest(text), text)
        return
    place.parent.mkdir(parents=True, exist_ok=True)
    being_written = place.with_suffix(".new")
    being_written.write_text(text, encoding="utf-8")
    being_written.replace(place)


def keys_of(instruments: Mapping[str, tuple[str, str]]) -> Iterator[str]:
    """Yield the keys of instruments: address to model and serial number."""
    for address, (model, serial) in instruments.items():
        if address:
            yield address_key(address)
        identity = identity_key(model, serial)
        if identity is not None:
            yield identity


def trip_in(text: str | None, where: Path) -> Trip:
    """Return the trip of a note; one that cannot be read is still a note."""
    names = [field.name for field in fields(Trip)]
    data = trip_notes.whole(text)
    if data is None or not set(names) <= set(data):
        return Trip("", "unknown", f"a trip whose note in {where} cannot be read", "", "")
    return Trip(**{name: str(data[name]) for name in names})


def notes_of_file(bench: Path) -> list[Path]:
    """Return what remembers a trip of this bench file, by whatever name it was run."""
    own = place_of(bench)
    notes = [own] if own.exists() else []
    for other in sorted(own.parent.glob("*.json")) if own.parent.is_dir() else ():
        with suppress(OSError):
            named = trip_in(other.read_text(encoding="utf-8", errors="replace"), other).bench
            if other != own and named and bench.samefile(named):
                notes.append(other)
    return notes


def read_note(note: Path) -> Trip:
    """Return the trip of a bench file's note."""
    try:
        return trip_in(note.read_text(encoding="utf-8", errors="replace"), note)
    except OSError:
        return trip_in(None, note)


def notes_of_instruments(addresses: Collection[str]) -> list[TripNote]:
    """Return the notes that nobody has acknowledged on what is at these addresses."""
    return list(trip_notes.find(places(), [address_key(address) for address in addresses]))


def unacknowledged(bench: Path, addresses: Collection[str] = ()) -> Trip | None:
    """Return the trip on a bench file, or on these addresses, that nobody has acknowledged."""
    for path in notes_of_file(bench):
        return read_note(path)
    for note in notes_of_instruments(addresses):
        return trip_in(note.text, note.place)
    return None


def refuse_until_acknowledged(bench: Path, addresses: Collection[str] = ()) -> None:
    """Raise NotAcknowledged where an interlock has tripped on this bench and nobody has looked."""
    trip = unacknowledged(bench, addresses)
    if trip is not None:
        raise refusal(bench, trip)


def refuse_identified(bench: Path, instruments: Mapping[str, tuple[str, str]]) -> None:
    """Raise NotAcknowledged where one of these instruments tripped at another address.

    `instruments`: address to model and serial number. The trip is noted for the address too, so
    that the bench can be acknowledged by this file.
    """
    for address, identity in instruments.items():
        key = identity_key(*identity)
        for note in trip_notes.find(places(), [key] if key else []):
            trip = trip_in(note.text, note.place)
            with suppress(OSError):
                trip_notes.write((note.place,), [address_key(address)], note.trip, note.text or "")
            raise refusal(bench, trip)


def refusal(bench: Path, trip: Trip) -> NotAcknowledged:
    """Return the error of a bench that may not be used."""
    elsewhere = trip.bench and trip.bench != str(bench.resolve())
    by = f", on the same instruments by {trip.bench}" if elsewhere else ""
    return NotAcknowledged(
        f"the bench {bench.stem} may not be used, nothing was opened or energised: "
        f"{trip.message} ({trip.tripped_utc}, {trip.run}{by}); find the cause, then "
        f"`station acknowledge {bench}`"
    )


def acknowledge(bench: Path, addresses: Collection[str] = ()) -> Trip | None:
    """Take back the refusal of a bench and note who did so; None where nothing had tripped.

    Raises OSError where that cannot be written.
    """
    files = notes_of_file(bench)
    notes = notes_of_instruments(addresses)
    trips = [*map(read_note, files), *(trip_in(note.text, note.place) for note in notes)]
    if not trips:
        return None
    lines = [acknowledgement(trip) for trip in dict.fromkeys(trips)]
    state_folder().mkdir(parents=True, exist_ok=True)
    with (state_folder() / HISTORY).open("a", encoding="utf-8") as history:
        history.writelines(f"{line}\n" for line in lines)
    for path in files:
        path.unlink(missing_ok=True)
    for note in {note.trip: note for note in notes}.values():
        trip_notes.acknowledge(note, acknowledgement(trip_in(note.text, note.place)) + "\n")
    return trips[0]


def acknowledgement(trip: Trip) -> str:
    """Return a trip, and who acknowledges it now, as a line of JSON."""
    line: dict[str, Any] = {
        **asdict(trip),
        "acknowledged_utc": utc_now().isoformat(timespec="seconds"),
        "by": user_name(),
    }
    return json.dumps(line, ensure_ascii=False)


def user_name() -> str:
    """Return the name of the system's user, or nothing where it has none."""
    try:
        if os.name == "posix":  # an environment variable names whom it likes
            import pwd

            return pwd.getpwuid(os.getuid()).pw_name
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return ""
