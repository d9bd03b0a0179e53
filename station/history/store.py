"""The history of runs in a database: SQLite beside the run folders, or another by its URL."""

from __future__ import annotations

import re
import socket
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from sqlalchemy import (
    ColumnElement,
    Connection,
    RowMapping,
    Select,
    create_engine,
    delete,
    insert,
    or_,
    select,
)

from station.errors import InputError, StationError
from station.history.place import FILE, URL, beside, url_of
from station.history.summary import DAMAGE, RunSummary, key_of, manifest_head, summary_of
from station.history.tables import ACKNOWLEDGEMENTS, INSTRUMENTS, RESULTS, RUNS
from station.history.versions import PATIENCE_S, bring_up_to_date, write_alone
from station.record.run_list import SEARCHED
from station.record.run_names import runs_below
from station.record.stores import run_at_hand, run_urls
from station.record.verification import was_in

AT_ONCE = 500
NOT_TAKEN_IN = "not what the history took in at its end: its manifest was written anew"
CLASS = re.compile(r"^\([\w.]+\) ")
"""SQLAlchemy puts the name of the driver's exception before what it says."""
WHOLE_STILL = re.compile("locked|readonly|read-only|lock timeout")
"""What a database says that is held by another program, or may not be written: it has no damage."""
NUMBERS = ("value", "standard_uncertainty", "expanded_uncertainty", "limit_min", "limit_max")
TEXTS = (
    "run",
    "computer",
    "folder",
    "started_utc",
    "procedure",
    "model",
    "serial",
    "bench",
    "name",
    "unit",
    "verdict",
)
LISTED = ("run", "procedure", "bench", "serial", "operator", "verdict", "state")
BYTE_ORDER = {"postgresql": "C", "sqlite": "BINARY"}
"""What databases call the order of bytes; PostgreSQL's own may be that of a dictionary."""
_HERE = socket.gethostname()


class HistoryError(StationError):
    """The database of the history cannot be reached or used."""


@dataclass(frozen=True)
class Wanted:
    """Which runs and results are asked for; None asks for all of them."""

    serial: str | None = None
    procedure: str | None = None
    bench: str | None = None
    name: str | None = None
    check_standard: bool | None = None


@dataclass(frozen=True)
class Entry:
    """A result of a run, with what is needed of the run to put it into order."""

    run: str
    computer: str
    folder: str
    started_utc: str
    procedure: str
    model: str
    serial: str
    bench: str
    simulated: bool
    check_standard: bool
    head: str
    key: str | None
    name: str
    axis: str | None
    value: float | None
    unit: str
    standard_uncertainty: float | None
    expanded_uncertainty: float | None
    limit_min: float | None
    limit_max: float | None
    verdict: str


@dataclass(frozen=True)
class Acknowledgement:
    """That somebody took note of an alarm, of which `sentence` says what it was.

    With `new_baseline` the chart begins anew with the run after it: the bench was repaired.
    """

    alarm: str
    sentence: str
    who: str
    acknowledged_utc: str
    reason: str
    new_baseline: bool


class History:
    """The history below one place; every call may raise HistoryError."""

    def __init__(self, parent: Path, url: str | None = None) -> None:
        """Open the history of the run folders below `parent`, and bring its tables up to date.

        With `url` it is the one there, wherever it is kept.
        """
        self._parent = parent
        self.url = url or url_of(parent)
        if url is not None and url.startswith("sqlite:///") and not Path(url[10:]).is_file():
            raise InputError(f"there is no file {url[10:]}, and so no history")
        if self.url == beside(parent) and not parent.is_dir():
            raise InputError(f"there is no folder {parent}, and so no history of its runs")
        with _named(self.url):
            self._engine = create_engine(self.url, connect_args=_patience(self.url))
            bring_up_to_date(self._engine)

    def close(self) -> None:
        """Let go of the database."""
        self._engine.dispose()

    def take_one(self, folder: Path) -> None:
        """Take in one run folder, in the place of what is there of it; may raise InputError."""
        left_out = list[str]()
        self._write([summary_of(folder)], left_out)
        if left_out:
            raise InputError(left_out[0])

    def take_in(self) -> tuple[int, list[str]]:
        """Take in the run folders that the history lacks; return how many, and what was left out.

        A run that had no results when it was taken in is taken in again, and so is one whose
        manifest is another one now. One that was altered since stays as it was taken in.
        """
        with self._begun() as connection:
            columns = (RUNS.c.folder, RUNS.c.head, RUNS.c.verdict)
            here = select(*columns).where(RUNS.c.computer == _HERE, RUNS.c.key.is_not(None))
            known = {
                row.folder: row.head for row in connection.execute(here) if row.verdict is not None
            }
        folders = {folder: known.get(str(folder.resolve())) for folder in runs_below(self._parent)}
        return self._add(
            folder for folder, head in folders.items() if head is None or head != _head(folder)
        )

    def rebuild(self, store: Path | None = None) -> tuple[int, list[str]]:
        """Forget the folders of a store that are gone, and take in every one that is there.

        The store is the parent of the runs where none is named. Returns how many, and what was
        left out. Runs of other folders, and of other computers that share the database, stay; so
        does what was taken in of a folder that was altered since.
        """
        store = store or self._parent
        if not store.is_dir():
            raise InputError(f"there is no folder {store}, and so no history of its runs")
        parent = store.resolve()
        with self._begun() as connection:
            write_alone(connection)
            here = select(RUNS.c.id, RUNS.c.folder).where(RUNS.c.computer == _HERE)
            for row in connection.execute(here).all():
                if Path(row.folder).parent == parent and not Path(row.folder).is_dir():
                    _forget(connection, row.id)
        return self._add(runs_below(store))

    def rebuild_from(self, store: str) -> tuple[int, list[str]]:
        """Take in every run of a store that a URL names, and forget those of it that are gone.

        Of each run all but its raw data is copied to be read. Returns how many, and what was left
        out.
        """
        urls, left_out = run_urls(store), list[str]()
        there, below = set(urls), f"{store.rstrip('/')}/"
        with self._begun() as connection:
            write_alone(connection)
            for row in connection.execute(select(RUNS.c.id, RUNS.c.folder)).all():
                # Here, not in the database: LIKE takes no notice of capitals on some.
                if row.folder.startswith(below) and row.folder not in there:
                    _forget(connection, row.id)
        count = 0
        for url in urls:
            try:
                with run_at_hand(url, raw=False) as folder:
                    count += self._write([summary_of(folder, url)], left_out)
            except InputError as error:
                left_out.append(str(error))
        return count, left_out

    def results(self, wanted: Wanted = Wanted()) -> list[Entry]:
        """Return the results that are asked for, oldest first."""
        with self._begun() as connection:
            entries = [_entry(row) for row in connection.execute(_query(wanted)).mappings()]
        # Sorted here: databases differ in the order of texts, and in that of what is missing.
        return sorted(entries, key=lambda e: (e.started_utc, e.run, e.name, e.axis or ""))

    def runs(self, search: str = "", most: int | None = None, skip: int = 0) -> list[RowMapping]:
        """Return the newest runs but the first few, at most so many, as they were taken in.

        Those alone of which a word holds the text. What is listed of each is what is of a folder,
        with the computer that has it.
        """
        searched = (RUNS.c[name] for name in SEARCHED)
        holds = or_(*(column.icontains(search, autoescape=True) for column in searched))
        listed = (RUNS.c[name] for name in (*LISTED, "computer", "folder"))
        query = select(*listed, RUNS.c.started_utc.label("started"))
        query = query.where(holds) if search else query
        by_bytes = BYTE_ORDER.get(self._engine.dialect.name)
        for column in (RUNS.c.started_utc, RUNS.c.run):
            query = query.order_by((column.collate(by_bytes) if by_bytes else column).desc())
        with self._begun() as connection:
            return [*connection.execute(query.limit(most).offset(skip)).mappings()]

    def acknowledge(self, acknowledgements: Iterable[Acknowledgement]) -> None:
        """Keep who took note of alarms."""
        with self._begun() as connection:
            connection.execute(insert(ACKNOWLEDGEMENTS), [asdict(a) for a in acknowledgements])

    def acknowledgements(self) -> dict[str, list[Acknowledgement]]:
        """Return who took note of each alarm, the first of them first."""
        columns = [ACKNOWLEDGEMENTS.c[field.name] for field in fields(Acknowledgement)]
        query = select(*columns).order_by(ACKNOWLEDGEMENTS.c.id)
        known = dict[str, list[Acknowledgement]]()
        with self._begun() as connection:
            for row in connection.execute(query).mappings():
                known.setdefault(row["alarm"], []).append(Acknowledgement(**row))
        return known

    def head_of(self, folder: Path) -> str | None:
        """Return the head that a run had when it was taken in; None for one that is not known."""
        try:
            key = key_of(folder)
        except DAMAGE:
            key = None
        with self._begun() as connection:
            mine = RUNS.c.key == key if key else _at(folder)
            wanted = select(RUNS.c.head).where(mine | (_at(folder) & RUNS.c.key.is_(None)))
            return connection.execute(wanted.where(RUNS.c.verdict.is_not(None))).scalars().first()

    def _add(self, folders: Iterable[Path]) -> tuple[int, list[str]]:
        summaries, left_out = list[RunSummary](), list[str]()
        count = 0
        for folder in folders:
            try:
                summaries.append(summary_of(folder))
            except InputError as error:
                left_out.append(str(error))
            if len(summaries) == AT_ONCE:
                count += self._write(summaries, left_out)
                summaries.clear()
        return count + self._write(summaries, left_out), left_out

    def _write(self, summaries: Collection[RunSummary], left_out: list[str]) -> int:
        """Write runs, and add a sentence for each that was altered since it was taken in."""
        count = 0
        if not summaries:
            return count
        with self._begun() as connection:
            write_alone(connection)
            for summary in summaries:
                try:
                    count += _replace(connection, summary)
                except InputError as error:
                    left_out.append(str(error))
        return count

    @contextmanager
    def _begun(self) -> Iterator[Connection]:
        with _named(self.url), self._engine.begin() as connection:
            yield connection


def _patience(url: str) -> dict[str, Any]:
    # Two runs may end together: the second waits for the first to have written.
    if url.startswith("sqlite"):
        return {"timeout": PATIENCE_S}
    patience: dict[str, Any] = {"connect_timeout": 5}
    if url.startswith("postgresql"):  # a server that falls silent holds up no run's end
        patience |= {"keepalives_idle": 10, "keepalives_interval": 5, "keepalives_count": 4}
        patience["tcp_user_timeout"] = round(1000 * PATIENCE_S)
    return patience


def _replace(connection: Connection, summary: RunSummary) -> bool:
    """Write a run in the place of what was there of it; return whether it was written.

    What is known of a folder elsewhere stays while that folder is there, as far as can be seen
    from here: a copy counts once. Raises InputError for a folder that never was in the state in
    which the run was taken in.
    """
    run = summary.run
    same = RUNS.c.key == run["key"]
    # Of before there were keys, and of a folder in the place of another one.
    same |= RUNS.c.key.is_(None) & (RUNS.c.host == run["host"]) & (RUNS.c.run == run["run"])
    same |= (RUNS.c.computer == run["computer"]) & (RUNS.c.folder == run["folder"])
    for known in connection.execute(select(RUNS).where(same)).all():
        place = (known.computer, known.folder)
        elsewhere = known.key is not None and place != (run["computer"], run["folder"])
        there = known.computer != run["computer"] or Path(known.folder).is_dir()
        if elsewhere and there and known.verdict is not None:
            return False
        same_run = known.key in (None, run["key"]) and known.verdict is not None
        if same_run and not was_in(summary.at, known.head):
            raise InputError(f"{run['folder']} is {NOT_TAKEN_IN}; it stays as it was taken in")
        _forget(connection, known.id)
    new = connection.execute(insert(RUNS).values(**run)).inserted_primary_key
    assert new is not None
    for table, rows in ((RESULTS, summary.results), (INSTRUMENTS, summary.instruments)):
        if rows:
            connection.execute(insert(table), [{**row, "run_id": new[0]} for row in rows])
    return True


def _forget(connection: Connection, run_id: int) -> None:
    for table in (RESULTS, INSTRUMENTS):
        connection.execute(delete(table).where(table.c.run_id == run_id))
    connection.execute(delete(RUNS).where(RUNS.c.id == run_id))


def _at(folder: Path) -> ColumnElement[bool]:
    """Return the condition that a row is of this folder of this computer."""
    return (RUNS.c.computer == _HERE) & (RUNS.c.folder == str(folder.resolve()))


def _head(folder: Path) -> str:
    try:
        return manifest_head(folder)
    except OSError:
        return ""


def _query(wanted: Wanted) -> Select[Any]:
    columns: Mapping[str, Any] = {**RUNS.c, **RESULTS.c}  # the verdict is the result's own
    query = select(*(columns[field.name] for field in fields(Entry))).join(
        RESULTS, RESULTS.c.run_id == RUNS.c.id
    )
    for field in fields(Wanted):
        value = getattr(wanted, field.name)
        if value is not None:
            query = query.where(columns[field.name] == value)
    return query


def _entry(row: RowMapping) -> Entry:
    """Return a row of the tables; raises TypeError where no history wrote it."""
    for name in NUMBERS:
        if not isinstance(row[name], float | int | None):
            raise TypeError(f"{name} of {row['run']} is no number")
    for name in TEXTS:
        if not isinstance(row[name], str):
            raise TypeError(f"{name} of a run is no text")
    return Entry(**row)


@contextmanager
def _named(url: str) -> Iterator[None]:
    """Say which database an error is of, and never a password in its URL."""
    try:
        yield
    except StationError:
        raise
    except Exception as error:  # whatever is in a damaged database: nothing else depends on it
        shown = url.rpartition("@")[2].partition("?")[0]
        sentence = CLASS.sub("", str(error).partition("\n")[0])
        if isinstance(error, ModuleNotFoundError) and error.name == "psycopg2":
            raise HistoryError(
                f"the history at {shown} needs the package psycopg2; write postgresql+psycopg:// "
                f"in {URL}, and run `pip install inertial-station[history-postgresql]`"
            ) from error
        if isinstance(error, ModuleNotFoundError) and error.name == "psycopg":
            raise HistoryError(
                f"the history at {shown} needs the package {error.name}; install it with `pip "
                "install inertial-station[history-postgresql]`"
            ) from error
        if WHOLE_STILL.search(sentence):
            raise HistoryError(
                f"the history at {shown} cannot be used now: {sentence}; it is whole: end the "
                "program that holds it, or make it writable, and repeat this"
            ) from error
        raise HistoryError(
            f"the history at {shown} cannot be used: {sentence}; the run folders hold all of it "
            f"but who acknowledged which alarm: mend the database or the URL in {URL}, or delete "
            f"{FILE}, and run `station history --rebuild`"
        ) from error
