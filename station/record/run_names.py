"""Run folders by a part of their name, or of their device's serial number, as a person types it."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from station.errors import InputError
from station.files.lookup import is_missing
from station.record.careful_reading import first_line, read_json, words
from station.record.layout import EVENTS, RUN

RUNS = Path("runs")
"""Where `station run` puts its folders where nobody says otherwise."""

STAMP_FORM = "%Y%m%dT%H%M%SZ"
"""With what the name of a run folder begins."""
STAMP = re.compile(r"\d{8}T\d{6}Z")
STAMP_LENGTH = len("20260301T081500Z")


def runs_below(parent: Path) -> list[Path]:
    """Return the run folders below `parent`, oldest first; a link to a folder is none of them."""
    runs = (path.parent for path in parent.glob(f"[!.]*/{EVENTS}"))
    own = (run for run in runs if not run.is_symlink())
    return sorted(own, key=lambda run: (stamp_of(run), run.name))


def stamp_of(run: Path) -> str:
    """Return when a run began, as its name says it, or else its `run.json`; empty if neither."""
    if STAMP.match(run.name):
        return run.name[:STAMP_LENGTH]
    try:
        began = datetime.fromisoformat(words(read_json(run / RUN).get("started_utc")))
        return began.astimezone(UTC).strftime(STAMP_FORM)
    except (ValueError, OverflowError):
        return ""


def serial_of(run: Path) -> str:
    """Return the serial number of a run's device, empty where its log does not say it."""
    dut = first_line(run / EVENTS).get("dut")
    return words(dut.get("serial")) if isinstance(dut, dict) else ""


def find_run(
    name: Path, parent: Path = RUNS, *, is_active: Callable[[Path], bool] | None = None
) -> Path:
    """Return the folder of a run from its path, its name, or what only its name or device holds.

    A path that exists is taken as it is. With `is_active`, of several runs the active one is meant.
    Raises InputError where a path does not exist, and where no name and no serial number below
    `parent` holds the text, or several.
    """
    if not is_missing(name):
        return name
    if len(name.parts) != 1:
        raise InputError(f"the path {name} does not exist")
    text = str(name).lower()
    below = runs_below(parent)
    fitting = [path for path in below if text in path.name.lower()]
    # The name of a folder has no blank and no other letters than A to Z.
    fitting = fitting or [path for path in below if text in serial_of(path).lower()]
    exact = [path for path in fitting if path.name.lower() == text]
    active = [path for path in fitting if is_active(path)] if is_active and fitting[1:] else []
    match exact or active or fitting:
        case [only]:
            return only
        case []:
            raise InputError(
                f"there is no file or folder {name}, and no run below {parent} has a name or a "
                f"serial number that holds '{name}'; `station list runs` lists them"
            )
        case several:
            newest_first = "".join(f"\n  {path.name}" for path in reversed(several))
            which = "active runs" if active else "runs"
            raise InputError(
                f"{len(several)} {which} below {parent} fit '{name}'; write the name, or more of "
                f"it, of the one you mean:{newest_first}"
            )
