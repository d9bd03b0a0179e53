"""What a run has to do with the history, where one is kept; its run goes on whatever happens."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from station.console import tell
from station.errors import StationError
from station.history.place import is_kept
from station.record.events import STANDARD_ALARM
from station.record.layout import PLAN
from station.runner.preflight import Warned

if TYPE_CHECKING:
    from station.history.alarms import Alarm
    from station.history.store import Entry, History

CHECK_STANDARD = re.compile("^check_standard: true$", re.MULTILINE)
"""How the resolved plan of a run says so, as the station writes it."""
MANY = 5
"""Alarms that a run names each."""


def standing_alarms(bench: str, runs: Path) -> list[Warned]:
    """Return what the check standards of a bench speak against it; `bench` is its file's name."""
    if not is_kept(runs):
        return []
    from station.history.store import History

    try:
        with closing(History(runs)) as history:
            alarms = alarms_standing(history, lambda entry: entry.bench == bench)
    except StationError as error:
        return [Warned("history-unread", str(error))]
    warned = [
        Warned(
            STANDARD_ALARM,
            f"alarm {alarm.identity} of bench {bench} stands until somebody acknowledges it with a "
            f"reason (`station history --bench {bench} --check-standards`): {alarm.sentence()}",
        )
        for alarm in alarms[-MANY:]
    ]
    if len(alarms) > MANY:
        older = f"{len(alarms) - MANY} older alarms of bench {bench} stand too"
        warned.append(Warned(STANDARD_ALARM, older))
    return warned


def remember(folder: Path) -> None:
    """Take a run that has ended into the history, and say what alarm it raises.

    A run of a check standard begins the history where nobody keeps one: its chart is the history's.
    """
    begins = not is_kept(folder.parent)
    if begins and not of_check_standard(folder):
        return
    from station.history.store import History

    try:
        with closing(History(folder.parent)) as history:
            if begins:
                history.take_in()
            history.take_one(folder)
            raised = alarms_standing(history, lambda entry: entry.run == folder.name)
    except StationError as error:
        tell(f"WARNING: the run is not in the history: {error}")
        return
    for alarm in raised:
        tell(f"WARNING: this run raises alarm {alarm.identity}: {alarm.sentence()}")


def of_check_standard(folder: Path) -> bool:
    """Whether the plan of a run measures a check standard of the bench."""
    try:
        plan = (folder / PLAN).read_text(encoding="utf-8")
    except OSError:
        return False
    return CHECK_STANDARD.search(plan) is not None


def alarms_standing(history: History, of: Callable[[Entry], bool]) -> list[Alarm]:
    """Return the alarms that nobody acknowledged, of some of the results, oldest first."""
    from station.history.alarms import alarms_of
    from station.history.store import Wanted

    alarms = alarms_of(history.results(Wanted(check_standard=True)), history.acknowledgements())
    return [alarm for alarm in alarms if alarm.stands and of(alarm.entry)]
