"""Results put into rows: of a unit over time, of a type over its units, of a bench's standard."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from station.history.charts import Chart, capability, chart_of
from station.history.store import Entry


@dataclass(frozen=True)
class Series:
    """One result of one procedure in the order of time, all in one unit."""

    procedure: str
    name: str
    axis: str | None
    unit: str
    simulated: bool
    entries: Sequence[Entry]

    @property
    def title(self) -> str:
        """How people name it."""
        named = " ".join(filter(None, (self.name.replace("_", " "), self.axis)))
        return f"{named} (simulated)" if self.simulated else named

    @property
    def values(self) -> list[float]:
        """The values that were determined."""
        return [entry.value for entry in self.entries if entry.value is not None]

    def chart(self) -> Chart | None:
        """Return the control chart of these values."""
        return chart_of(self.values)

    def newest_of_each_unit(self) -> list[Entry]:
        """Return the last determined result of each serial number; standards are no units."""
        units = (entry for entry in self.entries if not entry.check_standard)
        newest = {unit.serial: unit for unit in units if unit.value is not None}
        return list(newest.values())

    def capability(self) -> float | None:
        """Return Cpk over the units, against the limits of the newest result."""
        newest = self.newest_of_each_unit()
        if not newest:
            return None
        last = newest[-1]
        values = [entry.value for entry in newest if entry.value is not None]
        return capability(values, last.limit_min, last.limit_max)


def series_of(entries: Iterable[Entry]) -> list[Series]:
    """Return results grouped by procedure, name, axis and unit, in the order of first coming.

    Simulated runs are rows of their own: they say nothing of a real unit.
    """
    groups = dict[tuple[str, str, str | None, str, bool], list[Entry]]()
    for entry in entries:
        key = (entry.procedure, entry.name, entry.axis, entry.unit, entry.simulated)
        groups.setdefault(key, []).append(entry)
    return [Series(*key, entries) for key, entries in groups.items()]
