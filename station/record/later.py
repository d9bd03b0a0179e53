"""What is done with a run folder once its run has ended: recorded in its log, by the same chain.

Each re-analysis, signature and issued certificate is an event, so that one that is missing is
missed. The manifest is written anew for the log alone: what it says of every other file stays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from station.clock import utc_now
from station.errors import RecordError
from station.files.locks import LockHeld
from station.record.events import REVISED, Event, EventLog, read_events
from station.record.files import is_own_file
from station.record.layout import (
    EVENTS,
    GUARDIAN_LOG,
    MANIFEST,
    REVISIONS,
    covered_files,
    file_hash,
    hashes_of_files,
    run_lock,
    write_manifest,
)

OWN_REVISION = "000"
GROWS_STILL = (EVENTS, GUARDIAN_LOG)
"""What the log holds no SHA-256 of: both have chains of their own, and a guardian may go on."""


class NotRecorded(RecordError):
    """Something that was done with a run folder and is not in its log."""


def record_later(
    folder: Path,
    kind: str,
    details: Mapping[str, Any],
    before: Callable[[str], None] = lambda head: None,
) -> str:
    """Append what was done with a folder to its log, renew its manifest; return the chain's head.

    `before` is called with that head right before it is appended. Raises NotRecorded where the run
    goes on, or the folder takes no writes.
    """
    with _locked(folder):
        # The run time stands still once the run has ended; how long ago that is must stay known.
        log_file = folder / EVENTS
        written_s = log_file.stat().st_mtime
        log = EventLog(log_file)
        try:
            now = utc_now()
            whole = {
                **details,
                "utc": now.isoformat(timespec="seconds"),
                "silent_s": round(max(now.timestamp() - written_s, 0.0), 3),
                "files": _hashes_to_log(folder),
                "revisions": revision_hashes(folder),
            }
            head = log.head_with(log.last_s, kind, whole)
            before(head)
            log.append(log.last_s, kind, whole, durable=True)
        finally:
            log.close()
        _renew_manifest(folder)
    return head


def seal(folder: Path) -> None:
    """Append the revisions that the log does not name yet, and write the manifest.

    For the process of the run, which has the lock. The line of the run's own revision holds the
    SHA-256 of every file: it alone differs from one execution of a plan to the next.
    """
    files = hashes_of_files(folder)
    named = named_revisions(tuple(read_events(folder / EVENTS)))
    log = EventLog(folder / EVENTS)
    try:
        for number, manifest in revision_hashes(folder).items():
            if number in named:
                continue
            details: dict[str, Any] = {"revision": number, "revisions": {number: manifest}}
            if number == OWN_REVISION:
                kept = {name: sha for name, sha in files.items() if name not in GROWS_STILL}
                details["files"] = kept
            log.append(log.last_s, REVISED, details, durable=True)
    finally:
        log.close()
    write_manifest(folder, {**files, EVENTS: file_hash(folder / EVENTS)})


def named_revisions(events: Sequence[Event]) -> dict[str, str]:
    """Return the SHA-256 of the manifest of each revision that a log names; "" where it has none.

    A revision never changes: the first SHA-256 counts.
    """
    named: dict[str, str] = {}
    for event in events:
        if event.kind == REVISED:
            named.setdefault(str(event.details.get("revision")), "")
        for number, manifest in event.details.get("revisions", {}).items():
            named[number] = named.get(number) or manifest
    return named


def revision_hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of the manifest of each revision of a folder that has one."""
    manifests = sorted((folder / REVISIONS).glob(f"*/{MANIFEST}"))
    return {path.parent.name: file_hash(path) for path in manifests if is_own_file(path)}


def _hashes_to_log(folder: Path) -> dict[str, str]:
    """Return what the manifest says of the files that do not grow; nothing where there is none."""
    covered = covered_files(folder)
    return {name: digest for name, digest in covered.items() if name not in GROWS_STILL}


def _renew_manifest(folder: Path) -> None:
    """Let the manifest, where the run left one, name the log as it is now, and change no more."""
    if (folder / MANIFEST).is_file():
        files = {**covered_files(folder), EVENTS: file_hash(folder / EVENTS)}
        write_manifest(folder, files)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    try:
        lock = run_lock(folder)
    except LockHeld as error:
        raise NotRecorded(f"{folder} is in use by another process") from error
    try:
        yield
    finally:
        lock.release()
