"""A history of many runs on SQLite and on PostgreSQL: how long it takes, and how large it is.

    python benchmarks/history.py [--runs 10000] [--database sqlite postgresql] [--store]

Copies of a finished run without raw data, each with a beginning and a serial number of its own, a
hundred of a unit. One JSON line for each database, in s unless named otherwise: a rebuild from
the folders, and this process' processor time of it; looking for new ones; taking in another run;
the results of a unit and of all; the first and the last page of `list runs --store`; a search; the
size. PostgreSQL is Debian's, on a Unix socket of this computer, without the waits for the
disk (fsync is off). `--store` keeps the lines in `figures/`.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaign_helpers import finished_run
from figures import Figures
from history_runs import chained
from postgresql_server import postgresql_server
from sqlalchemy import create_engine, text

from station.cli.looking import RUNS_ON_A_PAGE, entries
from station.history.store import History, Wanted
from station.record.layout import EVENTS, RUN, write_manifest

KEPT = (EVENTS, RUN, "plan.resolved.yaml", "bench.resolved.yaml", "results.json")
OF_A_UNIT = 100
MORE = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    figures = Figures(parser)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--database", nargs="*", default=["sqlite", "postgresql"])
    asked = figures.parse()
    with tempfile.TemporaryDirectory() as place:
        run = finished_run(Path(place) / "made", ["IA"])
        parent, later = Path(place) / "runs", Path(place) / "later"
        for number in range(asked.runs):
            copy(run, parent, number)
        more = [copy(run, later, asked.runs + number) for number in range(MORE)]
        for name in asked.database:
            with database(name, Path(place)) as url:
                measured = measure(url, parent, more, asked.runs)
            figures.line(name, **measured)


@contextmanager
def database(name: str, place: Path) -> Iterator[str]:
    """Yield the URL of an empty database."""
    with ExitStack() as stack:
        if name == "postgresql":
            yield stack.enter_context(postgresql_server()).new_database()
        else:
            (place / "history.sqlite3").touch()
            yield f"sqlite:///{place / 'history.sqlite3'}"


def copy(run: Path, parent: Path, number: int) -> Path:
    """Make a run of its own out of a finished one."""
    began = datetime.fromisoformat("2026-01-01T00:00:00+00:00") + timedelta(minutes=number)
    serial = f"SN-{number // OF_A_UNIT}"
    folder = parent / f"{began:%Y%m%dT%H%M%SZ}-rlg-magnetic-sensitivity-{serial}"
    folder.mkdir(parents=True)
    for name in KEPT:
        shutil.copy(run / name, folder / name)
    facts = json.loads((run / RUN).read_text(encoding="utf-8"))
    facts["started_utc"] = began.isoformat()
    (folder / RUN).write_text(json.dumps(facts), encoding="utf-8")
    log = (run / EVENTS).read_text(encoding="utf-8").splitlines()
    # A log of before revisions were named in it: the copies have none.
    events = [event for event in map(json.loads, log) if event["event"] != "revision-written"]
    events[0]["dut"]["serial"] = serial
    (folder / EVENTS).write_text(chained(events), encoding="utf-8")
    write_manifest(folder)
    return folder


def measure(url: str, parent: Path, more: list[Path], count: int) -> dict[str, Any]:
    with closing(History(parent, url)) as history:
        began_cpu_s = time.process_time()
        seconds = {"rebuild": timed(lambda: history.rebuild(), (count, []))}
        seconds["rebuild_cpu"] = time.process_time() - began_cpu_s
        seconds["nothing_new"] = timed(lambda: history.take_in(), (0, []))
        began_s = time.perf_counter()
        for folder in more:
            history.take_one(folder)
        seconds["another_run"] = (time.perf_counter() - began_s) / len(more)
        unit = history.results(Wanted(serial="SN-0"))
        of_a_run = len(unit) // min(OF_A_UNIT, count)
        seconds["results_of_a_unit"] = timed(
            lambda: len(history.results(Wanted(serial="SN-0"))), len(unit)
        )
        everything = (count + len(more)) * of_a_run
        seconds["all_results"] = timed(lambda: len(history.results()), everything)
    last = (count + len(more) - 1) // RUNS_ON_A_PAGE + 1
    pages = {"first_page": ("", 1), "last_page": ("", last), "search": ("sn-0", 1)}
    for name, (search, page) in pages.items():
        began_s = time.perf_counter()
        assert entries("runs", search, url, page), name
        seconds[name] = time.perf_counter() - began_s
    rounded = {f"{name}_s": round(wall_s, 3) for name, wall_s in seconds.items()}
    size = {"megabytes": round(size_of(url) / 1e6, 1), "results_of_a_run": of_a_run}
    return {"runs": count, **rounded, **size}


def timed(call: Callable[[], Any], expected: object) -> float:
    """Return how long a call takes, which must come to what is expected."""
    began_s = time.perf_counter()
    came = call()
    wall_s = time.perf_counter() - began_s
    assert came == expected, str(came)[:500]
    return wall_s


def size_of(url: str) -> int:
    if url.startswith("sqlite"):
        return Path(url.removeprefix("sqlite:///")).stat().st_size
    engine = create_engine(url)
    with engine.connect() as connection:
        size = connection.execute(text("SELECT pg_database_size(current_database())")).scalar()
    engine.dispose()
    return int(size or 0)


if __name__ == "__main__":
    main()
