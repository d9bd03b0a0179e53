"""The history of runs: taken in from their folders, asked, plotted; never in the way of a run."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from itertools import product
from pathlib import Path
from socket import gethostname

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from command_line import PLAN, station
from for_people import need_sentences
from history_runs import made_run
from sqlalchemy import Connection, create_engine, insert, select, text

from station.cli.history import acknowledge_alarms, lines
from station.cli.looking import entries
from station.cli.remembering import remember, standing_alarms
from station.cli.verifying import against_history, verify_runs
from station.errors import InputError
from station.history import store
from station.history.alarms import alarms_of, rows_of_standards
from station.history.page import page_of
from station.history.place import FILE, URL, url_of
from station.history.series import series_of
from station.history.store import History, HistoryError, Wanted
from station.history.summary import summary_of
from station.history.tables import METADATA, RUNS
from station.history.versions import MIGRATIONS
from station.record.events import EventLog
from station.record.later import record_later
from station.record.layout import EVENTS, file_hash, write_manifest

SPREAD = random.Random(7)
pytestmark = pytest.mark.usefixtures("database")
IN_A_FILE = pytest.mark.parametrize("database", ["sqlite"], indirect=True)
"""What holds only of a history that is a file beside the runs."""


def kept(parent: Path, wanted: Wanted | None = None) -> list[tuple[str, float | None]]:
    with closing(History(parent)) as history:
        history.take_in()
        found = history.results(wanted or Wanted())
    return [(one.serial, one.value) for one in found]


def test_runs_are_taken_in_once_in_the_order_of_time(tmp_path: Path) -> None:
    made_run(tmp_path, 2, 1.2)
    made_run(tmp_path, 1, 1.1, serial="SN-2")
    assert kept(tmp_path) == [("SN-2", 1.1), ("SN-1", 1.2)]
    made_run(tmp_path, 3, None)
    assert kept(tmp_path) == [("SN-2", 1.1), ("SN-1", 1.2), ("SN-1", None)]
    assert kept(tmp_path, Wanted(serial="SN-2")) == [("SN-2", 1.1)]
    assert kept(tmp_path, Wanted(bench="other")) == []


def test_a_run_without_results_is_taken_in_again_when_it_has_some(tmp_path: Path) -> None:
    folder = made_run(tmp_path, 1, 1.1)
    results = (folder / "results.json").rename(tmp_path / "later")
    assert kept(tmp_path) == []
    results.rename(folder / "results.json")
    assert kept(tmp_path) == [("SN-1", 1.1)]


def test_what_was_deleted_stays_known_until_the_history_is_rebuilt(tmp_path: Path) -> None:
    shutil.rmtree(made_run(tmp_path / "gone", 1, 1.1).rename(tmp_path / "one"))
    folder = made_run(tmp_path, 2, 1.2)
    assert len(kept(tmp_path)) == 1
    shutil.rmtree(folder)
    assert len(kept(tmp_path)) == 1
    with closing(History(tmp_path)) as history:
        assert history.rebuild() == (0, [])
        assert history.results() == []


def with_result(**changed: object) -> str:
    """Return a result document of which some entries are not what a run writes."""
    entry = {
        "name": "coil_constant",
        "axis": None,
        "value": 1.0,
        "unit": "mT/A",
        "standard_uncertainty": None,
        "expanded_uncertainty": None,
        "verdict": "none",
    }
    return json.dumps({"verdict": "none", "results": [entry | changed]})


DOCUMENTS = (
    *("", "[]", "{", '{"results": [{}]}', '{"results": 3}'),
    *(with_result(name=name) for name in ("a\0b", "\ud800", None, 7, ["a"])),
    *(with_result(value=value) for value in ("1.0", True, 10**400, float("nan"), {})),
)


@pytest.mark.parametrize("text", DOCUMENTS)
def test_a_damaged_folder_costs_only_itself_and_is_named(tmp_path: Path, text: str) -> None:
    made_run(tmp_path, 1, 1.1)
    damaged = made_run(tmp_path, 2, 1.2)
    (damaged / "results.json").write_text(text, encoding="utf-8")
    write_manifest(damaged)
    with closing(History(tmp_path)) as history:
        count, left_out = history.take_in()
        assert count == 1
        assert [str(damaged) in sentence for sentence in left_out] == [True]


@IN_A_FILE
def test_a_broken_database_is_one_sentence_and_keeps_no_run_from_its_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = made_run(tmp_path, 1, 1.1)
    (tmp_path / FILE).write_bytes(b"this is no database, and long enough to be seen as none" * 20)
    with pytest.raises(HistoryError, match="cannot be used"):
        History(tmp_path)
    remember(folder)
    assert "the run is not in the history" in capsys.readouterr().err
    [warned] = standing_alarms("sim", tmp_path)
    assert "cannot be used" in warned.sentence


def test_texts_are_sorted_alike_by_every_database(tmp_path: Path) -> None:
    """A server may sort as a dictionary does: the small before the capital, a hyphen unseen."""
    serials = ["A", "B", "a", "a-c", "ab", "b"]
    folders = [made_run(tmp_path, 1, 1.0, serial=serial) for serial in serials]
    assert kept(tmp_path) == [(serial, 1.0) for serial in serials]
    newest_first = [row["name"] for row in entries("runs", store=url_of(tmp_path))]
    assert newest_first == [folder.name for folder in reversed(folders)]


TAKES_IN = """
import sys
from pathlib import Path
from station.history.store import History
print("ready", flush=True)
parent, one_by_one = Path(sys.argv[1]), sys.argv[2] == "one by one"
sys.stdin.readline()
history = History(parent)
if one_by_one:
    for folder in sorted(parent.glob("2*"), reverse=True):
        history.take_one(folder)
else:
    for sentence in history.rebuild()[1]:
        print(sentence)
history.close()
"""


def test_what_several_processes_take_in_at_once_is_there_once(
    tmp_path: Path, database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They begin with no tables; two read the same folders, one has copies, one other runs."""
    if database == "sqlite":
        monkeypatch.setenv(URL, f"sqlite:///{tmp_path / 'shared.sqlite3'}")
    for day in range(40):
        made_run(tmp_path / "a", day, 1.0)
        made_run(tmp_path / "b", day, 2.0, serial="SN-2")
    shutil.copytree(tmp_path / "a", tmp_path / "copies")
    asked = [("a", "one by one"), ("a", "all"), ("copies", "all"), ("b", "one by one")]
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", TAKES_IN, str(tmp_path / parent), how],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
        )
        for parent, how in asked
    ]
    for process in processes:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    assert [process.communicate(timeout=100)[0] for process in processes] == [""] * len(asked)
    with closing(History(tmp_path / "a")) as history:
        rows = [(entry.run, entry.value) for entry in history.results()]
        assert len(history.runs()) == 80
    assert sorted(rows) == sorted(set(rows))
    assert len(rows) == 80


def test_a_history_is_rebuilt_from_a_store_by_its_url(tmp_path: Path) -> None:
    made_run(tmp_path / "store" / "bench 1", 1, 1.1)
    gone = made_run(tmp_path / "store" / "bench 2", 2, 1.2, serial="SN-2")
    mine = made_run(tmp_path / "mine", 3, 1.3, serial="SN-3")
    shutil.copytree(mine, tmp_path / "store" / "copy")
    store = f"file://{tmp_path / 'store'}"
    mine_alone = kept(tmp_path / "mine")
    with closing(History(tmp_path / "mine")) as history:
        assert history.rebuild_from(store) == (2, [])
        assert [entry.value for entry in history.results()] == [1.1, 1.2, 1.3]
        assert [row["folder"] for row in history.runs()][1:] == [
            f"{store}/bench 2/{gone.name}",
            f"{store}/bench 1/{next((tmp_path / 'store' / 'bench 1').iterdir()).name}",
        ]
        (gone / "manifest.json").unlink()
        assert history.rebuild_from(store)[0] == 1
        shutil.rmtree(gone)
        assert history.rebuild_from(store) == (1, [])
        assert [entry.value for entry in history.results()] == [1.1, 1.3]
        assert history.rebuild() == (1, [])
        assert [entry.value for entry in history.results()] == [1.1, 1.3]
    assert mine_alone == [("SN-3", 1.3)]
    done = station(tmp_path, "history", "--rebuild", store, "--output", "mine")
    assert (done.returncode, "1 runs taken" in done.stderr) == (0, True)
    assert station(tmp_path, "history", store, "--output", "mine").returncode == 2
    done = station(tmp_path, "history", "--rebuild", "nothing://store", "--output", "mine")
    assert (done.returncode, "cannot be read" in done.stderr) == (2, True)


@IN_A_FILE
def test_a_server_that_is_gone_or_silent_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = made_run(tmp_path, 1, 1.1)
    with closing(socket.create_server(("127.0.0.1", 0))) as silent:
        port = silent.getsockname()[1]
        for host in (f"127.0.0.1:{port}", "127.0.0.1:1"):
            monkeypatch.setenv(URL, f"postgresql+psycopg://lab:secret@{host}/runs?sslkey=hidden")
            with pytest.raises(HistoryError, match=f"the history at {host}/runs cannot") as raised:
                History(tmp_path)
            need_sentences(str(raised.value), host)
            assert not {"secret", "hidden"} & set(re.split(r"\W", str(raised.value)))
    assert verify_runs([folder], as_json=False) == 0  # of the one that is gone


@IN_A_FILE
def test_the_package_that_a_server_needs_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    monkeypatch.setenv(URL, "postgresql+psycopg://lab:secret@db/runs")
    with pytest.raises(HistoryError, match=r"pip install inertial-station\[history-postgresql\]"):
        History(tmp_path)


@IN_A_FILE
def test_a_url_without_its_package_is_named_without_its_password(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(URL, "nothing+here://lab:secret@db/runs")
    with pytest.raises(HistoryError, match="db/runs") as raised:
        History(tmp_path)
    assert "secret" not in str(raised.value)


def test_all_that_is_seen_beside_the_history_are_run_folders(tmp_path: Path) -> None:
    folder = made_run(tmp_path, 1, 1.1)
    assert kept(tmp_path)
    # A shell's `runs/*` leaves out what begins with a dot.
    assert [one for one in tmp_path.iterdir() if not one.name.startswith(".")] == [folder]


@IN_A_FILE
def test_nobody_keeps_a_history_unasked(tmp_path: Path) -> None:
    remember(made_run(tmp_path, 1, 1.1))
    assert not (tmp_path / FILE).exists()
    with pytest.raises(InputError, match="no folder"):
        History(tmp_path / "nowhere")


@IN_A_FILE
def test_a_check_standard_begins_the_history_with_the_runs_that_are_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    standards(tmp_path, STEADY)
    assert not (tmp_path / FILE).exists()
    remember(made_run(tmp_path, 30, 1.2, serial="STD", standard=True))
    assert "this run raises alarm" in capsys.readouterr().err
    assert standing_alarms("sim", tmp_path)


@contextmanager
def tables_of(parent: Path) -> Iterator[Connection]:
    """Yield a connection to the database of the runs below a folder."""
    engine = create_engine(url_of(parent))
    with engine.begin() as connection:
        yield connection
    engine.dispose()


def of_first_version(parent: Path, *folders: Path) -> None:
    """Make a history as the first version kept it, with a row for each folder."""
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    with tables_of(parent) as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "0001")
    with tables_of(parent) as connection:
        for number, folder in enumerate(folders, start=1):
            run = {
                "id": number,
                "host": "lab",
                "run": folder.name,
                "folder": str(folder),
                "started_utc": f"2026-02-0{number}",
                "procedure": "coil-constant",
                "model": "C-3",
                "serial": f"OLD-{number}",
                "bench": "sim",
                "simulated": True,
                "check_standard": False,
                "state": "evaluated",
                "verdict": "pass",
                "head": file_hash(folder / "manifest.json") if folder.is_dir() else "",
            }
            values = ", ".join(f":{name}" for name in run)
            connection.execute(text(f"INSERT INTO runs ({', '.join(run)}) VALUES ({values})"), run)
            connection.execute(
                text(
                    "INSERT INTO results (run_id, name, axis, value, unit, verdict) "
                    "VALUES (:id, 'coil_constant', 'x', 1.5, 'mT/A', 'pass')"
                ),
                run,
            )
        if connection.dialect.name == "postgresql":  # as if it had given the numbers itself
            connection.execute(text("SELECT setval('runs_id_seq', 100)"))


def test_tables_of_a_first_version_are_brought_up_to_date(tmp_path: Path) -> None:
    there, gone = made_run(tmp_path, 1, 1.1), tmp_path / "gone"
    of_first_version(tmp_path, there, gone)
    assert verify_runs([there], as_json=False) == 0
    # What was there is read again and has its key; what is gone is kept as it was.
    assert kept(tmp_path) == [("SN-1", 1.1), ("OLD-2", 1.5)]
    with tables_of(tmp_path) as connection:
        version = connection.execute(text("SELECT version_num FROM alembic_version")).scalars()
        assert version.all() == ["0004"]
        rows = connection.execute(text("SELECT run, computer, key IS NULL FROM runs")).all()
    assert sorted(map(tuple, rows)) == [(there.name, gethostname(), 0), ("gone", "lab", 1)]


def test_the_tables_are_those_that_the_program_speaks_of(tmp_path: Path) -> None:
    assert kept(tmp_path) == []
    with tables_of(tmp_path) as connection:
        differences = compare_metadata(MigrationContext.configure(connection), METADATA)
    assert differences == []


@pytest.fixture
def shared(tmp_path: Path, database: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two benches whose runs one database holds."""
    if database == "sqlite":
        monkeypatch.setenv(URL, f"sqlite:///{tmp_path / 'shared.sqlite3'}")
    for day in range(1, 4):
        made_run(tmp_path / "a", day, 1.0 + day / 10)
        made_run(tmp_path / "b", day + 10, 2.0 + day / 10, serial="SN-2")
    return tmp_path


def test_a_rebuild_replaces_what_is_below_its_own_folder_alone(shared: Path) -> None:
    assert len(kept(shared / "a")) == 3
    assert len(kept(shared / "b")) == 6
    shutil.rmtree(next((shared / "a").iterdir()))
    with closing(History(shared / "a")) as history:
        assert history.rebuild() == (2, [])
        assert len(history.results()) == 5


def test_a_folder_that_was_copied_or_moved_counts_once(shared: Path) -> None:
    kept(shared / "a")
    before = kept(shared / "b")
    shutil.copytree(shared / "a", shared / "copies")
    assert kept(shared / "copies") == before
    with closing(History(shared / "copies")) as history:
        history.rebuild()
        assert len(history.results()) == 6
    shutil.rmtree(shared / "copies")
    (shared / "a").rename(shared / "archive")
    assert kept(shared / "archive") == before
    with tables_of(shared) as connection:
        rows = connection.execute(select(RUNS.c.folder)).scalars()
        folders = [Path(folder).parent.name for folder in rows]
    assert sorted(folders) == ["archive"] * 3 + ["b"] * 3


def test_a_copy_of_an_aborted_run_is_another_run_once_both_were_resumed(tmp_path: Path) -> None:
    first = made_run(tmp_path, 1, None)
    results = (first / "results.json").rename(tmp_path / "later")
    write_manifest(first)
    second = Path(shutil.copytree(first, first.with_name(f"{first.name}-copy")))
    assert kept(tmp_path) == []
    for gap_s, run in ((1.0, first), (2.0, second)):
        log = EventLog(run / EVENTS)
        log.append(0.0, "resumed", {"silent_s": gap_s}, durable=False)
        log.append(0.0, "run-ended", {"complete": True}, durable=False)
        log.close()
        shutil.copy(results, run / "results.json")
        write_manifest(run)
    assert len(kept(tmp_path)) == 2
    assert [*against_history(first), *against_history(second)] == []


def test_two_runs_of_one_plan_that_began_alike_count_twice(tmp_path: Path) -> None:
    first, second = made_run(tmp_path, 1, 1.1), made_run(tmp_path, 2, 1.2)
    lines = [(one / "events.jsonl").read_bytes().splitlines()[0] for one in (first, second)]
    assert lines[0] == lines[1]  # on a simulated bench the logs are alike
    assert len(kept(tmp_path)) == 2


def test_an_altered_folder_is_not_taken_in_and_what_was_taken_in_stays(tmp_path: Path) -> None:
    folder = made_run(tmp_path, 1, 1.1)
    results = folder / "results.json"
    whole = results.read_text(encoding="utf-8")
    results.write_text(whole.replace("1.1", "1.2"), encoding="utf-8")
    with closing(History(tmp_path)) as history:
        count, (sentence,) = history.take_in()
        assert (count, history.results()) == (0, [])
    assert "is not taken into the history: ALTERED" in sentence
    results.write_text(whole, encoding="utf-8")
    assert kept(tmp_path) == [("SN-1", 1.1)]
    results.write_text(whole.replace("1.1", "1.2"), encoding="utf-8")
    (folder / "manifest.json").unlink()
    with closing(History(tmp_path)) as history:
        count, (sentence,) = history.take_in()
        assert [entry.value for entry in history.results()] == [1.1]
    assert "ALTERED" in sentence


def test_a_folder_sealed_anew_is_not_taken_in_in_the_place_of_what_was(tmp_path: Path) -> None:
    folder = made_run(tmp_path, 1, 1.1)
    kept(tmp_path)
    results = folder / "results.json"
    results.write_text(results.read_text(encoding="utf-8").replace("1.1", "1.2"), encoding="utf-8")
    write_manifest(folder)
    for take_in in (History.take_in, History.rebuild):
        with closing(History(tmp_path)) as history:
            count, (sentence,) = take_in(history)
            assert [entry.value for entry in history.results()] == [1.1]
        assert count == 0
        assert "is not what the history took in at its end" in sentence
    record_later(folder, "revision-written", {"revision": "001"})  # does not make it whole again
    assert verify_runs([folder], as_json=False) == 1


def test_a_run_that_was_analysed_since_is_the_one_that_was_taken_in(tmp_path: Path) -> None:
    folder = made_run(tmp_path, 1, 1.1)
    kept(tmp_path)
    record_later(folder, "certificate-issued", {"number": "C-1"})
    with closing(History(tmp_path)) as history:
        assert history.take_in() == (1, [])
        assert history.take_in() == (0, [])
    assert verify_runs([folder], as_json=False) == 0


DAMAGES: dict[str, Callable[[Path], object]] = {
    "no database": lambda file: file.write_bytes(b"no database, and long enough to show it " * 40),
    "a text for a number": lambda file: changed_in(file, "UPDATE results SET value = 'x'"),
    "bytes that are no text": lambda file: changed_in(
        file, "UPDATE runs SET serial = CAST(x'ff' AS TEXT)"
    ),
    "half of it": lambda file: os.truncate(file, file.stat().st_size // 2),
    "no tables": lambda file: changed_in(file, "DROP TABLE results", "DROP TABLE runs CASCADE"),
    "an unknown version": lambda file: changed_in(
        file, "UPDATE alembic_version SET version_num = ''"
    ),
    "another program's column": lambda file: changed_in(
        file, "ALTER TABLE results RENAME COLUMN value TO worth"
    ),
}
OF_A_SERVER = [*DAMAGES][-3:]
"""Those that a server lets happen."""


def changed_in(file: Path, *statements: str) -> None:
    with tables_of(file.parent) as connection:
        for statement in statements:
            if connection.dialect.name == "sqlite":
                statement = statement.replace(" CASCADE", "")
            connection.execute(text(statement))


@pytest.mark.parametrize(
    ("damage", "database"),
    [*product(DAMAGES, ["sqlite"]), *product(OF_A_SERVER, ["postgresql"])],
    indirect=["database"],
)
def test_a_damaged_database_keeps_nobody_from_a_run_nor_from_verify(
    damage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    standards(tmp_path, [1.0, 1.1, 0.9, 1.0, 1.05, 0.95, 1.0, 1.1, 0.9])
    kept(tmp_path)
    DAMAGES[damage](tmp_path / FILE)
    folder = made_run(tmp_path, 30, 1.2)
    assert verify_runs([folder], as_json=False) == 0
    standing_alarms("sim", tmp_path)
    remember(folder)
    need_sentences(capsys.readouterr().err, damage)


def standards(parent: Path, values: list[float]) -> None:
    for day, value in enumerate(values):
        made_run(parent, day, value, serial="STD", standard=True)


STEADY = [1.0, 1.01, 0.99, 1.005, 0.995, 1.01, 0.99, 1.0, 1.005, 0.995]
"""Values of a check standard of which none breaks a rule."""


def wandered(parent: Path) -> str:
    """Make a history of a check standard that wandered off; return the name of its alarm."""
    standards(parent, STEADY)
    kept(parent)
    remember(made_run(parent, 30, 1.2, serial="STD", standard=True))
    with closing(History(parent)) as history:
        alarms = alarms_of(history.results(), history.acknowledgements())
    return [alarm.identity for alarm in alarms if alarm.stands][-1]


def test_an_alarm_of_a_check_standard_stands_until_somebody_acknowledges_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    standards(tmp_path, STEADY)
    kept(tmp_path)
    assert standing_alarms("sim", tmp_path) == []
    remember(made_run(tmp_path, 30, 1.2, serial="STD", standard=True))
    assert "this run raises alarm" in capsys.readouterr().err
    [warned] = standing_alarms("sim", tmp_path)
    assert "more than 3 sigma above" in warned.sentence
    assert standing_alarms("sim-alternate", tmp_path) == []
    remember(made_run(tmp_path, 31, 1.0, serial="STD", standard=True))  # well again
    assert warned in standing_alarms("sim", tmp_path)
    with closing(History(tmp_path)) as history:
        history.rebuild()
    assert warned in standing_alarms("sim", tmp_path)
    names = [words.sentence.split()[1] for words in standing_alarms("sim", tmp_path)]
    with pytest.raises(InputError, match=f"no alarm nothing; those that stand: {names[0]}"):
        acknowledge_alarms(tmp_path, ["nothing"], "why", new_baseline=False, as_json=False)
    for reason in ("", " . "):
        with pytest.raises(InputError, match="--reason"):
            acknowledge_alarms(tmp_path, names, reason, new_baseline=False, as_json=False)
    acknowledge_alarms(tmp_path, names, "a loose clamp", new_baseline=False, as_json=False)
    assert "a loose clamp" in capsys.readouterr().out
    assert standing_alarms("sim", tmp_path) == []
    with closing(History(tmp_path)) as history:
        history.rebuild()
        notes = history.acknowledgements()[names[0]]
    assert standing_alarms("sim", tmp_path) == []
    assert [(note.reason, bool(note.who)) for note in notes] == [("a loose clamp", True)]


def test_a_run_is_flagged_while_an_alarm_of_its_bench_stands(tmp_path: Path) -> None:
    name = wandered(tmp_path / "runs")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    done = station(tmp_path, "run", "plan.yaml", "--json", CI="true")
    assert f"WARNING: alarm {name} of bench sim stands until" in done.stderr
    document = json.loads(done.stdout)
    flags = {flag["code"]: flag["message"] for flag in document["flags"]}
    assert name in flags["check-standard-alarm"]
    assert name in (tmp_path / document["run"] / "report.html").read_text(encoding="utf-8")


def test_after_a_repair_the_chart_begins_anew(tmp_path: Path) -> None:
    name = wandered(tmp_path)
    acknowledge_alarms(tmp_path, [name], "new coil", new_baseline=True, as_json=False)
    for day in range(8):
        remember(made_run(tmp_path, 40 + day, 1.2 + day % 2 / 100, serial="STD", standard=True))
    assert standing_alarms("sim", tmp_path) == []
    with closing(History(tmp_path)) as history:
        rows = rows_of_standards(history.results(), history.acknowledgements())
    assert [len(row.entries) for row in rows] == [11, 8]
    remember(made_run(tmp_path, 50, 1.0, serial="STD", standard=True))  # as it was before
    assert len(standing_alarms("sim", tmp_path)) == 1


def test_of_several_alarms_the_new_baseline_begins_after_the_last(tmp_path: Path) -> None:
    wandered(tmp_path)
    remember(made_run(tmp_path, 31, 1.2, serial="STD", standard=True))
    names = [warned.sentence.split()[1] for warned in standing_alarms("sim", tmp_path)]
    assert len(names) == 2
    with pytest.raises(InputError, match=f"alarm {names[1]} came later and stands"):
        acknowledge_alarms(tmp_path, names[:1], "new coil", new_baseline=True, as_json=False)
    acknowledge_alarms(tmp_path, names, "new coil", new_baseline=True, as_json=False)
    assert standing_alarms("sim", tmp_path) == []
    with closing(History(tmp_path)) as history:
        known = history.acknowledgements()
        alarms = alarms_of(history.results(), known)
    assert [known[name][0].new_baseline for name in names] == [False, True]
    assert [alarm.identity for alarm in alarms] == names


@IN_A_FILE
def test_alarms_are_printed_in_the_document_and_on_the_page(tmp_path: Path) -> None:
    name = wandered(tmp_path)
    asked = ("history", "--check-standards", "--output", ".")
    assert f"{name}  STANDS  bench sim  check standard STD" in station(tmp_path, *asked).stdout
    done = station(tmp_path, *asked[:1], "--acknowledge", name, "--reason", "a clamp", *asked[2:])
    assert done.returncode == 0, done.stderr
    told = json.loads(station(tmp_path, *asked, "--json").stdout)["alarms"][-1]
    assert (told["alarm"], told["stands"]) == (name, False)
    assert told["acknowledged"][0]["reason"] == "a clamp"
    station(tmp_path, *asked, "--html", "page.html")
    assert "a clamp" in (tmp_path / "page.html").read_text(encoding="utf-8")
    alone = station(tmp_path, *asked, "--reason", "a clamp")
    assert (alone.returncode, "--acknowledge" in alone.stderr) == (2, True)


def test_a_unit_and_a_type_are_shown_in_lines_and_as_a_page(tmp_path: Path) -> None:
    for day in range(12):
        made_run(tmp_path, day, SPREAD.gauss(1.0, 0.5), serial=f"SN-{day}")
    standards(tmp_path / "more", [1.0, 1.1, 0.9, 1.0, 1.05, 0.95, 1.0, 1.1, 0.9])
    for folder in (tmp_path / "more").iterdir():
        folder.rename(tmp_path / folder.name)
    with closing(History(tmp_path)) as history:
        history.take_in()
        [series] = series_of(history.results())
    said = "\n".join(lines(series))
    assert "coil constant x (simulated), mT/A" in said
    assert "Cpk over 12 units" in said
    page = page_of([series], "Results of all runs.")
    assert page.count("<img") == 3  # over time, control chart, over the units
    assert "http" not in page


def test_a_run_sealed_anew_is_not_the_one_of_the_history(
    run_of: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from station.record.layout import write_manifest

    run = run_of("rlg-magnetic-sensitivity")
    folder = Path(shutil.copytree(run, tmp_path / run.name))
    assert [serial for serial, _ in kept(tmp_path)][:1] == ["SN-0042"]
    assert verify_runs([folder], as_json=False) == 0
    results = folder / "results.json"
    results.write_text(results.read_text(encoding="utf-8").replace("pass", "fail"), "utf-8")
    (folder / "manifest.json").unlink()
    write_manifest(folder)
    assert verify_runs([folder], as_json=False) == 1
    assert "the history" in capsys.readouterr().out


def test_ten_thousand_runs_of_a_history_are_listed_by_pages(tmp_path: Path) -> None:
    url = url_of(tmp_path)
    if url.startswith("sqlite"):
        with pytest.raises(InputError, match="no file"):
            entries("runs", store=url)
        (tmp_path / FILE).touch()
    folder = made_run(tmp_path / "runs", 1, 1.1)
    summary = summary_of(folder)
    with closing(History(tmp_path, url)):
        pass
    rows = [
        {
            **summary.run,
            "key": str(number),
            "run": f"run-{number}",
            "started_utc": f"2026-01-{1 + number // 1000:02d}T{number % 1000:06d}",
            "serial": f"SN_{number}",
        }
        for number in range(10_000)
    ]
    with tables_of(tmp_path) as connection:
        connection.execute(insert(RUNS), rows)
    assert entries("runs", store=url)[0]["name"] == "run-9999"
    expected = [f"run-{number}" for number in range(9999, -1, -1)]
    for page in (1, 2, 20, 100, 200, 201):
        names = [row["name"] for row in entries("runs", "", url, page)]
        assert names == expected[50 * page - 50 :][:51]
    assert [row["serial"] for row in entries("runs", "sn_123", url)][-1] == "SN_123"
    assert len(entries("runs", "sn_123", url)) == 11
    asked = ("list", "runs", "--store", url, "--page", "200")
    done = json.loads(station(tmp_path, *asked, "--json").stdout)
    assert (len(done["runs"]), done["page"], done["older"]) == (50, 200, False)
    assert done["runs"][0]["operator"] == "mei"
    assert station(tmp_path, "list", "--store", url).stdout.endswith("older runs: --page 2\n")


def test_the_verb_prints_one_document(tmp_path: Path) -> None:
    made_run(tmp_path, 1, 1.1)
    done = station(tmp_path, "history", "--output", ".", "--json")
    assert done.returncode == 0, done.stderr
    assert [one["value"] for one in json.loads(done.stdout)["results"]] == [1.1]


@IN_A_FILE
def test_a_history_that_another_program_holds_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept(tmp_path)
    monkeypatch.setattr(store, "PATIENCE_S", 0.1)
    with closing(sqlite3.connect(tmp_path / FILE)) as holder:
        holder.execute("BEGIN EXCLUSIVE")
        with pytest.raises(HistoryError, match="it is whole: end the program") as told:
            kept(tmp_path)
    assert "delete" not in str(told.value)
