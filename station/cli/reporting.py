"""`station report`."""

from __future__ import annotations

from pathlib import Path

from station.record.files import write_whole_file
from station.record.folder import EXPORTS, REPORT, RunFolder
from station.record.recorded import read_run
from station.runner.evaluation import evaluate_run

FILE_OF_FORMAT = {"html": REPORT, "csv": "results.csv", "junit": "results.junit.xml"}


def remake_report(path: Path, format: str) -> None:
    """Make the report of a run again, into the run's `exports` folder, which no manifest covers.

    Prints the path of what was written.
    """
    file = path / EXPORTS / FILE_OF_FORMAT[format]
    text = report_text(read_run(path), format)
    file.parent.mkdir(exist_ok=True)
    write_whole_file(file, text.encode())
    print(file)


def report_text(folder: RunFolder, format: str) -> str:
    """Return the report of a run in a format: html, csv or junit."""
    document, findings = evaluate_run(folder)
    if format == "csv":
        from station.report.result_table import csv_of

        return csv_of(document)
    if format == "junit":
        from station.report.junit import junit_of

        return junit_of(folder, document)
    from station.report.run_report import report_of_run

    return report_of_run(folder, document, findings)
