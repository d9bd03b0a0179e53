"""What others put among the runs: it is listed or left out, and takes nothing else away."""

from __future__ import annotations

import json
import os
import shutil
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from command_line import station
from history_runs import chained
from panel_server import Served, panel

from station.cli.looking import listed_run
from station.cli.watching import watch_status
from station.clock import RealClock
from station.control.status import read_status
from station.errors import InputError
from station.panel import app
from station.panel.watching import LOOKS_EVERY_S, MAX_STREAMS, RunWatch
from station.record.events import Event, in_words
from station.record.run_list import entry_of
from station.record.run_state import RunState

NAME = "20260101T000000Z-foreign"
DEEP = "[" * 100_000


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A panel on a folder without runs."""
    with pytest.MonkeyPatch.context() as patch, panel(tmp_path_factory.mktemp("foreign")) as one:
        patch.setattr(app, "SEEN_FOR_S", 0.0)
        yield one


def made(runs: Path, log: str = "", **files: str) -> Path:
    """Make a run folder with a log and other JSON files, in place of the one before."""
    folder = runs / NAME
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        path.unlink()
    (folder / "events.jsonl").write_text(log, encoding="utf-8")
    for name, text in files.items():
        (folder / f"{name}.json").write_text(text, encoding="utf-8")
    return folder


def line(kind: str = "run-started", **details: object) -> str:
    return chained([{"t_s": 0.0, "event": kind, **details}])


def linked_lock(folder: Path) -> None:
    (folder / "run.lock").symlink_to("events.jsonl")


def pipes(folder: Path) -> None:
    os.mkfifo(folder / "run.json")
    os.mkfifo(folder / "results.json")


def nothing_more(folder: Path) -> None:
    """Leave the folder as it is."""


@pytest.mark.parametrize(
    ("log", "results", "more"),
    [
        (line(dut="no mapping", procedure=["x"]), "{}", nothing_more),
        (line(dut={"serial": 7}), '{"verdict": NaN}', nothing_more),
        (line(procedure="\ud800"), DEEP, nothing_more),
        (line(), "{}", linked_lock),
    ],
)
def test_a_foreign_folder_leaves_the_first_page_whole(
    log: str, results: str, more: Callable[[Path], None], served: Served
) -> None:
    folder = made(served.runs, log, results=results)
    more(folder)
    status, text = served.get("/api/home")
    assert status == 200
    assert [one["run"] for one in json.loads(text)["runs"]] == [NAME]
    assert listed_run(entry_of(folder))["name"] == NAME


def test_a_lock_that_is_a_link_is_named(served: Served) -> None:
    folder = made(served.runs, line(), results="{}")
    linked_lock(folder)
    with pytest.raises(InputError, match="is a link"):
        read_status(folder)


def test_a_pipe_is_waited_for_by_nobody(served: Served) -> None:
    pipes(made(served.runs, line()))
    assert served.get("/api/home")[0] == 200


def test_no_link_leads_out_of_a_run(served: Served, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("secret", encoding="utf-8")
    folder = made(served.runs, line())
    for name in ("report.html", "results.json", "plots.json"):
        (folder / name).symlink_to(secret)
    for what in ("report", "results", "plots"):
        status, text = served.get(f"/api/run/{NAME}/{what}")
        assert status == 404 and "secret" not in text


def test_results_and_report_that_were_changed_are_not_shown(
    served: Served, one_axis_run: Path
) -> None:
    folder = served.runs / one_axis_run.name
    for name in ("results.json", "report.html"):
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(one_axis_run, folder)
        file, what = folder / name, name.partition(".")[0]
        assert served.get(f"/api/run/{folder.name}/{what}")[0] == 200
        file.write_text(file.read_text(encoding="utf-8").replace("pass", "fail"), encoding="utf-8")
        status, text = served.get(f"/api/run/{folder.name}/{what}")
        assert status == 409 and "station verify" in json.loads(text)["error"]
    home = json.loads(served.get("/api/home")[1])["runs"]
    shutil.rmtree(folder)
    (entry,) = [entry for entry in home if entry["run"] == folder.name]
    assert entry["verdict"] == "pass"  # it is the report that was changed last


@pytest.mark.parametrize("path", ["/run/%00", f"/run/{'a' * 300}", f"/api/run/{'a' * 300}/events"])
def test_a_name_that_no_folder_has_is_refused_in_a_sentence(path: str, served: Served) -> None:
    status, text = served.get(path)
    assert status == 409 and "no such run" in text


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("/run/a%3Cb%3E", "there is no such run"),
        ("/api/run/a/report", "there is no such run"),
        ("/nothing", "there is no such page"),
    ],
)
def test_a_person_who_opens_what_is_not_there_gets_a_page(
    path: str, words: str, served: Served
) -> None:
    page = served.get(path, Accept="text/html")[1]
    assert words in page and '<a class="button" href="/">Benches and runs</a>' in page
    chinese = served.get(path, Accept="text/html", Cookie="station-language=zh")[1]
    assert '<html lang="zh">' in chinese and words not in chinese
    assert served.get(path)[1].startswith('{"error":')


def test_a_watched_run_whose_folder_vanishes_is_said_to_be_gone(tmp_path: Path) -> None:
    watch = RunWatch(made(tmp_path, line(procedure="p")))
    news = dict(watch.news({}))
    assert "unreadable" not in news
    shutil.rmtree(watch.folder)
    RealClock().sleep(2.0 * LOOKS_EVERY_S)
    said = json.loads(dict(watch.news({}))["unreadable"])["message"]
    assert said == f"{NAME} cannot be read: its folder is not there any more"


def test_a_run_stands_by_the_title_of_its_plan(tmp_path: Path) -> None:
    folder = made(tmp_path, line(procedure="p"))
    plan = "# a.yaml, resolved\nprocedure: p  # a.yaml:2\ntitle: {}  # a.yaml:3\n"
    for written, title in (
        ("'Coils: no. #2'", "Coils: no. #2"),
        ("磁敏感度", "磁敏感度"),
        ("null", ""),
        (r'''"<b>O'Neil</b>: \"x\" # y"''', """<b>O'Neil</b>: "x" # y"""),
    ):
        (folder / "plan.resolved.yaml").write_text(plan.format(written), encoding="utf-8")
        assert json.loads(dict(RunWatch(folder).news({}))["state"])["title"] == title


def test_a_body_that_nests_too_deep_is_refused_in_a_sentence(served: Served) -> None:
    own = {"Origin": served.url, "Content-Type": "application/json"}
    request = urllib.request.Request(served.url + "/api/look", b"[" * 60_000, own)
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request)
    assert refused.value.code == 409


def test_a_damaged_log_is_said_to_be_so_until_it_is_whole(tmp_path: Path) -> None:
    begun = {"t_s": 0.0, "event": "run-started", "steps": []}
    asked = {"t_s": 0.0, "event": "prompt-shown", "id": "mount", "text": "Mount the gyro."}
    whole = chained([begun, asked])
    forged = whole.replace("Mount", "Drop") + line("safe-state", outcomes=[])
    damaged = {
        "is no event": f"{line(steps=[])}[]\n",
        "line 2 is not the one that was written": forged,
    }
    for sentence, log in damaged.items():
        folder = made(tmp_path, log)
        watch = RunWatch(folder)
        for _ in range(2):
            news = dict(watch.news({}))
            assert sentence in json.loads(news["unreadable"])["message"]
            assert len(json.loads(news["state"])["log"]) == 1
            watch._looked_s = float("-inf")
        (folder / "events.jsonl").write_text(whole, encoding="utf-8")
        news = dict(watch.news({}))
        assert json.loads(news["unreadable"])["message"] == ""
        assert len(json.loads(news["state"])["log"]) == 2


def test_a_last_line_that_was_altered_is_named_once_the_run_has_ended(
    one_axis_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(one_axis_run, tmp_path / one_axis_run.name)
    log = (folder / "events.jsonl").read_text(encoding="utf-8")
    *before, last = log.splitlines(keepends=True)
    (folder / "events.jsonl").write_text("".join([*before, last.replace("000", "009", 1)]), "utf-8")
    watch_status(folder)
    assert "record: ALTERED" in capsys.readouterr().out
    assert "ALTERED" in json.loads(dict(RunWatch(folder).news({}))["unreadable"])["message"]


@pytest.mark.parametrize("verb", [["status", "--watch"], ["status"], ["attach"]])
def test_no_terminal_shows_a_line_that_was_altered(
    verb: list[str], one_axis_run: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(one_axis_run, tmp_path / one_axis_run.name)
    log = folder / "events.jsonl"
    log.write_text(log.read_text(encoding="utf-8").replace("output off", "OUTPUT ON"), "utf-8")
    done = station(tmp_path, *verb, str(folder))
    assert (done.returncode, "the log was altered" in done.stderr) == (2, True)
    assert "OUTPUT ON" not in done.stdout + done.stderr


def test_an_event_without_its_details_is_said_to_be_damage(tmp_path: Path) -> None:
    watch = RunWatch(made(tmp_path, line(steps=[1], units=3)))
    assert "cannot be read" in json.loads(dict(watch.news({}))["unreadable"])["message"]


def test_many_pages_of_one_browser_leave_a_connection_for_an_abort(served: Served) -> None:
    made(served.runs, line(steps=[]))
    path = f"{served.url}/api/run/{NAME}/events"
    staying = [urllib.request.urlopen(path, timeout=30) for _ in range(MAX_STREAMS)]
    for one in staying:
        while b"beat" not in one.readline():
            pass
    with urllib.request.urlopen(path, timeout=30) as further:
        text = further.read().decode()  # it ends
    assert "event: state" in text and "event: beat" in text
    mark = text.rpartition("id: ")[2].split("\n")[0]
    request = urllib.request.Request(path, headers={"Last-Event-ID": mark})
    with urllib.request.urlopen(request, timeout=30) as again:
        assert "event: state" not in again.read().decode()
    for one in staying:
        one.close()


def test_a_run_that_could_not_log_its_failure_is_not_said_to_be_done() -> None:
    assert in_words(Event(1.0, "run-ended", {"complete": True})) == "all steps are done"
    assert "look at the bench" in RunState([Event(1.0, "run-ended", {"complete": False})]).message()


@pytest.mark.parametrize(
    ("verified", "words"), [(True, "made safe"), (False, "NOT VERIFIED as safe: x")]
)
def test_how_the_bench_was_left_is_said_in_words(verified: bool, words: str) -> None:
    outcomes = [{"instrument": "x", "verified": verified, "read_back": "0 A"}]
    assert words in in_words(Event(1.0, "safe-state", {"outcomes": outcomes}))


def test_a_published_value_is_named_by_what_it_is_of() -> None:
    value = {"value": 0.0257007, "unit": "deg/h/mT"}
    assert in_words(Event(1.0, "published-value", {"axis": "IA", **value})) == (
        "IA by the published formula: 0.0257007 deg/h/mT"
    )
    assert in_words(Event(1.0, "published-value", {"name": "K0", **value})).startswith("K0 by")
