"""`station verify`: whether run folders are as their runs left them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from station.clock import utc_now
from station.errors import EXIT_DONE, EXIT_OUTSIDE_LIMIT, EXIT_UNDETERMINED
from station.history.place import is_kept
from station.record.signatures import Signature, new_key, sign
from station.record.verification import Verification, verify

SHOWN = 16
"""Digits of a key's SHA-256 that people compare."""


def verify_runs(folders: Sequence[Path], *, as_json: bool) -> int:
    """Print what was changed in each folder; return 1 where anything was, 6 without a manifest."""
    verifications = [held_against_history(verify(folder), folder) for folder in folders]
    if as_json:
        runs = [verification.to_data() for verification in verifications]
        print(json.dumps({"runs": runs}, indent=1, ensure_ascii=False))
    else:
        for verification in verifications:
            print("\n".join(lines(verification)))
    if any(verification.changed for verification in verifications):
        return EXIT_OUTSIDE_LIMIT
    proven = all(verification.proven for verification in verifications)
    return EXIT_DONE if proven else EXIT_UNDETERMINED


def held_against_history(verification: Verification, folder: Path) -> Verification:
    """Return what was proven, and that the history knows another manifest, where one is kept.

    Whoever writes a run's files and its manifest anew does not change what the history holds.
    """
    parent = folder.resolve().parent
    if verification.changed or not verification.proven or not is_kept(parent):
        return verification
    from station.history.store import History
    from station.record.signatures import head_of

    with closing(History(parent)) as history:
        known = history.head_of(folder.resolve().name)
    if known is None or known == head_of(folder):
        return verification
    sentence = f"{folder} is not what the history took in at its end: its manifest was written anew"
    return replace(verification, changed=(sentence,))


def lines(verification: Verification) -> list[str]:
    """Return what is said of one folder."""
    if verification.changed:
        return [
            f"{verification.run}: ALTERED",
            *(f"  {sentence}" for sentence in verification.changed),
        ]
    if not verification.proven:
        return [
            f"{verification.run}: not proven: it has no manifest, so its run was killed; its log, "
            "its inputs and its raw blocks agree with their own check sums"
        ]
    return [
        f"{verification.run}: unchanged, {verification.files} files",
        *map(_signed, verification.signatures),
    ]


def _signed(signature: Signature) -> str:
    """Return what a signature is worth, for people."""
    what = "signed" if signature.state == "valid" else "an earlier state was signed"
    return f"  {what} by {signature.signer} at {signature.time}, key {signature.key[:SHOWN]}"


def make_key(path: Path) -> None:
    """Make a private key and print what stands for it."""
    print(f"{path}: private key, keep it; what it signs has key {new_key(path)[:SHOWN]}")


def sign_run(folder: Path, key: Path, signer: str) -> int:
    """Sign a run folder that is unchanged; return 1, unsigned, where it is not."""
    verification = held_against_history(verify(folder), folder)
    if verification.changed:
        print("\n".join([*lines(verification), "not signed"]))
        return EXIT_OUTSIDE_LIMIT
    print(f"{folder}:\n{_signed(sign(folder, key, signer, utc_now()))}")
    return EXIT_DONE
