"""The history of runs in a database: SQLite beside the run folders, or another by its URL."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Select, create_engine, delete, insert, select
from sqlalchemy.exc import SQLAlchemyError

from station.errors import InputError, StationError
from station.history.place import FILE, URL, beside, url_of
from station.history.summary import RunSummary, summary_of
from station.history.tables import INSTRUMENTS, RESULTS, RUNS
from station.history.versions import bring_up_to_date
from station.record.run_names import runs_below

AT_ONCE = 500


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
    started_utc: str
    procedure: str
    model: str
    serial: str
    bench: str
    simulated: bool
    check_standard: bool
    head: str
    name: str
    axis: str | None
    value: float | None
    unit: str
    standard_uncertainty: float | None
    expanded_uncertainty: float | None
    limit_min: float | None
    limit_max: float | None
    verdict: str


class History:
    """The history below one place; every call may raise HistoryError."""

    def __init__(self, parent: Path) -> None:
        """Open the history of the run folders below `parent`, and bring its tables up to date."""
        self._parent = parent
        self.url = url_of(parent)
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
        self._write([summary_of(folder)])

    def take_in(self) -> tuple[int, list[str]]:
        """Take in the run folders that the history lacks; return how many, and what was left out.

        A run that had no results when it was taken in is taken in again.
        """
        with self._begun() as connection:
            ended = select(RUNS.c.run).where(RUNS.c.verdict.is_not(None))
            known = set(connection.execute(ended).scalars())
        return self._add(run for run in runs_below(self._parent) if run.name not in known)

    def rebuild(self) -> tuple[int, list[str]]:
        """Forget all, and take in every run folder; return how many, and what was left out."""
        with self._begun() as connection:
            for table in (RESULTS, INSTRUMENTS, RUNS):
                connection.execute(delete(table))
        return self._add(runs_below(self._parent))

    def results(self, wanted: Wanted = Wanted()) -> list[Entry]:
        """Return the results that are asked for, oldest first."""
        with self._begun() as connection:
            rows = connection.execute(_query(wanted)).mappings()
            return [Entry(**row) for row in rows]

    def head_of(self, run: str) -> str | None:
        """Return the head that a run had when it was taken in; None for one that is not known."""
        with self._begun() as connection:
            wanted = select(RUNS.c.head).where(RUNS.c.run == run, RUNS.c.verdict.is_not(None))
            return connection.execute(wanted).scalars().first()

    def _add(self, folders: Iterable[Path]) -> tuple[int, list[str]]:
        summaries, left_out = list[RunSummary](), list[str]()
        count = 0
        for folder in folders:
            try:
                summaries.append(summary_of(folder))
            except InputError as error:
                left_out.append(str(error))
            if len(summaries) == AT_ONCE:
                count += self._write(summaries)
                summaries.clear()
        return count + self._write(summaries), left_out

    def _write(self, summaries: Iterable[RunSummary]) -> int:
        count = 0
        with self._begun() as connection:
            for summary in summaries:
                _replace(connection, summary)
                count += 1
        return count

    @contextmanager
    def _begun(self) -> Iterator[Connection]:
        with _named(self.url), self._engine.begin() as connection:
            yield connection


def _patience(url: str) -> dict[str, Any]:
    # Two runs may end together: the second waits for the first to have written.
    return {"timeout": 30.0} if url.startswith("sqlite") else {"connect_timeout": 5}


def _replace(connection: Connection, summary: RunSummary) -> None:
    """Write a run in the place of what was there of it."""
    mine = (RUNS.c.host == summary.run["host"]) & (RUNS.c.run == summary.run["run"])
    known = connection.execute(select(RUNS.c.id).where(mine)).scalar_one_or_none()
    if known is not None:
        for table in (RESULTS, INSTRUMENTS):
            connection.execute(delete(table).where(table.c.run_id == known))
        connection.execute(delete(RUNS).where(RUNS.c.id == known))
    new = connection.execute(insert(RUNS).values(**summary.run)).inserted_primary_key
    assert new is not None
    for table, rows in ((RESULTS, summary.results), (INSTRUMENTS, summary.instruments)):
        if rows:
            connection.execute(insert(table), [{**row, "run_id": new[0]} for row in rows])


def _query(wanted: Wanted) -> Select[Any]:
    columns: Mapping[str, Any] = {**RUNS.c, **RESULTS.c}  # the verdict is the result's own
    query = (
        select(*(columns[field.name] for field in fields(Entry)))
        .join(RESULTS, RESULTS.c.run_id == RUNS.c.id)
        .order_by(RUNS.c.started_utc, RUNS.c.run, RESULTS.c.name, RESULTS.c.axis)
    )
    for field in fields(Wanted):
        value = getattr(wanted, field.name)
        if value is not None:
            query = query.where(columns[field.name] == value)
    return query


@contextmanager
def _named(url: str) -> Iterator[None]:
    """Say which database an error is of, and never a password in its URL."""
    try:
        yield
    except (SQLAlchemyError, ImportError) as error:
        shown = url.rpartition("@")[2]
        sentence = str(error).partition("\n")[0]
        raise HistoryError(
            f"the history at {shown} cannot be used: {sentence}; the run folders hold all of it: "
            f"mend the database or the URL in {URL}, or delete {FILE}, and run "
            "`station history --rebuild`"
        ) from error
