"""A tripped interlock is remembered, bench by bench, until a person has acknowledged it."""

from __future__ import annotations

import getpass
import hashlib
import json
import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from station.clock import utc_now
from station.errors import InterlockTripped, NotAcknowledged

APPLICATION = "inertial-station"
HISTORY = "acknowledged.jsonl"


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


def place_of(bench: Path) -> Path:
    """Return the file that remembers a trip on the bench of this bench file."""
    whole = str(bench.resolve())
    digest = hashlib.sha256(whole.encode()).hexdigest()[:12]
    return state_folder() / "tripped" / f"{bench.stem}-{digest}.json"


def remember_trip(bench: Path, trip: InterlockTripped, run: Path) -> None:
    """Remember that the bench may not be used until somebody has looked; raises OSError."""
    place = place_of(bench)
    place.parent.mkdir(parents=True, exist_ok=True)
    tripped = Trip(
        str(bench.resolve()),
        trip.name,
        str(trip),
        utc_now().isoformat(timespec="seconds"),
        str(run.resolve()),
    )
    text = json.dumps(asdict(tripped), indent=1, ensure_ascii=False)
    being_written = place.with_suffix(".new")
    being_written.write_text(text + "\n", encoding="utf-8")
    being_written.replace(place)


def unacknowledged(bench: Path) -> Trip | None:
    """Return the trip on this bench that nobody has acknowledged, or None."""
    place = place_of(bench)
    try:
        return Trip(**json.loads(place.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (ValueError, TypeError, OSError) as error:
        # A note that cannot be read is still a note: the bench stays refused.
        return Trip(str(bench), "unknown", f"{place} cannot be read ({error})", "", "")


def refuse_until_acknowledged(bench: Path) -> None:
    """Raise NotAcknowledged where an interlock has tripped on this bench and nobody has looked."""
    trip = unacknowledged(bench)
    if trip is not None:
        raise NotAcknowledged(
            f"the bench {bench.stem} may not be used, nothing was opened or energised: "
            f"{trip.message} ({trip.tripped_utc}, {trip.run}); find the cause, then "
            f"`station acknowledge {bench}`"
        )


def acknowledge(bench: Path) -> Trip | None:
    """Take back the refusal of a bench and note who did so; None where nothing had tripped."""
    trip = unacknowledged(bench)
    if trip is None:
        return None
    line: dict[str, Any] = {
        **asdict(trip),
        "acknowledged_utc": utc_now().isoformat(timespec="seconds"),
        "by": user_name(),
    }
    with (state_folder() / HISTORY).open("a", encoding="utf-8") as history:
        history.write(json.dumps(line, ensure_ascii=False) + "\n")
    place_of(bench).unlink(missing_ok=True)
    return trip


def user_name() -> str:
    """Return the name of the system's user, or nothing where it has none."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return ""
