"""`station history`: the results of past runs, listed, printed and plotted."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path

from station.clock import utc_now
from station.console import tell
from station.errors import InputError
from station.files.statements import says_something
from station.history.alarms import Alarm, Known, alarms_named, alarms_of
from station.history.series import Series, series_of
from station.history.store import Acknowledgement, Entry, History, Wanted
from station.record.files import write_whole_file
from station.record.stores import is_url
from station.report.numbers import format_with_uncertainty
from station.safety.acknowledgement import user_name
from station.speech import in_columns, said, show

NEWEST = 20
"""How many runs of a row are printed; the page and --json have all."""


def show_history(
    parent: Path,
    wanted: Wanted,
    *,
    rebuild: bool,
    store: str | None = None,
    page: Path | None,
    as_json: bool,
) -> None:
    """Take in what is new below `parent`, then print, plot or give the results asked for.

    With `rebuild` all that is there is read again, or that of a `store`, a folder or a URL.
    """
    with closing(History(parent)) as history:
        if store is not None and is_url(store):
            count, left_out = history.rebuild_from(store)
        elif rebuild:
            count, left_out = history.rebuild(None if store is None else Path(store))
        else:
            count, left_out = history.take_in()
        entries, known = history.results(wanted), history.acknowledgements()
    alarms = alarms_of(entries, known)
    for sentence in left_out:
        tell(f"WARNING: {sentence}")
    if rebuild:
        tell(f"{count} runs taken into the history")
    if page is not None:
        _write(page, entries, wanted, known)
    elif as_json:
        results = [asdict(entry) for entry in entries]
        told = {"results": results, "alarms": [alarm.to_data() for alarm in alarms]}
        print(json.dumps(told, indent=1, ensure_ascii=False))
    elif entries:
        print("\n\n".join("\n".join(lines(series)) for series in series_of(entries)))
        for line in lines_of_alarms(alarms):
            print(line)
    else:
        show(f"no results {about(wanted)}")


def acknowledge_alarms(
    parent: Path, names: Sequence[str], reason: str, *, new_baseline: bool, as_json: bool
) -> None:
    """Keep that this user took note of alarms; raises InputError without a reason, or an alarm.

    Of several alarms of a chart the new baseline begins after the last of them.
    """
    if not says_something(reason) or not reason.isprintable():
        raise InputError(
            "say by --reason, in a line, what the cause was and what was done about it"
        )
    with closing(History(parent)) as history:
        for sentence in history.take_in()[1]:
            tell(f"WARNING: {sentence}")
        entries = history.results(Wanted(check_standard=True))
        every = alarms_of(entries, history.acknowledgements())
        alarms = alarms_named(every, names)
        last = {alarm.of_chart: alarm.identity for alarm in alarms}
        if new_baseline:
            refuse_alarms_behind(every, alarms)
        now, who = utc_now().isoformat(timespec="seconds"), user_name() or "unknown"
        notes = [
            Acknowledgement(
                alarm.identity,
                alarm.sentence(),
                who,
                now,
                reason.strip(),
                new_baseline and last[alarm.of_chart] == alarm.identity,
            )
            for alarm in alarms
        ]
        history.acknowledge(notes)
    done = [
        replace(alarm, acknowledged=(*alarm.acknowledged, note))
        for alarm, note in zip(alarms, notes, strict=True)
    ]
    if as_json:
        told = {"alarms": [alarm.to_data() for alarm in done]}
        print(json.dumps(told, indent=1, ensure_ascii=False))
        return
    for line in lines_of_alarms(done):
        print(line)
    if new_baseline:
        show("the next run of the standard begins a new baseline")


def refuse_alarms_behind(every: Sequence[Alarm], named: Sequence[Alarm]) -> None:
    """Raise InputError where an alarm stands that came after those after which a baseline begins.

    It would be gone without anybody's reason.
    """
    last = {alarm.of_chart: alarm.entry.started_utc for alarm in named}
    for alarm in every:
        begins_after = last.get(alarm.of_chart, alarm.entry.started_utc)
        if alarm.stands and alarm not in named and alarm.entry.started_utc > begins_after:
            raise InputError(
                f"alarm {alarm.identity} came later and stands: {alarm.sentence()}; a new "
                "baseline begins after it, so acknowledge it too"
            )


def lines_of_alarms(alarms: Sequence[Alarm]) -> list[str]:
    """Return a line about each of the newest alarms, and one for each time it was acknowledged."""
    printed = list[str]()
    for alarm in alarms[-NEWEST:]:
        state = said("STANDS" if alarm.stands else "acknowledged")
        bench = f"{said('bench')} {alarm.entry.bench}"
        printed.append(f"{alarm.identity}  {state}  {bench}  {said(alarm.sentence())}")
        for note in alarm.acknowledged:
            anew = f"  {said('new baseline')}" if note.new_baseline else ""
            printed.append(f"    {note.acknowledged_utc}  {note.who}  {note.reason}{anew}")
    heading = [said("alarms of check standards:")] if alarms else []
    return heading + printed


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


def _write(page: Path, entries: Sequence[Entry], wanted: Wanted, known: Known) -> None:
    from station.history.page import page_of

    if not entries:
        raise InputError(f"there are no results {about(wanted)} to plot")
    try:
        text = page_of(series_of(entries), f"Results {about(wanted)}.", known)
        write_whole_file(page, text.encode())
    except OSError as error:
        raise InputError(f"cannot write {page}: {error.strerror}") from error
    show(f"history: {page}")
