"""The history of runs: taken in from their folders, asked, plotted; never in the way of a run."""

from __future__ import annotations

import json
import random
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from command_line import station
from history_runs import made_run

from station.cli.history import lines
from station.cli.remembering import out_of_control, remember
from station.cli.verifying import verify_runs
from station.errors import InputError
from station.history.page import page_of
from station.history.place import FILE, URL
from station.history.series import series_of
from station.history.store import History, HistoryError, Wanted

SPREAD = random.Random(7)


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


@pytest.mark.parametrize("text", ["", "[]", "{", '{"results": [{}]}', '{"results": 3}'])
def test_a_damaged_folder_costs_only_itself_and_is_named(tmp_path: Path, text: str) -> None:
    made_run(tmp_path, 1, 1.1)
    damaged = made_run(tmp_path, 2, 1.2)
    (damaged / "results.json").write_text(text, encoding="utf-8")
    with closing(History(tmp_path)) as history:
        count, left_out = history.take_in()
        assert count == 1
        assert [str(damaged) in sentence for sentence in left_out] == [True]


def test_a_broken_database_is_one_sentence_and_keeps_no_run_from_its_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = made_run(tmp_path, 1, 1.1)
    (tmp_path / FILE).write_bytes(b"this is no database, and long enough to be seen as none" * 20)
    with pytest.raises(HistoryError, match="cannot be used"):
        History(tmp_path)
    remember(folder)
    assert "the run is not in the history" in capsys.readouterr().err
    assert "cannot be used" in out_of_control("sim", tmp_path)[0]


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


def test_nobody_keeps_a_history_unasked(tmp_path: Path) -> None:
    remember(made_run(tmp_path, 1, 1.1))
    assert not (tmp_path / FILE).exists()
    with pytest.raises(InputError, match="no folder"):
        History(tmp_path / "nowhere")


def test_tables_of_a_first_version_are_brought_up_to_date(tmp_path: Path) -> None:
    made_run(tmp_path, 1, 1.1)
    kept(tmp_path)
    with closing(sqlite3.connect(tmp_path / FILE)) as database:
        assert database.execute("SELECT version_num FROM alembic_version").fetchall() == [("0002",)]
        names = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
    assert {"runs", "results", "instruments"} <= names


def standards(parent: Path, values: list[float]) -> None:
    for day, value in enumerate(values):
        made_run(parent, day, value, serial="STD", standard=True)


def test_a_check_standard_that_wanders_off_is_a_warning_before_the_next_run(tmp_path: Path) -> None:
    steady = [SPREAD.gauss(1.0, 0.01) for _ in range(20)]
    standards(tmp_path, [*steady, 1.0])
    kept(tmp_path)
    assert out_of_control("sim", tmp_path) == []
    remember(made_run(tmp_path, 30, 1.2, serial="STD", standard=True))
    [warning] = out_of_control("sim", tmp_path)
    assert "more than 3 sigma above" in warning
    assert out_of_control("sim-alternate", tmp_path) == []


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


def test_the_verb_prints_one_document(tmp_path: Path) -> None:
    made_run(tmp_path, 1, 1.1)
    done = station(tmp_path, "history", "--output", ".", "--json")
    assert done.returncode == 0, done.stderr
    assert [one["value"] for one in json.loads(done.stdout)["results"]] == [1.1]
