"""Whatever became of a run, what a person reads of it is sentences; tracebacks stay in the log."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from bad_input_files import here
from faulted_runs import run_with
from for_people import SCRIPTS, need_sentences, traces_in
from panel_server import panel
from short_forms import SHORT_FORMS
from tiers import quick

from station.panel.watching import RunWatch
from station.record.events import EventLog, read_events
from station.record.layout import BENCH, EVENTS, MANIFEST, PLAN

RUN_FOLDER = "{run}"
VERBS = (
    ("status", RUN_FOLDER),
    ("status", RUN_FOLDER, "--json"),
    ("attach", RUN_FOLDER),
    ("verify", RUN_FOLDER),
    ("analyse", RUN_FOLDER, "--json", "--compare"),
)
PAGES = ("/api/home", "/run/{run}", "/api/run/{run}/results", "/api/run/{run}/report")
TRACEBACK = 'Traceback (most recent call last):\n  File "x.py", line 1\nZeroDivisionError: zero'
RunOf = Callable[[str], Path]


def need_sentences_of(folder: Path) -> None:
    """Read a run folder in every way that a person has; its log, plans and raw data are not it."""
    for verb in VERBS:
        done = here([word.format(run=folder) for word in verb], folder.parent)
        need_sentences(done.stdout + done.stderr, f"station {' '.join(verb)} on {folder.name}")
    for file in (*folder.rglob("*.json"), *folder.rglob("*.html"), *folder.rglob("exports/*.csv")):
        if "raw" not in file.parts:
            text = file.read_text(encoding="utf-8", errors="replace")
            need_sentences(SCRIPTS.sub("", text), file.name)
    with panel(folder.parent) as served:
        for path in PAGES:
            served.get(path.format(run=folder.name))  # which looks at what it returns
    for kind, text in RunWatch(folder).news({}):
        need_sentences(text, f"the panel's {kind}")


def copied(run: Path, to: Path, *left_out: str) -> Path:
    """Return a copy of a finished run that may be spoiled, without what stands for its end."""
    ignored = shutil.ignore_patterns(*left_out)
    return Path(shutil.copytree(run, to / run.name, ignore=ignored))


def unended(run: Path, to: Path, kind: str) -> Path:
    """Return a copy of a run that was killed after the last event of a kind."""
    copy = copied(run, to, "revisions", "results.json", "plots.json", "report*", MANIFEST)
    lines = (copy / EVENTS).read_bytes().splitlines(keepends=True)
    last = max(n for n, line in enumerate(lines) if json.loads(line)["event"] == kind)
    (copy / EVENTS).write_bytes(b"".join(lines[: last + 1]))
    return copy


def failed(run: Path, to: Path, exit_code: int, message: str) -> Path:
    """Return a copy of a run that ended in a step with an error, as its log says."""
    copy = unended(run, to, "unit-started")
    log = EventLog(copy / EVENTS)
    details = {"message": message, "exit_code": exit_code, "traceback": TRACEBACK}
    log.append(1e6, "failed", details, durable=False)
    log.append(1e6, "run-ended", {"exit_code": exit_code}, durable=False)
    log.close()
    return copy


@pytest.mark.parametrize(
    "name", quick(SHORT_FORMS, "rlg-magnetic-sensitivity", "gyro-static-noise")
)
def test_of_a_finished_run(name: str, run_of: RunOf, tmp_path: Path) -> None:
    need_sentences_of(copied(run_of(name), tmp_path))


@pytest.mark.parametrize(
    "entry",
    [
        {"instrument": "gaussmeter", "fault": "no-reply", "at": "100 s", "for": "1 h"},
        {"instrument": "coil_supply.y", "fault": "garbled", "at": "100 s", "for": "1 h"},
        {"instrument": "gyro_acquisition", "fault": "port-gone", "at": "80 s"},
    ],
    ids=lambda entry: f"{entry['instrument']}-{entry['fault']}",
)
def test_of_a_run_that_an_instrument_ended(entry: dict[str, str], tmp_path: Path) -> None:
    outcome, _ = run_with(tmp_path, entry)
    assert outcome.error, "the fault struck nothing"
    need_sentences(outcome.error, "the run")
    failures = [event for event in read_events(outcome.folder / EVENTS) if event.kind == "failed"]
    assert traces_in(failures[-1].details["traceback"]), "for whoever repairs it"
    need_sentences_of(outcome.folder)


@pytest.mark.parametrize(
    "kind",
    quick(["run-started", "step-started", "unit-started", "unit-finished"], "unit-started"),
)
def test_of_a_killed_run(kind: str, one_axis_run: Path, tmp_path: Path) -> None:
    need_sentences_of(unended(one_axis_run, tmp_path, kind))


@pytest.mark.parametrize(
    ("exit_code", "message"),
    [(4, "ended by the operator"), (3, "a fault of the program: division by zero")],
    ids=["aborted", "fault-of-the-program"],
)
def test_of_a_run_that_ended_early(
    exit_code: int, message: str, one_axis_run: Path, tmp_path: Path
) -> None:
    need_sentences_of(failed(one_axis_run, tmp_path, exit_code, message))


SPOILED = (
    "results.json",
    "report.html",
    "plots.json",
    "run.json",
    "plan.yaml",
    "bench.yaml",
    PLAN,
    BENCH,
    EVENTS,
    MANIFEST,
)
WRONG = {
    "no text": lambda data: b"\xff\xfe\x00" + data[3:],
    "cut short": lambda data: data[: len(data) // 2],
    "of another kind": lambda data: b"[1, 2]\n",
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("file", quick(SPOILED, *list(SPOILED)[:2]))
def test_of_a_damaged_folder(file: str, wrong: str, one_axis_run: Path, tmp_path: Path) -> None:
    # Without a manifest, which would name the file, whoever reads it has to see what is wrong.
    copy = copied(one_axis_run, tmp_path, *(() if file == MANIFEST else (MANIFEST,)))
    (copy / file).write_bytes(WRONG[wrong]((copy / file).read_bytes()))
    need_sentences_of(copy)


def test_of_damaged_raw_data(one_axis_run: Path, tmp_path: Path) -> None:
    rng, copy = random.Random(1), copied(one_axis_run, tmp_path)
    for file in sorted((copy / "raw").iterdir()):
        data = bytearray(file.read_bytes())
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        file.write_bytes(data)
    need_sentences_of(copy)


def test_a_trace_is_seen_where_there_is_one() -> None:
    assert traces_in(TRACEBACK)
    assert traces_in("the fit failed: LinAlgError('Singular matrix')")
    assert not traces_in("WARNING: the error of the supply, -222, is 'Data out of range'; Exit")
