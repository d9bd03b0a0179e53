"""`station analyse`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from station.cli.printing import print_document
from station.console import tell
from station.dataset_reading import read_dataset
from station.errors import DamagedRecord, InputError
from station.files.lookup import is_there
from station.record.creation import EVENTS
from station.record.files import write_whole_file
from station.record.folder import REPORT, RESULTS, RunFolder
from station.record.integrity import first
from station.results import ResultDocument
from station.runner.evaluation import (
    evaluate_dataset,
    evaluate_run,
    exit_code_of,
    largest_difference,
    write_files,
    write_results,
    write_revision,
)


def analyse_data(data: Path, output: Path | None, *, compare: bool, as_json: bool) -> int:
    """Analyse a run folder or a dataset, print the results, and return the exit code."""
    if is_there(data / EVENTS):
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
    old = stored_results(folder) if compare else None
    document, findings = evaluate_run(folder)
    for said in first(folder.damage.remade):
        tell(f"not used here, but altered: {said}")
    place = made(output) if output else folder.new_revision()
    write_revision(folder, place, document, findings)
    tell(f"written: {place / RESULTS}, {place / REPORT}")
    if old is not None:
        difference = largest_difference(old, document.to_data())
        tell(f"largest difference from the stored results: {difference:.3g} standard uncertainties")
    return document


def stored_results(folder: RunFolder) -> dict[str, Any]:
    """Return the results that a run has stored; raises InputError where they cannot be used."""
    stored = folder.path / RESULTS
    if not stored.is_file():
        raise InputError(f"{folder.path} has no stored {RESULTS} to compare with")
    altered = [said for said in folder.damage.remade if said.startswith(f"{stored} ")]
    if altered:
        raise DamagedRecord(f"{altered[0]}; leave --compare out")
    try:
        old: dict[str, Any] = json.loads(stored.read_text(encoding="utf-8"))
        largest_difference(old, old)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise DamagedRecord(
            f"{stored} was altered: it is no result document ({error!r}); leave --compare out"
        ) from error
    return old


def made(output: Path) -> Path:
    """Return a folder for results, made where it is missing; raises InputError."""
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot write results into {output}: {error.strerror or error}; choose another "
            "folder with --output"
        ) from error
    return output


def analyse_dataset(path: Path, output: Path | None) -> ResultDocument:
    """Analyse an imported dataset; with `output` its results and report are written there."""
    from station.report.dataset_report import report_of_dataset

    raw = read_dataset(path)
    document, findings = evaluate_dataset(raw)
    if output is not None:
        made(output)
        write_results(output, document)
        write_files(output, document, findings)
        write_whole_file(output / REPORT, report_of_dataset(raw, document, findings).encode())
        tell(f"written: {output / RESULTS}, {output / REPORT}")
    return document
