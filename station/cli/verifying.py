"""`station verify` and `station sign`: whether run folders are as their runs left them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.clock import utc_now
from station.console import tell
from station.errors import (
    EXIT_DONE,
    EXIT_OUTSIDE_LIMIT,
    EXIT_UNDETERMINED,
    EXIT_WRONG_INPUT,
    InputError,
    StationError,
)
from station.files.faults import printable
from station.files.lookup import is_there
from station.history.place import is_kept
from station.record.events import Event, recorded_in_words
from station.record.folder import RunFolder
from station.record.integrity import FolderState
from station.record.signatures import (
    Signature,
    States,
    is_trusted,
    names_of_several,
    new_key,
    read_trusted,
    sign,
)
from station.record.verification import verify, was_in
from station.speech import show

SHOWN = 16
"""Digits of a key's SHA-256 that people compare, and the fewest of a head that name it."""
MAX_LINES = 40

Trusted = Mapping[str, str]


@dataclass(frozen=True)
class Verified:
    """A folder's state, and what was found by holding it against what is not in the folder.

    `since` are the events after the head that was asked for, None where none was asked for.
    """

    state: FolderState
    trusted: Trusted | None = None
    elsewhere: tuple[str, ...] = ()
    untrusted: tuple[str, ...] = ()
    since: tuple[Event, ...] | None = None

    @property
    def changed(self) -> tuple[str, ...]:
        """A sentence for everything that is wrong."""
        return (*self.state.changed, *self.elsewhere, *self.untrusted)

    @property
    def word(self) -> str:
        """The state in a word."""
        if self.untrusted and not (self.state.changed or self.elsewhere):
            return "not-trusted"
        return "altered" if self.changed else self.state.state

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        data = self.state.to_data() | {"changed": list(self.changed), "state": self.word}
        if self.trusted is not None:
            for entry, signature in zip(data["signatures"], self.state.signatures, strict=True):
                entry["trusted"] = is_trusted(signature, self.trusted)
        if self.since is not None:
            data["since_head"] = [recorded_in_words(event) for event in self.since]
        return data


def verify_runs(
    folders: Sequence[Path],
    *,
    as_json: bool,
    trusted: Path | None = None,
    bench: str | None = None,
    head: str | None = None,
) -> int:
    """Print what was changed in each folder; return 1 where anything was, 6 without a manifest.

    A folder of several that is no run, or is being run, is named, and is exit code 2 where nothing
    was changed elsewhere. With a file of `trusted` keys or a `bench` that names them, a folder that
    no trusted key signed is changed, too; with a `head`, one that never had it.
    """
    if head is not None and len(folders) != 1:
        raise InputError("--head is the head of one run; name that run alone")
    keys = trusted_keys(trusted, bench)
    verified, refused = list[Verified](), dict[Path, str]()
    for folder in folders:
        try:
            verified.append(verified_run(folder, keys, head))
        except InputError as error:
            if len(folders) == 1:
                raise
            refused[folder] = str(error)
    if as_json:
        runs = [entry.to_data() for entry in verified]
        others = [
            {"run": str(folder), "state": "not-verified", "error": why}
            for folder, why in refused.items()
        ]
        print(json.dumps({"runs": [*runs, *others]}, indent=1, ensure_ascii=False))
    else:
        for entry in verified:
            show("\n".join(map(printable, lines(entry))))
        for why in refused.values():
            tell(printable(f"not verified: {why}"))
    if any(entry.changed for entry in verified):
        return EXIT_OUTSIDE_LIMIT
    if refused:
        return EXIT_WRONG_INPUT
    proven = not any(entry.state.no_manifest for entry in verified)
    return EXIT_DONE if proven else EXIT_UNDETERMINED


def trusted_keys(file: Path | None, bench: str | None) -> Trusted | None:
    """Return the keys that a file and a bench name; None where neither is given."""
    if file is None and bench is None:
        return None
    keys: dict[str, str] = {}
    if file is not None:
        if not is_there(file):
            raise InputError(f"there is no file {file} of trusted keys")
        try:
            text = file.read_text(encoding="utf-8-sig")
        except (OSError, ValueError) as error:
            raise InputError(f"cannot read the trusted keys {file}: {error}") from error
        keys |= read_trusted(text, str(file))
    if bench is not None:
        from station.cli.validating import read_bench_named

        laboratory = read_bench_named(bench).file.laboratory
        named = laboratory.trusted_keys if laboratory else ()
        keys |= read_trusted("\n".join(named), f"bench {bench}, laboratory.trusted_keys")
    return keys


def verified_run(folder: Path, trusted: Trusted | None = None, head: str | None = None) -> Verified:
    """Return the state of a whole run folder, held against the history, keys and a head."""
    state = verify(folder)
    elsewhere = list(against_history(folder))
    since = None if head is None else since_head(state, head)
    if head is not None and since is None:
        elsewhere.append(f"{folder} never had the head {head}: its log was altered, or is another")
    return Verified(state, trusted, tuple(elsewhere), tuple(against_keys(state, trusted)), since)


def against_history(folder: Path) -> Iterator[str]:
    """Yield that the history knows another state, where one is kept.

    Whoever writes a run's files, log and manifest anew does not change what the history holds.
    """
    parent = folder.resolve().parent
    if not is_kept(parent):
        return
    from station.history.store import NOT_TAKEN_IN, History

    try:
        with closing(History(parent)) as history:
            known = history.head_of(folder)
    except StationError as error:
        tell(f"WARNING: not held against the history: {error}")
        return
    if known is not None and not was_in(folder, known):
        yield f"{folder} is {NOT_TAKEN_IN}"


def against_keys(state: FolderState, trusted: Trusted | None) -> Iterator[str]:
    """Yield what is wrong with who signed a folder, given the keys that are trusted."""
    yield from names_of_several(state.signatures, trusted)
    if trusted is None or any(is_trusted(signature, trusted) for signature in state.signatures):
        return
    unknown = [signature for signature in state.signatures if signature.state != "forged"]
    yield from (
        f"{signature.file} is signed by a key that is not trusted: {signature.key}, in the name of "
        f"{signature.signer}"
        for signature in unknown
    )
    if not unknown:
        yield f"{state.path} has no signature by a trusted key"


def since_head(state: FolderState, head: str) -> tuple[Event, ...] | None:
    """Return the events since a head of the chain; None where the log never had it.

    A head is the SHA-256 of a line of the log, or its first digits; or that of a manifest; or the
    text of the QR code on a report or certificate, which ends with it.
    """
    head = (head.split() or [""])[-1].lower()
    if len(head) < SHOWN:
        raise InputError(f"--head {head}: give {SHOWN} digits of the head, or all 64")
    fitting = {line for line in state.heads if line.startswith(head)}
    try:
        states = States(state.path, RunFolder(state.path).events, state.heads)
        return states.after(fitting.pop() if len(fitting) == 1 else head)
    except StationError:  # log or manifest cannot be read
        return None


def lines(verified: Verified) -> Iterator[str]:
    """Yield what is printed of one folder."""
    state = verified.state
    if verified.changed:
        yield f"{state.path}: {verified.word.replace('-', ' ').upper()}"
        yield from (f"  {sentence}" for sentence in verified.changed)
    elif state.no_manifest:
        yield (
            f"{state.path}: not proven: it has no manifest, so its run was killed; its log, its "
            "inputs and its raw blocks agree with their own check sums"
        )
    else:
        files = f"{state.files} files, every byte"
        if not state.recorded:
            files = f"{state.files} files, every byte; revisions not recorded"
        yield f"{state.path}: unchanged, {files}"
    if state.head:
        yield f"  head {state.head}"
    for signature in state.signatures:
        yield from signed(signature, verified.trusted)
    if verified.since is not None:
        yield f"  {len(verified.since)} events since that head" + (":" if verified.since else "")
        for event in verified.since[:MAX_LINES]:
            yield f"    {recorded_in_words(event)}"
        if len(verified.since) > MAX_LINES:
            yield f"    and {len(verified.since) - MAX_LINES} more"


def signed(signature: Signature, trusted: Trusted | None) -> Iterator[str]:
    """Yield what a signature that holds is worth, for people."""
    if signature.state == "forged":
        return
    what = "signed" if signature.state == "valid" else "an earlier state was signed"
    by = f"by {signature.signer} at {signature.time}, key {signature.key[:SHOWN]}"
    if trusted is not None:
        is_one = is_trusted(signature, trusted)
        by = f"{by}, trusted" if is_one else f"by a key that is not trusted: {signature.key}"
    yield f"  {what} {by}"
    yield from (f"    since then: {event}" for event in signature.after)


def make_key(path: Path) -> None:
    """Make a private key and print what stands for it."""
    show(f"{path}: private key, keep it; what it signs has key {new_key(path)}")


def sign_run(folder: Path, key: Path, signer: str) -> int:
    """Sign a run folder that is unchanged; return 1, unsigned, where it is not."""
    verified = verified_run(folder)
    if verified.changed:
        show("\n".join(map(printable, [*lines(verified), "not signed"])))
        return EXIT_OUTSIDE_LIMIT
    signature = sign(folder, key, signer, utc_now())
    show("\n".join([f"{folder}:", *signed(signature, None)]))
    return EXIT_DONE
