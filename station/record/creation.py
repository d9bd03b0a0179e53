"""A new run folder: whole from its first moment, whatever happens while it is made."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from station.errors import RecordError
from station.record.files import sync_folder, write_whole_file

EVENTS = "events.jsonl"
RAW = "raw"
RUN = "run.json"
REVISIONS = "revisions"
GUARDIAN_LOG = "guardian.jsonl"
PLAN, BENCH = "plan.resolved.yaml", "bench.resolved.yaml"
MOST_OF_ONE_NAME = 1000


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
    for number in range(1, MOST_OF_ONE_NAME):
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
    for number in range(1, MOST_OF_ONE_NAME):
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
