"""What is done with a run folder once its run has ended: recorded in its log, by the same chain.

Each re-analysis, signature and issued certificate is an event, so that one that is missing is
missed. The manifest is written anew for the log alone: what it says of every other file stays.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from typing import Any

from station.clock import utc_now
from station.console import tell
from station.errors import RecordError
from station.files.locks import FileLock, LockHeld, remove_if_free
from station.record.events import ISSUED, RESUMED, REVISED, Event, EventLog, read_events
from station.record.files import A_COPY, is_own_file, sync_folder
from station.record.layout import (
    DRAFT,
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
    *,
    added: Mapping[str, str] | None = None,
    after: Callable[[], object] = lambda: None,
) -> str:
    """Append what was done with a folder to its log, renew its manifest; return the chain's head.

    `before` is called with that head right before it is appended, `after` once it is. `added` are
    the SHA-256 of files that log and manifest name from then on. Raises NotRecorded where the run
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
                "files": {**_hashes_to_log(folder), **(added or {})},
                "revisions": {**revision_hashes(folder), **details.get("revisions", {})},
            }
            head = log.head_with(log.last_s, kind, whole)
            before(head)
            log.append(log.last_s, kind, whole, durable=True)
        finally:
            log.close()
        after()
        _renew_manifest(folder, added or {})
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


def revisions_of_all_data(events: Sequence[Event]) -> list[str]:
    """Return the revisions that were made of all that a run has recorded, the newest first."""
    since: list[str] = []
    for event in events:
        if event.kind == RESUMED:
            since.clear()
        elif event.kind == REVISED:
            since.insert(0, str(event.details["revision"]))
    return since


def revisions_of(folder: Path) -> dict[str, Path]:
    """Return the folder of each revision by its number, in their order."""
    revisions = folder / REVISIONS
    paths = sorted(revisions.iterdir()) if revisions.is_dir() else []
    return {path.name: path for path in paths if not path.name.startswith(DRAFT)}


def revision_hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of the manifest of each revision of a folder that has one."""
    manifests = {number: path / MANIFEST for number, path in revisions_of(folder).items()}
    return {number: file_hash(path) for number, path in manifests.items() if is_own_file(path)}


@contextmanager
def draft_revision(folder: Path) -> Iterator[Path]:
    """Give a folder in which a revision is written; what is not added by the end is removed.

    So are the drafts that killed processes left. Raises RecordError where it cannot be made.
    """
    parent = folder / REVISIONS
    draft = parent / f"{DRAFT}{token_hex(8)}"
    try:
        parent.mkdir(exist_ok=True)
        for abandoned in parent.glob(f"{DRAFT}*.lock"):
            with suppress(LockHeld):
                _remove_draft(FileLock(abandoned))
        lock = FileLock(draft.with_suffix(".lock"))
        draft.mkdir()
    except OSError as error:
        raise RecordError(
            f"cannot make a folder in {parent}: {error.strerror or error}; choose another "
            "place for the results with --output"
        ) from error
    try:
        yield draft
    finally:
        _remove_draft(lock)


def _remove_draft(lock: FileLock) -> None:
    """Remove a draft whose lock is held, where it is still there, and give the lock back."""
    shutil.rmtree(lock.path.with_suffix(""), ignore_errors=True)
    lock.release()
    remove_if_free(lock.path)


def add_own_revision(folder: Path, draft: Path) -> Path:
    """Let a draft be the run's own revision, 000; no other analysis takes this number."""
    revision = folder / REVISIONS / OWN_REVISION
    shutil.rmtree(revision, ignore_errors=True)  # of an evaluation that was killed
    draft.rename(revision)
    sync_folder(revision.parent)
    return revision


def add_revision(folder: Path, draft: Path) -> Path:
    """Let a draft be the next revision, from 001 on, and the log name it; return its folder.

    A run that goes on names it itself, when it ends. Raises RecordError, and adds none, where the
    log cannot be written.
    """
    while True:
        # One that was removed keeps its number.
        numbers = {*revisions_of(folder), *named_revisions(tuple(read_events(folder / EVENTS)))}
        last = max((int(number) for number in numbers if number.isdecimal()), default=0)
        revision = folder / REVISIONS / f"{last + 1:03d}"
        with suppress(FileExistsError):  # another analysis was faster
            _add(folder, draft, revision)
            sync_folder(revision.parent)
            return revision


def _add(folder: Path, draft: Path, revision: Path) -> None:
    hashes = {revision.name: file_hash(draft / MANIFEST)}
    details = {"revision": revision.name, "revisions": hashes}
    try:
        record_later(folder, REVISED, details, lambda _: _rename(draft, revision))
    except NotRecorded as error:
        _rename(draft, revision)
        tell(f"WARNING: {revision} is not in the log of the run: {error}")
    except BaseException:
        if revision.name not in named_revisions(tuple(read_events(folder / EVENTS))):
            with suppress(OSError):  # another one's, and the draft is there still
                revision.rename(draft)
        raise


def _rename(draft: Path, revision: Path) -> None:
    try:
        draft.rename(revision)
    except OSError as error:
        if revision.exists():
            raise FileExistsError(str(revision)) from error
        raise


def _hashes_to_log(folder: Path) -> dict[str, str]:
    """Return what the manifest says of the files that do not grow; nothing where there is none."""
    covered = covered_files(folder)
    return {name: digest for name, digest in covered.items() if name not in GROWS_STILL}


def _renew_manifest(folder: Path, added: Mapping[str, str]) -> None:
    """Let the manifest, where the run left one, name the log as it is now, and what was added."""
    if (folder / MANIFEST).is_file():
        files = {
            **issued_files(tuple(read_events(folder / EVENTS))),
            **covered_files(folder),
            **added,
            EVENTS: file_hash(folder / EVENTS),
        }
        write_manifest(folder, files, A_COPY)


def issued_files(events: Sequence[Event]) -> dict[str, str]:
    """Return the SHA-256 of each certificate that a log has issued, by its file."""
    issued = (event.details for event in events if event.kind == ISSUED and "file" in event.details)
    return {str(issue["file"]): str(issue["files"][issue["file"]]) for issue in issued}


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
