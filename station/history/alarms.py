"""Alarms of check standards: each stands until somebody acknowledges it with a reason."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

from station.errors import InputError
from station.history.series import Series, series_of
from station.history.store import Acknowledgement, Entry

Known = Mapping[str, Sequence[Acknowledgement]]
DIGITS = 8
"""Of the SHA-256 that names an alarm."""


@dataclass(frozen=True)
class Alarm:
    """A value of a check standard that broke a rule when it came."""

    identity: str
    entry: Entry
    title: str
    rule: str
    acknowledged: Sequence[Acknowledgement]

    @property
    def stands(self) -> bool:
        """Whether nobody took note of it."""
        return not self.acknowledged

    @property
    def of_chart(self) -> tuple[str, str, str, str]:
        """What its chart is of."""
        return self.entry.bench, self.entry.serial, self.entry.procedure, self.title

    def sentence(self) -> str:
        """Say which value it is, and what is wrong with it."""
        day = self.entry.started_utc[:10]
        return f"check standard {self.entry.serial}: {self.title} of {day} is {self.rule}"

    def to_data(self) -> dict[str, Any]:
        """Return the alarm as plain data."""
        of = ("bench", "serial", "run", "started_utc", "procedure", "name", "axis", "value", "unit")
        return {
            "alarm": self.identity,
            "stands": self.stands,
            **{key: getattr(self.entry, key) for key in of},
            "rule": self.rule,
            "acknowledged": [asdict(note) for note in self.acknowledged],
        }


def identity_of(entry: Entry) -> str:
    """Return what names the alarm of a result; it is the same after the history was rebuilt."""
    of = f"{entry.key or entry.run} {entry.name} {entry.axis}"
    return hashlib.sha256(of.encode()).hexdigest()[:DIGITS]


def rows_of_standards(entries: Iterable[Entry], known: Known) -> list[Series]:
    """Return a row for each result of each check standard on each bench, for every baseline.

    Two standards differ by more than either wanders, and so do two benches.
    """
    groups = dict[tuple[str, str], list[Entry]]()
    for entry in entries:
        if entry.check_standard and entry.value is not None:
            groups.setdefault((entry.bench, entry.serial), []).append(entry)
    rows = list[Series]()
    for mine in groups.values():
        for series in series_of(mine):
            ends = [
                number
                for number, entry in enumerate(series.entries, start=1)
                if any(note.new_baseline for note in known.get(identity_of(entry), ()))
            ]
            for first, last in pairwise([0, *ends, len(series.entries)]):
                if first < last:
                    rows.append(replace(series, entries=series.entries[first:last]))
    return rows


def alarms_of(entries: Iterable[Entry], known: Known) -> list[Alarm]:
    """Return the alarms of check standards, oldest first, those that were acknowledged too."""
    alarms = list[Alarm]()
    for series in rows_of_standards(entries, known):
        chart = series.chart()
        for number, rule in chart.alarms.items() if chart is not None else ():
            entry = series.entries[number]
            name = identity_of(entry)
            alarms.append(Alarm(name, entry, series.title, rule, known.get(name, ())))
    return sorted(alarms, key=lambda alarm: alarm.entry.started_utc)


def alarms_named(alarms: Sequence[Alarm], names: Iterable[str]) -> list[Alarm]:
    """Return the alarms of some names, oldest first; raises InputError where one has none."""
    wanted, known = set(names), {alarm.identity for alarm in alarms}
    for name in sorted(wanted):
        if name not in known:
            standing = ", ".join(alarm.identity for alarm in alarms if alarm.stands)
            raise InputError(f"there is no alarm {name}; those that stand: {standing or 'none'}")
    return [alarm for alarm in alarms if alarm.identity in wanted]
