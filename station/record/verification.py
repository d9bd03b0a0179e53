"""Whether a run folder is as the run left it: every file that was changed, lost or added."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.errors import DamagedRecord, InputError
from station.files.locks import is_held
from station.record.events import read_events
from station.record.folder import RunFolder
from station.record.integrity import damage_of, differs
from station.record.layout import (
    EVENTS,
    LOCK,
    MANIFEST,
    NOT_COVERED,
    REVISIONS,
    SIGNATURES,
    covered_files,
    manifest_text,
)
from station.record.signatures import Signature, signatures_of


@dataclass(frozen=True)
class Verification:
    """What became of a run folder since its manifest was written.

    `changed` has a sentence for each file; `proven` says that there is a manifest, and so that
    nothing else was changed; `files` is how many it names. `signatures` are those it holds.
    """

    run: str
    changed: tuple[str, ...]
    proven: bool
    files: int
    signatures: tuple[Signature, ...] = ()

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        state = "altered" if self.changed else "unchanged" if self.proven else "no-manifest"
        return {
            "run": self.run,
            "state": state,
            "files": self.files,
            "changed": list(self.changed),
            "signatures": [signature.to_data() for signature in self.signatures],
        }


def verify(folder: Path) -> Verification:
    """Hold every file of a run folder against its manifest, its log against its own chain.

    `exports/` and the lock are left out: they are no evidence. Raises InputError for what is no run
    folder, and for a run that is going on.
    """
    if not (folder / EVENTS).is_file() and not (folder / MANIFEST).is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    if is_held(folder / LOCK):
        raise InputError(f"{folder} is being run; verify it once it has ended")
    changes = [*_against_manifest(folder), *_chain(folder)]
    revisions = folder / REVISIONS
    for revision in sorted(revisions.iterdir()) if revisions.is_dir() else ():
        if revision.is_symlink() or not (revision / MANIFEST).is_file():
            changes.append(f"{revision} was added: it has no {MANIFEST}")
        else:
            changes += _against_manifest(revision)
    proven = (folder / MANIFEST).is_file()
    signatures = tuple(signatures_of(folder))
    changes += [
        f"{folder / SIGNATURES / signature.signer} is no signature of this run: it was altered"
        for signature in signatures
        if signature.state == "forged"
    ]
    changed = tuple(dict.fromkeys(changes))
    return Verification(str(folder), changed, proven, len(_listed(folder)), signatures)


def _listed(folder: Path) -> dict[str, str]:
    try:
        return covered_files(folder)
    except DamagedRecord:
        return {}


def _against_manifest(folder: Path) -> Iterator[str]:
    """Yield what of a folder is not what its manifest says; nothing where it has none."""
    manifest = folder / MANIFEST
    if not manifest.is_file():
        return
    try:
        listed = covered_files(folder)
    except DamagedRecord as error:
        yield str(error)
        return
    if manifest.read_bytes() != manifest_text(listed).encode():
        yield f"{manifest} was altered: it is not written as the run writes it"
    for name, digest in listed.items():
        difference = differs(folder, name, digest)
        if difference is not None:
            yield difference
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if name.partition("/")[0] in NOT_COVERED or path == manifest:
            continue
        if path.is_symlink():
            yield f"{path} is a link: the run makes none"
        elif path.is_file() and name not in listed:
            yield f"{path} was added: {MANIFEST} does not name it"


def _chain(folder: Path) -> Iterator[str]:
    """Yield what the log says of itself and of plan and bench, and each damaged raw block."""
    try:
        for _ in read_events(folder / EVENTS):
            pass
        damage = damage_of(RunFolder(folder))
    except (DamagedRecord, OSError, ValueError) as error:
        yield str(error)
        return
    yield from damage.altered
    for part in damage.parts:
        yield f"{folder / part.file} is damaged from byte {part.byte} on, {part.what}"
