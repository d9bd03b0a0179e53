"""Signatures of a run folder: who stood for it, when, and in which state (Ed25519, RFC 8032).

A signature is a file of its own in `signatures/`: the words that were signed, and the signature.
They hold the head of the log's chain, the SHA-256 of the line by which the log says that it was
signed; that line holds the SHA-256 of every file. Earlier signatures hold that of the manifest.
A signature proves that whoever had the private key signed this state. It proves neither who that
was nor that the laboratory's clock was right: the laboratory keeps the key and publishes its print.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from functools import cached_property
from getpass import getpass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.errors import InputError, RecordError
from station.files.locks import is_held
from station.record.events import (
    ISSUED,
    RECORDED_LATER,
    RESUMED,
    SIGNED,
    Event,
    recorded_in_words,
)
from station.record.files import A_COPY, is_own_file, not_written, write_whole_file
from station.record.later import record_later
from station.record.layout import EVENTS, LOCK, MANIFEST, SIGNATURES, covered_files, manifest_text

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

PRIVATE_MODE = 0o600
MAX_NAME = 200
MAX_BYTES = 100_000
PEM = re.compile(r"-----BEGIN PUBLIC KEY-----.*?-----END PUBLIC KEY-----", re.DOTALL)
PRINT = re.compile(r"[0-9a-f]{64}")
DAMAGED = (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError)
"""What a signature that somebody has written by hand may raise."""
NO_STATE = "what it signs is no state of this run: it is of another one, or the run was altered"


@dataclass(frozen=True)
class Signature:
    """One signature: who signed when, with which key, and what it is worth for the folder now.

    `state` is `valid`, `earlier` or `forged`, and `why` says what is wrong with a forged one; `key`
    is the SHA-256 of the public key; `after` is what was done since the state of an earlier one.
    """

    file: str
    signer: str
    time: str
    key: str
    state: str
    after: tuple[str, ...] = ()
    why: str = ""

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {**asdict(self), "after": list(self.after)}


def read_trusted(text: str, where: str) -> dict[str, str]:
    """Return the names that trusted keys may sign in, by their prints; "" for any name.

    A line is the SHA-256 of a public key in 64 hexadecimal digits, then a name or nothing; `#`
    begins a comment. A public key itself, as PEM, is trusted in any name. Raises InputError.
    """
    trusted = {_print_of_pem(block, where): "" for block in PEM.findall(text)}
    lines = PEM.sub(lambda block: "\n" * block[0].count("\n"), text).splitlines()
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].strip()
        if not words:
            continue
        digits, name = (*words.split(maxsplit=1), "")[:2]
        if not PRINT.fullmatch(digits.lower()):
            raise InputError(
                f"{where}:{number}: no trusted key: a line is the 64 digits that `station sign "
                "--new-key` and `station verify --json` give for a key, then the name it signs in"
            )
        trusted[digits.lower()] = name
    return trusted


def _print_of_pem(block: str, where: str) -> str:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    try:
        key = load_pem_public_key(block.encode())
    except ValueError as error:
        raise InputError(f"{where}: a public key in it cannot be read: {error}") from error
    if not isinstance(key, Ed25519PublicKey):
        raise InputError(f"{where}: a public key in it is no Ed25519 key")
    return _print_of(key.public_bytes_raw())


def is_trusted(signature: Signature, trusted: Mapping[str, str]) -> bool:
    """Whether a signature that holds is by a trusted key, in the name that goes with it."""
    name = trusted.get(signature.key)
    return signature.state != "forged" and name is not None and name in ("", signature.signer)


def names_of_several(
    signatures: Sequence[Signature], trusted: Mapping[str, str] | None
) -> Iterator[str]:
    """Yield a sentence for each key that signs in a name in which another one signs, too.

    Those that are trusted may all sign in one name.
    """
    first: dict[str, Signature] = {}
    whole = [signature for signature in signatures if signature.state != "forged"]
    whole.sort(key=lambda signature: not is_trusted(signature, trusted or {}))
    for signature in whole:
        other = first.setdefault(signature.signer, signature)
        if other.key != signature.key and not is_trusted(signature, trusted or {}):
            yield (
                f"{signature.file} is signed in the name of {signature.signer} by another key "
                f"({signature.key}) than {other.file} ({other.key}); say with --trusted which is "
                "the laboratory's"
            )


def new_key(path: Path) -> str:
    """Write a new private key (PEM, for its owner's eyes) and return the public key's SHA-256.

    Raises InputError where the file exists or cannot be written.
    """
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    key = Ed25519PrivateKey.generate()
    text = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    try:
        opened = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE_MODE)
    except OSError as error:
        raise InputError(f"cannot write the key {path}: {error.strerror}") from error
    with os.fdopen(opened, "wb") as file:
        file.write(text)
    return _print_of(key.public_key().public_bytes_raw())


def sign(folder: Path, key_path: Path, signer: str, time: datetime) -> Signature:
    """Sign the state of a run folder, keep the signature in it, and say so in its log.

    Raises InputError for a key that cannot be read, a name that cannot be printed, and for a run
    that is going on or has no manifest.
    """
    if is_held(folder / LOCK) or not (folder / MANIFEST).is_file():
        raise InputError(f"{folder} has no {MANIFEST} yet: sign a run once it has ended")
    if not _is_name(signer):
        raise InputError(f"{signer!a} is no name: write who signs, in characters that print")
    key = _private_key(key_path)
    public = key.public_key().public_bytes_raw()
    place = folder / SIGNATURES
    try:
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise not_written(place, error, A_COPY) from error
    numbers = (int(path.stem) for path in place.iterdir() if path.stem.isdecimal())
    file = place / f"{max(numbers, default=-1) + 1:03}.json"
    stated = {"signer": signer, "time": time.isoformat(timespec="seconds")}

    def write(head: str) -> None:
        words = json.dumps(stated | {"head": head, "of": EVENTS}, sort_keys=True)
        kept = {
            "signed": words,
            "signature": base64.b64encode(key.sign(words.encode())).decode(),
            "public_key": base64.b64encode(public).decode(),
        }
        write_whole_file(file, (json.dumps(kept, indent=1) + "\n").encode())

    details = {"signature": file.name, "signer": signer, "key": _print_of(public)}
    try:
        record_later(folder, SIGNED, details, write)
    except RecordError:
        file.unlink(missing_ok=True)
        raise
    return Signature(file.name, signer, stated["time"], _print_of(public), "valid")


def _is_name(text: str) -> bool:
    return bool(text.strip()) and text.isprintable() and len(text) <= MAX_NAME


def _private_key(path: Path) -> Ed25519PrivateKey:
    """Return a private key, asking for its password where it has one; raises InputError."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    if path.exists() and not path.is_file():
        raise InputError(f"cannot read the key {path}: it is no plain file")
    try:
        text = path.read_bytes()
        try:
            key = load_pem_private_key(text, password=None)
        except TypeError:  # it is encrypted
            key = load_pem_private_key(text, password=_password(path).encode())
    except (OSError, TypeError, ValueError) as error:
        raise InputError(f"cannot read the key {path}: {error}") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise InputError(f"{path} is no Ed25519 key; make one with `station sign --new-key`")
    return key


def _password(path: Path) -> str:
    if not sys.stdin.isatty():
        raise InputError(
            f"the key {path} is encrypted, and there is no terminal to ask for its password; sign "
            "at a terminal"
        )
    try:
        return getpass(f"password of the key {path}: ")
    except EOFError as error:
        raise InputError(f"the key {path} is encrypted, and no password was given") from error


def signatures_of(
    folder: Path, events: Sequence[Event], heads: Sequence[str]
) -> Iterator[Signature]:
    """Yield the signatures that a run folder holds, each held against its log.

    `heads` are the SHA-256 of the log's lines.
    """
    place = folder / SIGNATURES
    states = States(folder, events, heads)
    for path in sorted(place.iterdir()) if place.is_dir() else ():
        yield _read(path, states)


class States:
    """The states that a run folder was in, by what stood for each: a line of its log, a manifest.

    What was done with a folder once its run had ended changes no file that its manifest covers but
    the log, and adds certificates, so that each manifest of before can be made again.
    """

    def __init__(self, folder: Path, events: Sequence[Event], heads: Sequence[str]) -> None:
        self._folder = folder
        self._events = events
        self.heads = heads

    def after(self, head: str) -> tuple[Event, ...] | None:
        """Return the events since a state; None where the run never was in it."""
        if head in self.heads:
            return tuple(self._events[self.heads.index(head) + 1 :])
        later = self._manifests.get(head)
        return None if later is None else tuple(self._events[later:])

    @cached_property
    def _manifests(self) -> dict[str, int]:
        """Return how many lines the log had, by the SHA-256 of the manifest of that time."""
        digest, lines = hashlib.sha256(), dict[str, int]()
        if not (self._events and is_own_file(self._folder / EVENTS)):
            return lines
        files = covered_files(self._folder)
        log = (self._folder / EVENTS).read_bytes().splitlines(keepends=True)
        for count, line in enumerate(log, start=1):
            digest.update(line)
            later = self._events[count:]
            if EVENTS in files and all(event.kind in RECORDED_LATER for event in later):
                since = {event.details.get("file") for event in later if event.kind == ISSUED}
                of_then = {name: sha for name, sha in files.items() if name not in since}
                text = manifest_text({**of_then, EVENTS: digest.hexdigest()})
                lines[hashlib.sha256(text.encode()).hexdigest()] = count
        return lines


def _read(path: Path, states: States) -> Signature:
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    if not is_own_file(path) or path.stat().st_size > MAX_BYTES:
        return Signature(path.name, "", "", "", "forged", why="it is no plain file")
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        public = base64.b64decode(kept["public_key"], validate=True)
        signature = base64.b64decode(kept["signature"], validate=True)
        Ed25519PublicKey.from_public_bytes(public).verify(signature, kept["signed"].encode())
        stated = json.loads(kept["signed"])
        signer, time, head = (str(stated[key]) for key in ("signer", "time", "head"))
    except (InvalidSignature, *DAMAGED):
        return Signature(path.name, "", "", "", "forged", why="it was altered")
    if not (_is_name(signer) and time.isprintable()):
        return Signature(path.name, "", "", "", "forged", why="its name cannot be printed")
    later = states.after(head)
    if later is None:
        return Signature(path.name, signer, time, _print_of(public), "forged", why=NO_STATE)
    done = (event for event in later if event.kind in (*RECORDED_LATER, RESUMED))
    after = tuple(recorded_in_words(event) for event in done)
    same = all(event.kind == SIGNED for event in later)
    state = "valid" if same else "earlier"
    return Signature(path.name, signer, time, _print_of(public), state, () if same else after)


def _print_of(public: bytes) -> str:
    return hashlib.sha256(public).hexdigest()
