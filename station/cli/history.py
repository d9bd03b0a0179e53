"""`station history`: the results of past runs, listed, printed and plotted."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

from station.console import tell
from station.errors import InputError
from station.history.series import Series, series_of
from station.history.store import Entry, History, Wanted
from station.record.files import write_whole_file
from station.report.numbers import format_with_uncertainty
from station.speech import in_columns, said, show

NEWEST = 20
"""How many runs of a row are printed; the page and --json have all."""


def show_history(
    parent: Path, wanted: Wanted, *, rebuild: bool, page: Path | None, as_json: bool
) -> None:
    """Take in what is new below `parent`, then print, plot or give the results asked for."""
    with closing(History(parent)) as history:
        count, left_out = history.rebuild() if rebuild else history.take_in()
        entries = history.results(wanted)
    for sentence in left_out:
        tell(f"WARNING: {sentence}")
    if rebuild:
        tell(f"{count} runs taken into the history")
    if page is not None:
        _write(page, entries, wanted)
    elif as_json:
        print(json.dumps({"results": [asdict(entry) for entry in entries]}, indent=1))
    elif entries:
        print("\n\n".join("\n".join(lines(series)) for series in series_of(entries)))
    else:
        show(f"no results {about(wanted)}")


def about(wanted: Wanted) -> str:
    """Return what was asked for, in words."""
    names = {"serial": "unit", "name": "result"}
    asked = [
        f"{names.get(key, key).replace('_', ' ')} {value}"
        for key, value in asdict(wanted).items()
        if value is not None and value is not True
    ]
    if wanted.check_standard:
        asked.append("check standards alone")
    return f"of {', '.join(asked)}" if asked else "of all runs"


def lines(series: Series) -> list[str]:
    """Return the newest runs of a row, a line each, under its title."""
    shown = series.entries[-NEWEST:]
    rows = in_columns([_cells(entry) for entry in shown])
    more = len(series.entries) - len(shown)
    head = f"{series.procedure}  {title_of(series)}, {series.unit}"
    left_out = said(f"  ({more} earlier runs not shown)") if more else ""
    return [head + left_out, *(f"  {row}" for row in rows), *_verdict(series)]


def title_of(series: Series) -> str:
    """Return what a row is called in the language of this terminal."""
    words = (said(series.name.replace("_", " ")), series.axis)
    return " ".join(filter(None, (*words, said("(simulated)") if series.simulated else "")))


def _cells(entry: Entry) -> Sequence[str]:
    value, uncertainty = format_with_uncertainty(entry.value, entry.expanded_uncertainty)
    number = value if entry.value is None else f"{value} ± {uncertainty}"
    return (
        entry.started_utc[:16].replace("T", " "),
        entry.serial,
        number,
        said(entry.verdict),
        entry.run,
    )


def _verdict(series: Series) -> list[str]:
    """Return what the row says as a whole, where there is enough of it."""
    sentences = []
    cpk = series.capability()
    if cpk is not None:
        units = len(series.newest_of_each_unit())
        sentences.append(said(f"  Cpk over {units} units: {cpk:.2f}"))
    return sentences


def _write(page: Path, entries: Sequence[Entry], wanted: Wanted) -> None:
    from station.history.page import page_of

    if not entries:
        raise InputError(f"there are no results {about(wanted)} to plot")
    try:
        write_whole_file(page, page_of(series_of(entries), f"Results {about(wanted)}.").encode())
    except OSError as error:
        raise InputError(f"cannot write {page}: {error.strerror}") from error
    show(f"history: {page}")
