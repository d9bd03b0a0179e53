"""What a run has to do with the history, where one is kept; its run goes on whatever happens."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from station.console import tell
from station.errors import StationError
from station.history.place import is_kept


def out_of_control(bench: str, runs: Path) -> list[str]:
    """Return what the check standards of a bench speak against it; `bench` is its file's name."""
    if not is_kept(runs):
        return []
    from station.history.series import drifted
    from station.history.store import History, Wanted

    try:
        with closing(History(runs)) as history:
            sentences = drifted(history.results(Wanted(bench=bench, check_standard=True)))
    except StationError as error:
        return [str(error)]
    return [
        f"bench {bench} is out of control: {sentence}; look at `station history --bench {bench} "
        "--check-standards` before you trust this run"
        for sentence in sentences
    ]


def remember(folder: Path) -> None:
    """Take a run that has ended into the history."""
    if not is_kept(folder.parent):
        return
    from station.history.store import History

    try:
        with closing(History(folder.parent)) as history:
            history.take_one(folder)
    except StationError as error:
        tell(f"WARNING: the run is not in the history: {error}")
