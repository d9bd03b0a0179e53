"""Which finished units of work a damaged raw file spoils.

Where the log says how long each raw file was when a unit was finished, a unit's rows stand before
that byte. Beside it the run times of the blocks tell, and the unit that a damaged block still
names: whatever of them points to a unit takes it out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from station.files.lookup import is_there
from station.record.blocks import END
from station.record.events import RESUMED, Event
from station.record.layout import RAW
from station.record.scan import CUT, DAMAGED_BLOCK, DAMAGED_END, MISPLACED, MISSING, Part, Scan

SAME_TIME_S = 1e-8
CUT_SHORT = "where it ends: what was written behind is missing"


@dataclass(frozen=True)
class DamagedPart:
    """A part of a raw file that cannot be believed, and the finished units of work it spoils.

    It spoils none where it is not `needed`: where no value is made of what its source read.
    """

    file: str
    byte: int
    length: int
    what: str
    units: tuple[str, ...]
    needed: bool = True


@dataclass(frozen=True)
class Span:
    """When a finished unit of work was measured, and how long the raw files were at its end.

    `sizes` are the bytes by source, None in the log of a run that did not write them; `before`
    those at the end of the unit before.
    """

    unit: str
    segment: int
    began_s: float
    ended_s: float
    before: Mapping[str, int]
    sizes: Mapping[str, int] | None

    def meets(self, part: Part) -> bool:
        """Whether the unit was being measured when a part of a raw file was written."""
        return part.to_s > self.began_s + SAME_TIME_S and part.from_s <= self.ended_s + SAME_TIME_S

    def within(self, name: str, began: int, ended: float) -> bool:
        """Whether a raw file holds data of the unit between two bytes; True where nobody knows."""
        if self.sizes is None:
            return True
        first, behind = self.before.get(source_of(name), 0), self.sizes.get(source_of(name), 0)
        return max(first, began) < min(behind, ended)


def spans_of(events: Sequence[Event]) -> list[Span]:
    """Return the spans of the finished units, each as it was finished last."""
    spans: dict[str, Span] = {}
    began: dict[str, float] = {}
    sizes: Mapping[str, int] = {}
    previous_s = -math.inf
    for event in events:
        if event.kind == RESUMED:
            sizes, began = {}, {}
        elif event.kind == "unit-started":
            began[event.details["unit"]] = event.time_s
        elif event.kind == "unit-finished":
            unit, now = event.details["unit"], event.details.get("raw_bytes")
            segment = int(event.details.get("segment", 0))
            began_s = began.get(unit, previous_s)
            spans[unit] = Span(unit, segment, began_s, event.time_s, sizes, now)
            sizes, previous_s = now or {}, event.time_s
    return list(spans.values())


def damaged_parts(
    name: str, scan: Scan, finished: Sequence[Span], *, as_it_was: bool | None
) -> Iterator[DamagedPart]:
    """Yield the damaged parts of a raw file with the units they spoil.

    `as_it_was` says whether the file is the one of the manifest, None without one. A file without
    its end is what a kill leaves: nothing is missed behind its last whole block unless a finished
    unit had more.
    """
    own = [span for span in finished if span.segment == segment_of(name)]
    torn = not scan.sealed and as_it_was is not False
    whole = [part for part in scan.parts if not (torn and part.what == CUT)]
    cut = [] if scan.sealed else [part for part in own if _is_cut(part, name, scan, torn=torn)]
    if scan.sealed and not any(part.what == MISSING for part in whole):
        behind = scan.size - len(END)  # the last blocks may be missing, neatly
        cut = [
            part for part in own if part.sizes is not None and part.within(name, behind, math.inf)
        ]
    if any(part.what == DAMAGED_END for part in whole):
        cut = []
    known = {span.unit for span in own}
    for part in whole:
        sure = len(part.units) == 1 and part.units[0] not in known
        anybody = part.what == DAMAGED_BLOCK and not sure
        spoiled = [
            span.unit
            for span in own
            if (
                _is_around(span, name, part)
                if part.what in (MISPLACED, MISSING)
                else span.within(name, part.began, part.began + part.length)
                and (
                    span.meets(part)
                    or span.unit in part.units
                    or (anybody and span.sizes is not None)
                )
            )
        ]
        if part.what == CUT:
            spoiled += [span.unit for span in cut]
        yield DamagedPart(name, part.began, part.length, part.what, tuple(dict.fromkeys(spoiled)))
    if cut and not any(part.what == CUT for part in whole):
        units = tuple(span.unit for span in cut)
        yield DamagedPart(name, scan.whole_bytes, 0, CUT_SHORT, units)


def _is_around(span: Span, name: str, part: Part) -> bool:
    """Whether a unit lacks the block in whose place another stands, or none.

    Where blocks are missing, all behind them stand nearer to the file's beginning than the log has
    it: the blocks around tell.
    """
    if part.what == MISPLACED and span.sizes is not None:
        stood_here = span.within(name, part.began, part.began + part.length)
        return stood_here or part.units == (span.unit,)
    return span.meets(part) or span.unit in part.units


def _is_cut(span: Span, name: str, scan: Scan, *, torn: bool) -> bool:
    """Whether a file without its end lacks rows of a finished unit."""
    if span.sizes is not None:
        return span.within(name, scan.whole_bytes, math.inf)
    return not torn and span.ended_s >= scan.last_s


def lost_file(name: str, finished: Sequence[Span]) -> DamagedPart:
    """Return what it means that a raw file of the manifest is gone."""
    own = [span for span in finished if span.segment == segment_of(name)]
    units = tuple(span.unit for span in own if span.within(name, 0, math.inf))
    return DamagedPart(name, 0, 0, "the file is gone", units)


def raw_files(folder: Path) -> list[Path]:
    """Return the raw files of a run; a pipe, a folder or a link to nowhere is none."""
    named = (folder / RAW).glob("*-[0-9][0-9][0-9].mcap")
    return sorted(file for file in named if is_there(file))


def source_of(name: str) -> str:
    """Return the source that a raw file, `<source>-<segment>.mcap`, belongs to."""
    return Path(name).stem.rpartition("-")[0]


def segment_of(name: str) -> int:
    """Return the number of the process that wrote a raw file, -1 where it has none."""
    number = Path(name).stem.rpartition("-")[2]
    return int(number) if number.isdecimal() else -1
