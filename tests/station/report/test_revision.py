"""A report is drawn from the newest revision of a run; nothing is evaluated for it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from station.cli.analysing import analyse_run
from station.cli.reporting import FILES, remake_report
from station.parts import parts_of_text
from station.record.events import EventLog
from station.record.folder import PLOTS, REPORT, RESULTS, RunFolder
from station.record.later import OWN_REVISION, seal
from station.record.layout import (
    EVENTS,
    EXPORTS,
    MANIFEST,
    REVISIONS,
    covered_files,
    write_manifest,
)
from station.record.verification import verify
from station.report.revision import newest_revision
from station.results import ResultDocument

PLANS = ("rlg-magnetic-sensitivity", "serf-nonorthogonality", "gyro-rate-table")
EVALUATIONS = "station.cli.reporting.evaluate_run"


@pytest.fixture
def run(one_axis_run: Path, tmp_path: Path) -> Path:
    """A finished run, for the test alone."""
    return Path(shutil.copytree(one_axis_run, tmp_path / one_axis_run.name))


@pytest.fixture
def no_evaluation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every evaluation of a run fail."""

    def refused(*_: object) -> None:
        raise AssertionError("a run was evaluated")

    monkeypatch.setattr(EVALUATIONS, refused)
    monkeypatch.setattr("station.runner.evaluation.evaluate_run", refused)


def without_plots(run: Path, *, named: bool) -> None:
    """Let a run be one of before plots were data; its log names the revision, or does not yet."""
    own = run / REVISIONS / OWN_REVISION
    for folder in (run, own):
        (folder / PLOTS).unlink()
    write_manifest(own)
    log = (run / EVENTS).read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in log if json.loads(line)["event"] != "revision-written"]
    (run / EVENTS).write_text("".join(kept), encoding="utf-8")
    if named:
        seal(run)
    else:
        write_manifest(run)


def test_plots_and_tables_are_in_the_revision_its_manifest_and_at_the_top(run: Path) -> None:
    own = run / REVISIONS / OWN_REVISION
    assert PLOTS in covered_files(own) and PLOTS in covered_files(run)
    text = (own / PLOTS).read_text(encoding="utf-8")
    assert (run / PLOTS).read_text(encoding="utf-8") == text
    kinds = {type(part).__name__ for part in parts_of_text(text)}
    assert kinds == {"Plot", "Table"}


@pytest.mark.usefixtures("no_evaluation")
@pytest.mark.parametrize(("kind", "format"), FILES)
def test_a_report_evaluates_nothing(kind: str, format: str, run: Path) -> None:
    before = sorted((run / REVISIONS).rglob("*"))
    remake_report(run, format, kind)
    file = run / EXPORTS / FILES[kind, format]
    assert file.stat().st_size > 0
    assert sorted((run / REVISIONS).rglob("*")) == before
    if (kind, format) == ("report", "html"):
        assert file.read_bytes() == (run / REPORT).read_bytes()


@pytest.mark.usefixtures("no_evaluation")
@pytest.mark.filterwarnings("error:Glyph")
def test_a_report_in_another_language_has_its_labels_too(run: Path) -> None:
    remake_report(run, "html", "report", language="zh")
    assert (run / EXPORTS / REPORT).read_bytes() != (run / REPORT).read_bytes()


def test_a_revision_without_plots_is_evaluated_once(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without_plots(run, named=True)
    remake_report(run, "csv", "report")
    assert capsys.readouterr().err.count("evaluated") == 0, "a table needs no plots"
    remake_report(run, "html", "report")
    said = capsys.readouterr().err
    assert f"revision 000 has no plots: evaluated once more, into {run / REVISIONS / '001'}" in said
    assert (run / REVISIONS / "001" / RESULTS).read_bytes() == (run / RESULTS).read_bytes()

    def refused(*_: object) -> None:
        raise AssertionError("a run was evaluated")

    monkeypatch.setattr(EVALUATIONS, refused)
    for format in ("pdf", "html"):
        remake_report(run, format, "report")


def test_a_run_of_before_the_log_named_revisions_is_evaluated_once(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without_plots(run, named=False)
    remake_report(run, "html", "report")
    assert "no revision stands for the run as it is now: evaluated" in capsys.readouterr().err
    assert sorted(path.name for path in (run / REVISIONS).iterdir()) == ["000", "001"]
    assert not verify(run).changed


def test_the_newest_revision_counts(run: Path) -> None:
    analyse_run(run, None, compare=False)
    newest = newest_revision(RunFolder(run))
    assert newest is not None and newest.path.name == "001"


def test_a_revision_that_was_altered_counts_no_more(run: Path) -> None:
    analyse_run(run, None, compare=False)
    file = run / REVISIONS / "001" / PLOTS
    file.write_text(file.read_text(encoding="utf-8").replace("deg", "rad"), encoding="utf-8")
    newest = newest_revision(RunFolder(run))
    assert newest is not None and newest.path.name == OWN_REVISION


def test_a_revision_of_before_data_were_damaged_counts_no_more(run: Path) -> None:
    (run / MANIFEST).unlink()
    assert newest_revision(RunFolder(run)) is None
    remake_report(run, "junit", "report")
    newest = newest_revision(RunFolder(run))
    assert newest is not None and newest.path.name == "001"


def test_a_revision_of_before_a_run_was_resumed_counts_no_more(run: Path) -> None:
    log = EventLog(run / EVENTS)
    log.append(
        log.last_s,
        "resumed",
        {"stopped_s": 1.0, "silent_s": 1.0, "units_finished": [], "software_changed": {}},
        durable=True,
    )
    log.close()
    assert newest_revision(RunFolder(run)) is None


@pytest.mark.parametrize("plan", PLANS)
def test_results_are_read_as_they_were_written(plan: str, run_of: Callable[[str], Path]) -> None:
    data = json.loads((run_of(plan) / RESULTS).read_text(encoding="utf-8"))
    document = ResultDocument.of(data)
    assert json.dumps(document.to_data()) == json.dumps(data), "in the same order"
