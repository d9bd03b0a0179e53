"""The register of certificates: what was issued of a run stands in its log and in `certificates/`.

The line of the log issues: it has number, date, and the SHA-256 of the PDF, which is whole on disk
before it. What a killed issue leaves is a draft, and no certificate; or the certificate, under the
name of its draft.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from station.console import tell
from station.errors import DamagedRecord, InputError, RecordError, StationError
from station.record.events import ISSUED, Event, read_events
from station.record.files import A_COPY, not_written, sync_data, sync_folder
from station.record.later import record_later
from station.record.layout import CERTIFICATES, DRAFT, EVENTS, issued_file
from station.record.run_names import runs_below

KEPT, ALTERED, MISSING = "kept", "altered", "missing"


@dataclass(frozen=True)
class Issue:
    """A certificate as it was issued, or is to be.

    `says` is a SHA-256 of what it says, `content` one of that in its form (languages, paper,
    letterhead), and `results` that of the results it was made of. It
    `replaces` the certificate of that number, for a `reason`; the first of a run replaces none.
    """

    number: str
    date: str
    device: str
    customer: str
    languages: tuple[str, ...]
    content: str
    results: str
    replaces: str = ""
    reason: str = ""
    says: str = ""

    @property
    def file(self) -> str:
        """The kept PDF, below the run folder."""
        return f"{CERTIFICATES}/{self.number}.pdf"


def issues_of(events: Sequence[Event]) -> dict[str, Issue]:
    """Return the certificates of a run by their number, the oldest first."""
    known: dict[str, Issue] = {}
    for event in events:
        if event.kind == ISSUED:
            named = {name: event.details.get(name, "") for name in Issue.__dataclass_fields__}
            issue = Issue(**{**named, "languages": tuple(named["languages"])})
            known.setdefault(issue.number, issue)
    return known


def in_force(issues: Mapping[str, Issue]) -> Issue | None:
    """Return the certificate of a run that no other one replaces; None where none was issued."""
    replaced = {issue.replaces for issue in issues.values()}
    return next((issue for issue in issues.values() if issue.number not in replaced), None)


def refuse_second(issues: Mapping[str, Issue], replaces: str) -> None:
    """Raise InputError where a certificate may not be issued beside those that were.

    The first replaces none; each later one replaces the one in force.
    """
    current = in_force(issues)
    if not replaces:
        if current is not None:
            raise InputError(
                f"certificate {current.number} was issued on {current.date}; an amended one is "
                f"issued with --replaces {current.number} --reason TEXT"
            )
        return
    if replaces not in issues:
        known = ", ".join(issues) or "none"
        raise InputError(f"there is no certificate {replaces} of this run; issued: {known}")
    if current is None or replaces != current.number:
        by = next(issue.number for issue in issues.values() if issue.replaces == replaces)
        raise InputError(f"certificate {replaces} was replaced already, by {by}")


def keep(folder: Path, issue: Issue, pdf: bytes) -> str:
    """Issue a certificate: keep its PDF, and say so in the log; return the head of the chain.

    Raises InputError where another one was issued meanwhile, RecordError where it cannot be kept.
    """
    file = folder / issue.file
    draft = file.with_name(f"{DRAFT}{file.name}")

    heads: list[str] = []

    def write(head: str) -> None:
        heads.append(head)
        refuse_second(issues_of(tuple(read_events(folder / EVENTS))), issue.replaces)
        try:
            file.parent.mkdir(exist_ok=True)
            for abandoned in file.parent.glob(f"{DRAFT}*"):
                _complete(abandoned, folder)
            with draft.open("wb") as written:
                written.write(pdf)
                written.flush()
                sync_data(written.fileno())
            sync_folder(file.parent)
            sync_folder(folder)
        except OSError as error:
            raise not_written(file, error, A_COPY) from error

    def name() -> None:
        with suppress(OSError):  # it is issued, and known by the name of its draft
            draft.replace(file)
            sync_folder(file.parent)

    digest = hashlib.sha256(pdf).hexdigest()
    details = {**asdict(issue), "languages": list(issue.languages), "file": issue.file}
    try:
        return record_later(folder, ISSUED, details, write, added={issue.file: digest}, after=name)
    except RecordError as error:
        if not heads or issue.number not in issues_of(tuple(read_events(folder / EVENTS))):
            raise
        tell(
            f"WARNING: the certificate is issued, but the manifest was not renewed, which the next "
            f"analysis of the run does: {error}"
        )
        return heads[-1]


def _complete(draft: Path, folder: Path) -> None:
    """Give a draft its name where it was issued; remove it where it was not."""
    number = draft.name.removeprefix(DRAFT).removesuffix(".pdf")
    if number in issues_of(tuple(read_events(folder / EVENTS))):
        draft.replace(draft.with_name(draft.name.removeprefix(DRAFT)))
    else:
        draft.unlink()


def kept_pdf(folder: Path, events: Sequence[Event], issue: Issue) -> bytes:
    """Return the PDF of an issued certificate; raises DamagedRecord where it is not that one."""
    state, pdf = _kept(folder, events, issue)
    if state != KEPT:
        raise DamagedRecord(
            f"{folder / issue.file} is {state}: {EVENTS} has the SHA-256 of the certificate that "
            "was issued; put back a copy of that one"
        )
    return pdf


def _kept(folder: Path, events: Sequence[Event], issue: Issue) -> tuple[str, bytes]:
    listed = (
        event.details.get("files", {}).get(issue.file)
        for event in events
        if event.kind == ISSUED and event.details.get("number") == issue.number
    )
    try:
        pdf = issued_file(folder, issue.file).read_bytes()
    except OSError:
        return MISSING, b""
    return (KEPT if hashlib.sha256(pdf).hexdigest() == next(listed) else ALTERED), pdf


def register(runs: Path) -> Iterator[dict[str, Any]]:
    """Yield the certificates issued of the runs below a folder, the newest first, as plain data.

    A run whose log cannot be read is named on standard error.
    """
    rows: list[dict[str, Any]] = []
    for folder in runs_below(runs):
        log = folder / EVENTS
        try:
            if ISSUED.encode() not in log.read_bytes():
                continue
            events = tuple(read_events(log))
        except (OSError, StationError) as error:
            tell(f"WARNING: the certificates of {folder.name} cannot be listed: {error}")
            continue
        issues = issues_of(events)
        by = {issue.replaces: issue.number for issue in issues.values() if issue.replaces}
        rows += (
            {
                **asdict(issue),
                "languages": list(issue.languages),
                "run": folder.name,
                "file": str(folder / issue.file),
                "replaced_by": by.get(issue.number, ""),
                "state": _kept(folder, events, issue)[0],
            }
            for issue in reversed(issues.values())
        )
    yield from sorted(rows, key=lambda row: row["date"], reverse=True)
