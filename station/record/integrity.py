"""Whether what a run folder holds is still what the run wrote: sizes, check sums, chains.

Three witnesses: the manifest has the SHA-256 of every file, the log that of each line before and
of the resolved plan and bench, and every raw block its own check sum. A run that was killed has no
manifest; the other two are always there. None is a signature.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from station.errors import DamagedRecord
from station.files.locks import is_held
from station.findings import Flag
from station.record.events import RESUMED, Event, read_events
from station.record.layout import (
    BENCH,
    EVENTS,
    GUARDIAN_LOG,
    LOCK,
    MANIFEST,
    PLAN,
    RAW,
    REVISIONS,
    RUN,
    covered_files,
    file_hash,
)
from station.record.raw_damage import (
    DamagedPart,
    damaged_parts,
    lost_file,
    raw_files,
    source_of,
    spans_of,
)

if TYPE_CHECKING:
    from station.record.raw import RawIndex

USED = ("plan.yaml", "bench.yaml", PLAN, BENCH, RUN, EVENTS, GUARDIAN_LOG)
"""What results are made of, or the report shows; what is not here and not raw is made of it."""
GROWS_LATER = (RUN, EVENTS, GUARDIAN_LOG)
"""What a resumed run goes on writing, before it makes the manifest anew."""
MOST_FLAGS = 20


class OpenedRecord(Protocol):
    """A run folder whose log was read."""

    path: Path
    events: tuple[Event, ...]

    def events_of(self, kind: str) -> Iterator[Event]:
        """Yield the events of one kind."""
        ...

    def index(self, file: Path) -> RawIndex:
        """Return what a raw file holds, read once."""
        ...


@dataclass(frozen=True)
class Damage:
    """What of a run folder is not any more what the run wrote.

    `altered` and `remade` are sentences: of what results are made of, and of what was made of them.
    `no_manifest` says that the run was killed before it could write one.
    """

    altered: tuple[str, ...] = ()
    parts: tuple[DamagedPart, ...] = ()
    remade: tuple[str, ...] = ()
    no_manifest: bool = False

    @property
    def units(self) -> tuple[str, ...]:
        """The finished units of work whose raw data are damaged."""
        return tuple(dict.fromkeys(unit for part in self.parts for unit in part.units))

    def refuse_altered(self) -> None:
        """Raise DamagedRecord that names every altered file of those that results are made of."""
        if self.altered:
            raise DamagedRecord("\n".join(first(self.altered)))

    def flags(self) -> Iterator[Flag]:
        """Yield a flag for each damaged part, and one where there is no manifest."""
        for part in self.parts[:MOST_FLAGS]:
            details = {"file": part.file, "byte": part.byte, "units": list(part.units)}
            yield Flag("data-damaged", sentence_of(part), details=details)
        more = len(self.parts) - MOST_FLAGS
        if more > 0:
            out = ", ".join(first(self.units))
            yield Flag(
                "data-damaged",
                f"{more} more parts of the raw data are damaged; left out in all: {out}.",
                details={"count": more, "units": list(self.units)},
            )
        if self.no_manifest:
            yield Flag(
                "no-manifest",
                "The run has no manifest: it was killed. Checked are the chain of its log, its "
                "resolved plan and bench, and each raw block's own check sum.",
            )


def sentence_of(part: DamagedPart) -> str:
    """Return what is damaged, and what is left out for it."""
    out = ", ".join(first(part.units))
    left = f"left out: {out}" if out else "no finished unit of work is concerned"
    return f"{part.file} is damaged from byte {part.byte} on, {part.what}; {left}."


def first(several: tuple[str, ...]) -> list[str]:
    """Return the first of several, and how many more there are."""
    more = len(several) - MOST_FLAGS
    return [*several[:MOST_FLAGS], *([f"and {more} more"] if more > 0 else [])]


def damage_of(folder: OpenedRecord) -> Damage:
    """Return what of a run folder is damaged; each of its files is read once for it.

    Nothing is raised for damage: an altered log alone, without which nothing can be said, is found
    when the folder is opened.
    """
    path = folder.path
    try:
        listed = covered_files(path)
    except DamagedRecord as error:
        return Damage(altered=(str(error),))
    going_on = is_held(path / LOCK)
    altered = [*_altered_inputs(folder), *_altered_guardian_log(path)]
    remade: list[str] = []
    grown = False
    if EVENTS in listed:
        grown, wrong = _log_against(folder, listed[EVENTS])
        altered += wrong
    unlike: set[str] = set()
    for name, digest in listed.items():
        if name == EVENTS or (grown and name in GROWS_LATER):
            continue
        difference = differs(path, name, digest)
        if difference is None:
            continue
        if name.startswith(f"{RAW}/"):
            unlike.add(name)
        elif name in USED or name in _recorded(folder):
            altered.append(difference)
        elif not (grown or going_on):
            remade.append(difference)
    remade += _altered_revisions(path)
    finished = spans_of(folder.events)
    parts: list[DamagedPart] = []
    there = {f"{RAW}/{file.name}" for file in raw_files(path)}
    for name in sorted(there | {name for name in listed if name.startswith(f"{RAW}/")}):
        if name not in there:
            parts.append(lost_file(name, finished))
            continue
        scan = folder.index(path / name).scan
        foreign = sorted(scan.sources - {source_of(name)})
        if foreign:
            altered.append(
                f"{path / name} was altered: it holds blocks of {foreign[0]}, not of "
                f"{source_of(name)}"
            )
        as_it_was = name not in unlike if name in listed else None
        bad = list(damaged_parts(name, scan, finished, as_it_was=as_it_was))
        if name in unlike and not bad:
            altered.append(
                f"{path / name} is not the file that the run wrote: every block's check sum holds, "
                f"but {MANIFEST} has another SHA-256 of it"
            )
        parts += bad
    return Damage(
        tuple(dict.fromkeys(altered)),
        tuple(parts),
        tuple(remade),
        no_manifest=not listed and not going_on,
    )


def _altered_inputs(folder: OpenedRecord) -> Iterator[str]:
    """Yield what of plan, bench and the files they name is not what the log says of them."""
    for name, digest in _recorded(folder).items():
        file = {"plan": PLAN, "bench": BENCH}.get(name, name)
        now = _file_hash(folder.path / file) if file == name else data_hash(folder.path / file)
        if now != digest:
            gone = not (folder.path / file).is_file()
            difference = "is missing" if gone else "was changed since the run began"
            yield f"{folder.path / file} {difference}: {EVENTS} has another SHA-256 of it"


def _recorded(folder: OpenedRecord) -> dict[str, str]:
    """Return the SHA-256 that the log has of plan, bench, and each file that the plan named."""
    began = next(folder.events_of("run-started"), None)
    sums: dict[str, str] = began.details.get("sha256", {}) if began else {}
    return sums


def data_hash(file: Path) -> str:
    """Return the SHA-256 of what a resolved plan or bench says, empty where it cannot be read."""
    from station.files.faults import FaultList
    from station.files.yaml.reading import MOST_BYTES, read_text

    try:
        return _hash_of_yaml(read_text(file, MOST_BYTES), file)
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
    """Return whether the log was continued since the manifest, and what is wrong with it.

    The manifest of a run that was resumed and killed is that of before: the log's beginning, up to
    where it was resumed, is the one that it names.
    """
    log = folder.path / EVENTS
    running, count = hashlib.sha256(), 0
    with log.open("rb") as file:
        for line, event in zip(file, chain(folder.events, repeat(None)), strict=False):
            if event is not None and event.kind == RESUMED and running.hexdigest() == digest:
                return True, []
            running.update(line)
            count += 1
    if running.hexdigest() == digest:
        return False, []
    return False, [
        f"{log}:{count}: the log was altered: its lines follow each other, but {MANIFEST} has "
        "another SHA-256 of it; its last line was changed, or lines behind it are missing"
    ]


def _altered_revisions(path: Path) -> Iterator[str]:
    """Yield which file of an earlier analysis is not the one that it wrote."""
    for manifest in sorted((path / REVISIONS).glob(f"*/{MANIFEST}")):
        try:
            listed = covered_files(manifest.parent)
        except DamagedRecord as error:
            yield str(error)
            continue
        for name, digest in listed.items():
            difference = differs(manifest.parent, name, digest)
            if difference is not None:
                yield difference


def differs(path: Path, name: str, digest: str) -> str | None:
    """Return what is wrong with a file that a manifest names."""
    now = _file_hash(path / name)
    if now == digest:
        return None
    if not now:
        return f"{path / name} is missing: {MANIFEST} names it"
    return f"{path / name} was changed: {MANIFEST} has another SHA-256 of it"


def _file_hash(file: Path) -> str:
    try:
        return file_hash(file) if file.is_file() else ""
    except OSError:
        return ""
