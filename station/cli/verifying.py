"""`station verify`: whether run folders are as their runs left them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from station.errors import EXIT_DONE, EXIT_OUTSIDE_LIMIT, EXIT_UNDETERMINED
from station.history.place import is_kept
from station.record.verification import Verification, verify


def verify_runs(folders: Sequence[Path], *, as_json: bool) -> int:
    """Print what was changed in each folder; return 1 where anything was, 6 without a manifest."""
    found = [held_against_history(verify(one), one) for one in folders]
    if as_json:
        print(json.dumps({"runs": [one.to_data() for one in found]}, indent=1, ensure_ascii=False))
    else:
        for one in found:
            print("\n".join(lines(one)))
    if any(one.changed for one in found):
        return EXIT_OUTSIDE_LIMIT
    return EXIT_DONE if all(one.proven for one in found) else EXIT_UNDETERMINED


def held_against_history(found: Verification, folder: Path) -> Verification:
    """Return what was proven, and that the history knows another manifest, where one is kept.

    Whoever writes a run's files and its manifest anew does not change what the history holds.
    """
    parent = folder.resolve().parent
    if found.changed or not found.proven or not is_kept(parent):
        return found
    from station.history.store import History
    from station.history.summary import head_of

    with closing(History(parent)) as history:
        known = history.head_of(folder.resolve().name)
    if known is None or known == head_of(folder):
        return found
    said = f"{folder} is not what the history took in at its end: its manifest was written anew"
    return replace(found, changed=(said,))


def lines(one: Verification) -> list[str]:
    """Return what is said of one folder."""
    if one.changed:
        return [f"{one.run}: ALTERED", *(f"  {sentence}" for sentence in one.changed)]
    if not one.proven:
        return [
            f"{one.run}: not proven: it has no manifest, so its run was killed; its log, its "
            "inputs and its raw blocks agree with their own check sums"
        ]
    return [f"{one.run}: unchanged, {one.files} files"]
