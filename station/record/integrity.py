"""What state a run folder is in: whether what it holds is still what the run wrote.

Everybody who prints a verdict, or anything else that a folder holds, asks here. The witnesses: the
manifest has the SHA-256 of every file; the log that of each line before, of the resolved plan and
bench, and of what was there at the run's end and at each signature; every raw block has its own
check sum. A run that was killed has no manifest. None of them is a signature.

There are two depths. The quick one holds log, manifest, results and the manifests of revisions
against each other; the whole one every byte.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from station.errors import DamagedRecord, NotPermitted
from station.files.locks import is_held
from station.findings import Flag
from station.record.events import (
    RECORDED_LATER,
    RESUMED,
    REVISED,
    SIGNED,
    Event,
    read_events,
)
from station.record.files import is_own_file, part_of
from station.record.later import OWN_REVISION, named_revisions, revisions_of
from station.record.layout import (
    BENCH,
    CERTIFICATES,
    EVENTS,
    GUARDIAN_LOG,
    LOCK,
    MANIFEST,
    NOT_COVERED,
    PLAN,
    RAW,
    REVISIONS,
    RUN,
    SIGNATURES,
    covered_files,
    file_hash,
    is_draft,
    issued_file,
    manifest_text,
)
from station.record.raw_damage import (
    DamagedPart,
    damaged_parts,
    lost_file,
    raw_files,
    source_of,
    spans_of,
)
from station.record.run_state import RunState

if TYPE_CHECKING:
    from station.record.raw import RawIndex
    from station.record.signatures import Signature

RESULTS = "results.json"
USED = ("plan.yaml", "bench.yaml", PLAN, BENCH, RUN, EVENTS, GUARDIAN_LOG)
"""What results are made of, or the report shows; what is not here and not raw is made of it."""
GROWS_LATER = (RUN, EVENTS, GUARDIAN_LOG)
"""What a resumed run goes on writing, before it makes the manifest anew."""
MAX_FLAGS = 20


class OpenedRecord(Protocol):
    """A run folder whose log was read."""

    path: Path
    events: tuple[Event, ...]

    @property
    def state(self) -> RunState:
        """What the run did, by its log."""
        ...

    def events_of(self, kind: str) -> Iterator[Event]:
        """Yield the events of one kind."""
        ...

    def index(self, file: Path) -> RawIndex:
        """Return what a raw file holds, read once."""
        ...


ADDED = f"{{file}} was added: {MANIFEST} does not name it"
State = Literal["unchanged", "altered", "no-manifest", "running"]
QUICK, WHOLE = "quick", "whole"


@dataclass(frozen=True)
class FolderState:
    """What a run folder is, looked at in one of two depths, `quick` or `whole`.

    `altered` and `remade` are sentences: of what results are made of, and of what was made of them.
    `no_manifest` says that there is none, and `owed` that there should be one. `recorded` says that
    the log names the revisions: it does not in a run of before it did, nor where none was made.
    """

    path: Path
    depth: str
    altered: tuple[str, ...] = ()
    parts: tuple[DamagedPart, ...] = ()
    remade: tuple[str, ...] = ()
    no_manifest: bool = False
    owed: bool = False
    going_on: bool = False
    recorded: bool = False
    files: int = 0
    heads: tuple[str, ...] = ()
    """The SHA-256 of each line of the log, each the head of the chain in its time."""
    signatures: tuple[Signature, ...] = ()

    @property
    def changed(self) -> tuple[str, ...]:
        """A sentence for everything that is not as it was left."""
        parts = (
            f"{self.path / part.file} is damaged from byte {part.byte} on, {part.what}"
            for part in self.parts
        )
        return tuple(dict.fromkeys((*self.altered, *self.remade, *parts)))

    def against(self, name: str) -> list[str]:
        """Return how a file differs from what the run left; nothing of one that was added."""
        added = ADDED.format(file=self.path / name)
        about = (text for text in self.changed if text.startswith(f"{self.path / name} "))
        return [text for text in about if text != added]

    @property
    def state(self) -> State:
        """The state in a word; what it says was looked at as deep as `depth` says."""
        if self.changed:
            return "altered"
        if self.going_on:
            return "running"
        return "no-manifest" if self.no_manifest else "unchanged"

    @property
    def unproven(self) -> bool:
        """Whether what an ended run has left cannot be shown as its own."""
        return self.state in ("altered", "no-manifest")

    @property
    def head(self) -> str:
        """The SHA-256 of the log's last line, which holds that of every line before."""
        return self.heads[-1] if self.heads else ""

    def sentence(self) -> str:
        """Return the state in words, with its depth."""
        looked_at = (
            "every byte" if self.depth == WHOLE else "log, manifest and results looked at alone"
        )
        words: Mapping[State, str] = {
            "altered": f"ALTERED: `station verify {self.path.name}` names what",
            "running": "the run goes on",
            "no-manifest": f"not proven: it has no {MANIFEST} ({looked_at})",
            "unchanged": f"unchanged ({looked_at})",
        }
        return words[self.state]

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "run": str(self.path),
            "state": self.state,
            "depth": self.depth,
            "files": self.files,
            "head": self.head,
            "revisions": "recorded" if self.recorded else "not recorded",
            "changed": list(self.changed),
            "signatures": [signature.to_data() for signature in self.signatures],
        }

    @property
    def units(self) -> tuple[str, ...]:
        """The finished units of work whose raw data are damaged."""
        return tuple(dict.fromkeys(unit for part in self.parts for unit in part.units))

    def sparing(self, sources: Collection[str]) -> FolderState:
        """Return the state in which damage to some sources' raw files spoils no unit of work."""
        parts = (
            replace(part, units=(), needed=False) if source_of(part.file) in sources else part
            for part in self.parts
        )
        return replace(self, parts=tuple(parts))

    def refuse_altered(self) -> None:
        """Raise DamagedRecord that names every altered file of those that results are made of."""
        if self.altered:
            raise DamagedRecord("\n".join(first(self.altered)))

    def flags(self) -> Iterator[Flag]:
        """Yield a flag for each damaged part, and one where there is no manifest."""
        for part in self.parts[:MAX_FLAGS]:
            details = {"file": part.file, "byte": part.byte, "units": list(part.units)}
            yield Flag("data-damaged", sentence_of(part), details=details)
        more = len(self.parts) - MAX_FLAGS
        if more > 0:
            out = ", ".join(first(self.units))
            yield Flag(
                "data-damaged",
                f"{more} more parts of the raw data are damaged; left out in all: {out}.",
                details={"count": more, "units": list(self.units)},
            )
        if self.owed:
            yield Flag(
                "no-manifest",
                "The manifest is missing, though the log says that the run was complete: it was "
                "removed, or the evaluation was killed. Checked is what the log has a SHA-256 of.",
            )
        elif self.no_manifest:
            yield Flag(
                "no-manifest",
                "The run has no manifest: it was killed. Checked are the chain of its log, its "
                "resolved plan and bench, and each raw block's own check sum.",
            )


def sentence_of(part: DamagedPart) -> str:
    """Return what is damaged, and what is left out for it."""
    out = ", ".join(first(part.units))
    left = f"left out: {out}" if out else "no finished unit of work is concerned"
    if not part.needed:
        left = "every unit of work stays, as no value is made of it; u may lack its part"
    return f"{part.file} is damaged from byte {part.byte} on, {part.what}; {left}."


def first(several: tuple[str, ...]) -> list[str]:
    """Return the first of several, and how many more there are."""
    more = len(several) - MAX_FLAGS
    return [*several[:MAX_FLAGS], *([f"and {more} more"] if more > 0 else [])]


def state_of(folder: OpenedRecord, *, whole: bool) -> FolderState:
    """Return what state a run folder is in; for the whole of it each file is read once.

    Nothing is raised for damage: an altered log alone, without which nothing can be said, is found
    when the folder is opened. Raises NotPermitted where this user may not read a part of it.
    """
    path = folder.path
    refuse_unreadable(path)
    depth = WHOLE if whole else QUICK
    going_on = is_held(path / LOCK)
    lines = (path / EVENTS).read_bytes().split(b"\n")[:-1]
    heads = tuple(hashlib.sha256(line).hexdigest() for line in lines)
    no_manifest = not (path / MANIFEST).is_file() and not going_on
    owed = no_manifest and _owes_manifest(folder.state)
    try:
        listed = covered_files(path)
    except DamagedRecord as error:
        return FolderState(path, depth, (str(error),), heads=heads)
    altered = list(_altered_guardian_log(path))
    remade = [*_remade_lists(folder, listed, owed=owed)]
    grown = False
    if EVENTS in listed:
        grown, wrong = _log_against(folder, listed[EVENTS])
        altered += wrong
    logged = _logged_files(folder.state.process.recorded_later)
    inputs = _recorded(folder)
    for name, digest in logged.items():
        if listed.get(name, digest) != digest:
            sentence = f"{path / MANIFEST} was written anew: {EVENTS} has another SHA-256 of {name}"
            (altered if _makes_results(name, inputs) else remade).append(sentence)
    if whole:
        altered += _altered_inputs(folder)
    known, unlike = {**listed, **logged}, set[str]()
    for name, digest in known.items():
        if name == EVENTS or (grown and name in GROWS_LATER) or not (whole or name == RESULTS):
            continue
        difference = differs(path, name, digest, EVENTS if name in logged else MANIFEST)
        if difference is None:
            continue
        if name.startswith(f"{RAW}/"):
            unlike.add(name)
        elif _makes_results(name, inputs):
            altered.append(difference)
        elif not (grown or going_on):
            remade.append(difference)
    remade += _altered_revisions(folder, whole=whole)
    remade += _missing_signatures(folder)
    signatures: tuple[Signature, ...] = ()
    parts: list[DamagedPart] = []
    if whole:
        from station.record.signatures import signatures_of

        if not (no_manifest or going_on or grown):
            remade += _added_files(path, known)
        signatures = tuple(signatures_of(path, folder.events, heads))
        remade += [
            f"{path / SIGNATURES / signature.file} is no signature of this run: {signature.why}"
            for signature in signatures
            if signature.state == "forged"
        ]
        for damage in _damaged_raw(folder, known, unlike):
            if isinstance(damage, str):
                altered.append(damage)
            else:
                parts.append(damage)
    return FolderState(
        path,
        depth,
        tuple(dict.fromkeys(altered)),
        tuple(parts),
        tuple(remade),
        no_manifest=no_manifest,
        owed=owed,
        going_on=going_on,
        recorded=bool(named_revisions(folder.events)),
        files=len(listed),
        heads=heads,
        signatures=signatures,
    )


def refuse_unreadable(path: Path) -> None:
    """Raise NotPermitted where this user may not read a part of a run folder."""

    def refuse(error: OSError) -> None:
        if isinstance(error, PermissionError):
            raise NotPermitted(str(error.filename)) from error

    for folder, _, files in os.walk(path, onerror=refuse):
        for file in (Path(folder, name) for name in files):
            if not (os.access(file, os.R_OK) or file.is_symlink()):
                raise NotPermitted(file)


def _makes_results(name: str, inputs: Mapping[str, str]) -> bool:
    """Whether results are made of a file, so that nothing is evaluated once it was altered."""
    return name in USED or name in inputs or name.startswith(f"{RAW}/")


def _owes_manifest(run: RunState) -> bool:
    """Whether the last process of a run came to where a manifest is written."""
    return run.measured or any(
        event.kind == SIGNED
        or (event.kind == REVISED and event.details["revision"] == OWN_REVISION)
        for event in run.process.recorded_later
    )


def _remade_lists(folder: OpenedRecord, listed: Mapping[str, str], *, owed: bool) -> Iterator[str]:
    """Yield what is wrong with the manifest as a file."""
    manifest = folder.path / MANIFEST
    if owed:
        yield (
            f"{manifest} is missing, though the log says that the run was complete: it was "
            "removed, or the evaluation was killed and `station resume` writes it"
        )
    if listed and manifest.read_bytes() != manifest_text(listed).encode():
        yield f"{manifest} was altered: it is not written as the run writes it"


def _logged_files(events: Iterable[Event]) -> dict[str, str]:
    """Return the SHA-256 that the log has of files since the run went on last; the first counts."""
    logged: dict[str, str] = {}
    for event in events:
        logged = {**event.details.get("files", {}), **logged}
    return logged


def _added_files(path: Path, known: Mapping[str, str]) -> Iterator[str]:
    """Yield what the run did not leave: no evidence of it, but somebody may take it for some."""
    for file in sorted(path.rglob("*")):
        name = file.relative_to(path).as_posix()
        if name.partition("/")[0] in NOT_COVERED or name == MANIFEST or file.is_dir():
            continue
        if is_draft(name) or (name == part_of(Path(MANIFEST)).name and not file.is_symlink()):
            continue
        if file.is_symlink():
            yield f"{file} is a link: the run makes none"
        elif not file.is_file():
            yield f"{file} is no plain file: the run makes none other"
        elif name not in known:
            yield ADDED.format(file=file)


def _damaged_raw(
    folder: OpenedRecord, known: Mapping[str, str], unlike: Collection[str]
) -> Iterator[str | DamagedPart]:
    """Yield a sentence for each raw file that is not the one of the run, and each damaged part."""
    path = folder.path
    finished = spans_of(folder.events)
    there = {f"{RAW}/{file.name}" for file in raw_files(path)}
    for name in sorted(there | {name for name in known if name.startswith(f"{RAW}/")}):
        if name not in there:
            yield lost_file(name, finished)
            continue
        scan = folder.index(path / name).scan
        for foreign in sorted(scan.sources - {source_of(name)})[:1]:
            own = source_of(name)
            yield f"{path / name} was altered: it holds blocks of {foreign}, not of {own}"
        as_it_was = name not in unlike if name in known else None
        bad = list(damaged_parts(name, scan, finished, as_it_was=as_it_was))
        if name in unlike and not bad:
            yield (
                f"{path / name} is not the file that the run wrote: every block's check sum "
                f"holds, but {MANIFEST} or {EVENTS} has another SHA-256 of it"
            )
        yield from bad


def _altered_inputs(folder: OpenedRecord) -> Iterator[str]:
    """Yield what of plan, bench and the files they name is not what the log says of them."""
    for name, digest in _recorded(folder).items():
        file = {"plan": PLAN, "bench": BENCH}.get(name, name)
        now = _file_hash(folder.path / file) if file == name else data_hash(folder.path / file)
        if now != digest:
            here = folder.path / file
            if here.is_file():
                yield f"{here} was changed since the run began: {EVENTS} has another SHA-256 of it"
            else:
                yield f"{here} is missing: {EVENTS} has another SHA-256 of it"


def _recorded(folder: OpenedRecord) -> dict[str, str]:
    """Return the SHA-256 that the log has of plan, bench, and each file that the plan named."""
    sums: dict[str, str] = folder.state.planned.get("sha256", {})
    return sums


def data_hash(file: Path) -> str:
    """Return the SHA-256 of what a resolved plan or bench says, empty where it cannot be read."""
    from station.files.faults import FaultList
    from station.files.yaml.reading import MAX_BYTES, read_text

    try:
        return _hash_of_yaml(read_text(file, MAX_BYTES), file)
    except FaultList:
        return ""


@lru_cache(maxsize=4)
def _hash_of_yaml(text: str, file: Path) -> str:
    """Return the SHA-256 of a text's data; a run's plan and bench are asked for again and again."""
    from station.files.yaml.reading import read_yaml_text

    return hash_of_data(read_yaml_text(text, file).data)


def hash_of_data(data: Mapping[str, Any]) -> str:
    """Return the SHA-256 of data, however they are written."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()


def _altered_guardian_log(path: Path) -> Iterator[str]:
    try:
        if (path / GUARDIAN_LOG).is_file():
            for _ in read_events(path / GUARDIAN_LOG):
                pass
    except DamagedRecord as error:
        yield str(error)


def _log_against(folder: OpenedRecord, digest: str) -> tuple[bool, list[str]]:
    """Return whether the run went on since the manifest, and what is wrong with the log.

    The manifest of a run that was resumed and killed is that of before: the log's beginning, up to
    where it was resumed, is the one that it names. So it is for a moment while something is
    recorded that was done after the run.
    """
    log = folder.path / EVENTS
    running, count = hashlib.sha256(), 0
    with log.open("rb") as file:
        for line, event in zip(file, chain(folder.events, repeat(None)), strict=False):
            if event is not None and running.hexdigest() == digest:  # what follows is known
                later = (e for e in folder.events[count:] if e.kind not in RECORDED_LATER)
                own = next(later, None)
                if own is None or own.kind == RESUMED:
                    return own is not None, []
            running.update(line)
            count += 1
    if running.hexdigest() == digest:
        return False, []
    return False, [
        f"{log}:{count}: the log was altered: its lines follow each other, but {MANIFEST} has "
        "another SHA-256 of it; its last line was changed, or lines behind it are missing"
    ]


def _altered_revisions(folder: OpenedRecord, *, whole: bool) -> Iterator[str]:
    """Yield each revision that is missing or was added, and each of its files that was changed."""
    revisions, named = folder.path / REVISIONS, named_revisions(folder.events)
    there = revisions_of(folder.path)
    for folder_of in (revisions, folder.path / SIGNATURES, folder.path / CERTIFICATES):
        if folder_of.is_symlink():
            yield f"{folder_of} is a link: the run makes none"
    for number in named:
        if number not in there:
            yield f"{revisions / number} is missing: {EVENTS} names this revision"
    for number, path in there.items():
        manifest = path / MANIFEST
        if path.is_symlink() or not is_own_file(manifest):
            yield f"{path} was added: it has no {MANIFEST}, so it is no revision; move it elsewhere"
            continue
        if named and number not in named and not _is_being_named(folder.path, number):
            yield f"{path} was added: {EVENTS} does not name this revision"
        if named.get(number) and file_hash(manifest) != named[number]:
            yield f"{manifest} was written anew: {EVENTS} has another SHA-256 of it"
        try:
            listed = covered_files(path)
        except DamagedRecord as error:
            yield str(error)
            continue
        if whole:
            if manifest.read_bytes() != manifest_text(listed).encode():
                yield f"{manifest} was altered: it is not written as the run writes it"
            yield from _added_files(path, listed)
        for name, digest in listed.items():
            difference = differs(path, name, digest) if whole or name == RESULTS else None
            if difference is not None:
                yield difference


def _is_being_named(path: Path, revision: str) -> bool:
    """Whether the log of a run names a revision since it was read, or is about to."""
    return is_held(path / LOCK) or revision in named_revisions(tuple(read_events(path / EVENTS)))


def _missing_signatures(folder: OpenedRecord) -> Iterator[str]:
    """Yield each signature that the log names and the folder does not hold."""
    for event in folder.events:
        if event.kind == SIGNED:
            file = folder.path / SIGNATURES / str(event.details["signature"])
            if not is_own_file(file):
                by = f"{event.details['signer']} signed at {event.details['utc']}"
                yield f"{file} is missing: {EVENTS} says that {by}"


def differs(path: Path, name: str, digest: str, witness: str = MANIFEST) -> str | None:
    """Return what is wrong with a file of which a witness, manifest or log, has the SHA-256."""
    now = _file_hash(issued_file(path, name))
    if now == digest:
        return None
    if not now:
        return f"{path / name} is missing: {witness} names it"
    return f"{path / name} was changed: {witness} has another SHA-256 of it"


def _file_hash(file: Path) -> str:
    try:
        return file_hash(file) if file.is_file() else ""
    except OSError:
        return ""
