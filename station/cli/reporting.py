"""`station report`."""

from __future__ import annotations

from pathlib import Path

from station.evaluation import evaluate_run
from station.record.folder import REPORT, RunFolder


def remake_report(path: Path) -> None:
    """Make the report of a run again, into the run's `exports` folder, which no manifest covers."""
    from station.report.run_report import report_of_run

    folder = RunFolder(path)
    document, findings = evaluate_run(folder)
    exports = path / "exports"
    exports.mkdir(exist_ok=True)
    (exports / REPORT).write_text(report_of_run(folder, document, findings), encoding="utf-8")
    print(exports / REPORT)
