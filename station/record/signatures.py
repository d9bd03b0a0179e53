"""Signatures of a run folder: who stood for it, when, and in which state (Ed25519, RFC 8032).

A signature is a file of its own in `signatures/`: the words that were signed, and the signature.
They hold the head of the folder, the SHA-256 of its manifest, which holds that of every other file.
A signature proves that whoever had the private key signed this state. It proves neither who that
was nor that the laboratory's clock was right: the laboratory keeps the key and publishes its print.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from station.errors import InputError
from station.files.locks import is_held
from station.record.files import write_whole_file
from station.record.layout import EVENTS, LOCK, MANIFEST, SIGNATURES

PRIVATE_MODE = 0o600


@dataclass(frozen=True)
class Signature:
    """One signature: who signed when, with which key, and what it is worth for the folder now.

    `state` is `valid`, `earlier` (the folder was analysed again since) or `forged`; `key` is the
    SHA-256 of the public key.
    """

    signer: str
    time: str
    key: str
    state: str

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"signer": self.signer, "time": self.time, "key": self.key, "state": self.state}


def head_of(folder: Path) -> str:
    """Return the SHA-256 that stands for a whole run folder: that of its manifest.

    The manifest holds that of every file, of the log too, whose lines hold one another's. A run
    that was killed has no manifest: then it is the SHA-256 of its log.
    """
    manifest = folder / MANIFEST
    sealed = manifest if manifest.is_file() else folder / EVENTS
    return hashlib.sha256(sealed.read_bytes()).hexdigest()


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
    """Sign the state of a run folder and keep the signature in it.

    Raises InputError for a key that cannot be read, and for a run that is going on or has no
    manifest.
    """
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    if is_held(folder / LOCK) or not (folder / MANIFEST).is_file():
        raise InputError(f"{folder} has no {MANIFEST} yet: sign a run once it has ended")
    try:
        key = load_pem_private_key(key_path.read_bytes(), password=None)
    except (OSError, TypeError, ValueError) as error:
        raise InputError(f"cannot read the key {key_path}: {error}") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise InputError(f"{key_path} is no Ed25519 key; make one with `station sign --new-key`")
    head = head_of(folder)
    stated = {"run": folder.resolve().name, "head": head, "signer": signer}
    words = json.dumps(stated | {"time": time.isoformat(timespec="seconds")}, sort_keys=True)
    public = key.public_key().public_bytes_raw()
    kept = {
        "signed": words,
        "signature": base64.b64encode(key.sign(words.encode())).decode(),
        "public_key": base64.b64encode(public).decode(),
    }
    place = folder / SIGNATURES
    place.mkdir(exist_ok=True)
    number = sum(1 for _ in place.iterdir())
    write_whole_file(place / f"{number:03}.json", (json.dumps(kept, indent=1) + "\n").encode())
    return Signature(signer, json.loads(words)["time"], _print_of(public), "valid")


def signatures_of(folder: Path) -> Iterator[Signature]:
    """Yield the signatures that a run folder holds, each held against it as it is now."""
    place = folder / SIGNATURES
    head = head_of(folder)
    for path in sorted(place.iterdir()) if place.is_dir() else ():
        yield _read(path, folder.resolve().name, head)


def _read(path: Path, run: str, head: str) -> Signature:
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        public = base64.b64decode(kept["public_key"], validate=True)
        signature = base64.b64decode(kept["signature"], validate=True)
        Ed25519PublicKey.from_public_bytes(public).verify(signature, kept["signed"].encode())
        stated = json.loads(kept["signed"])
        signer, time = str(stated["signer"]), str(stated["time"])
        same = stated["head"] == head and stated["run"] == run
    except (InvalidSignature, OSError, ValueError, KeyError, TypeError, AttributeError):
        return Signature(path.name, "", "", "forged")
    return Signature(signer, time, _print_of(public), "valid" if same else "earlier")


def _print_of(public: bytes) -> str:
    return hashlib.sha256(public).hexdigest()
