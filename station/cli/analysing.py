"""`station analyse`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from station.cli.printing import print_document
from station.dataset_reading import read_dataset
from station.errors import InputError
from station.evaluation import (
    evaluate_dataset,
    exit_code_of,
    largest_difference,
    write_files,
    write_results,
    write_revision,
)
from station.record.creation import EVENTS
from station.record.folder import REPORT, RESULTS, RunFolder
from station.results import ResultDocument


def analyse_data(data: Path, output: Path | None, *, compare: bool, as_json: bool) -> int:
    """Analyse a run folder or a dataset, print the results, and return the exit code."""
    if (data / EVENTS).is_file():
        document = analyse_run(data, output, compare=compare)
    else:
        if compare:
            raise InputError(f"{data} is a dataset; it has no stored results to compare with")
        document = analyse_dataset(data, output)
    if as_json:
        print(json.dumps(document.to_data(), indent=1, ensure_ascii=False))
    else:
        print_document(document)
    return exit_code_of(document)


def analyse_run(path: Path, output: Path | None, *, compare: bool) -> ResultDocument:
    """Analyse a run again: a new revision in its folder, or into `output`."""
    folder = RunFolder(path)
    place = output or folder.new_revision()
    place.mkdir(parents=True, exist_ok=True)
    document = write_revision(folder, place)
    print(f"written: {place / RESULTS}, {place / REPORT}", file=sys.stderr)
    if compare:
        stored = path / RESULTS
        if not stored.is_file():
            raise InputError(f"{path} has no stored {RESULTS} to compare with")
        old = json.loads(stored.read_text(encoding="utf-8"))
        difference = largest_difference(old, document.to_data())
        print(
            f"largest difference from the stored results: {difference:.3g} standard uncertainties",
            file=sys.stderr,
        )
    return document


def analyse_dataset(path: Path, output: Path | None) -> ResultDocument:
    """Analyse an imported dataset; with `output` its results and report are written there."""
    from station.report.dataset_report import report_of_dataset

    raw = read_dataset(path)
    document, findings = evaluate_dataset(raw)
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        write_results(output, document)
        write_files(output, document, findings)
        (output / REPORT).write_text(report_of_dataset(raw, document, findings), encoding="utf-8")
        print(f"written: {output / RESULTS}, {output / REPORT}", file=sys.stderr)
    return document
