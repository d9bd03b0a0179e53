"""`station analyse`, `export`: what comes out of recorded data, once more."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from station.console import tell
from station.dataset_reading import DATASET_FILE, read_dataset
from station.errors import DamagedRecord, InputError, reason_of
from station.files.lookup import is_there
from station.findings import Findings
from station.parts import parts_of_text
from station.record.files import write_whole_file
from station.record.folder import REPORT, RESULTS, RunFolder, read_run
from station.record.integrity import MAX_FLAGS, first, sentence_of
from station.record.later import add_revision, draft_revision
from station.record.layout import EVENTS, EXPORTS
from station.record.run_names import runs_below
from station.report.numbers import format_like, format_result
from station.results import ResultDocument
from station.runner.evaluation import (
    Propagate,
    evaluate_dataset,
    evaluate_run,
    exit_code_of,
    largest_difference,
    plots_of,
    write_files,
    write_results,
    write_revision,
)
from station.speech import HERE, said, show
from station.texts import FLAGS, catalogue
from station.uncertainty import MONTE_CARLO


def print_document(document: ResultDocument) -> None:
    """Print results with expanded uncertainties, the published values, flags and the verdict."""
    published = {(entry.name, entry.axis): entry for entry in document.published}
    for result in document.results:
        estimate, combined = result.estimate, result.combined
        value, uncertainty = format_result(result)
        line = f"{said(estimate.measures)} {estimate.axis or '':<3} {said(f'{value:>10}')}"
        if combined:
            line += f" ± {uncertainty} {estimate.unit} (k = {combined.coverage_factor:.2f})"
        if estimate.holds_at:
            line += said(f" at {estimate.holds_at}")
        other = published.get((estimate.name, estimate.axis))
        if other is not None and other.value is not None:
            line += said(f"   as published {format_like(other.value, value)}")
        if result.limit is not None:
            line += said(f"   {result.decision.verdict}")
        print(line)
    titles = catalogue(HERE.language, FLAGS)
    for flag in document.flags:
        named = " ".join(filter(None, (titles.get(flag.code), flag.code, flag.axis)))
        print(f"{named}: {said(flag.message)}")
    _print_trials(document)
    show(f"verdict: {document.verdict}")


def _print_trials(document: ResultDocument) -> None:
    """Print how many results a Monte Carlo agrees with, and those that it does not."""
    tried = [result for result in document.results if "monte_carlo" in result.estimate.extra]
    if not tried:
        return
    entries = [result.estimate.extra["monte_carlo"] for result in tried]
    agreeing = sum(entry["agrees"] for entry in entries)
    show(
        f"Monte Carlo of {entries[0]['n']} trials, seed {entries[0]['seed']}: {agreeing} of "
        f"{len(tried)} results agree with the linear propagation"
    )
    for result, entry in zip(tried, entries, strict=True):
        estimate = result.estimate
        if entry["agrees"]:
            continue
        what = f"{said(estimate.measures)} {estimate.axis or ''}".strip()
        u = entry["standard_uncertainty"]
        if u is None:
            show(f"  {what}: too few trials give a value")
        elif estimate.method == MONTE_CARLO:
            show(f"  {what}: less certain than linear, value and u are those of the trials")
        else:
            show(f"  {what}: u of the trials is {u:.2g} {estimate.unit}, the linear result stays")


def analyse_data(
    data: Path,
    output: Path | None,
    propagate: Propagate | None = None,
    *,
    compare: bool,
    as_json: bool,
) -> int:
    """Analyse a run folder or a dataset, print the results, and return the exit code."""
    if is_there(data / EVENTS):
        document = analyse_run(data, output, propagate, compare=compare)
    else:
        if not is_there(data / DATASET_FILE) and (runs := len(runs_below(data))):
            raise InputError(
                f"{data} holds {runs} runs, and is neither a run nor a dataset; name one of them, "
                "or have every run evaluated again by `station analyse --all`, which has no "
                "--monte-carlo"
            )
        if compare:
            raise InputError(f"{data} is a dataset; it has no stored results to compare with")
        document = analyse_dataset(data, output, propagate)
    if as_json:
        print(json.dumps(document.to_data(), indent=1, ensure_ascii=False))
    else:
        print_document(document)
    return exit_code_of(document)


def analyse_run(
    path: Path, output: Path | None, propagate: Propagate | None = None, *, compare: bool
) -> ResultDocument:
    """Analyse a run again: a new revision in its folder, or into `output`."""
    folder = RunFolder(path)
    old = stored_results(folder) if compare else None
    document, findings = evaluate_run(folder, propagate=propagate)
    name_unused(folder)
    if output:
        written = made(output)
        write_revision(folder, written, document, findings)
    else:
        written = new_revision(folder, document, findings)
    tell(f"written: {written / RESULTS}, {written / REPORT}")
    if old is not None:
        difference = largest_difference(old, document.to_data())
        tell(f"largest difference from the stored results: {difference:.3g} standard uncertainties")
    return document


def new_revision(folder: RunFolder, document: ResultDocument, findings: Findings) -> Path:
    """Write what was evaluated into a new revision of a run, and return its folder."""
    with draft_revision(folder.path) as draft:
        write_revision(folder, draft, document, findings)
        return add_revision(folder.path, draft)


def name_unused(folder: RunFolder) -> None:
    """Name what was altered in a folder, though nothing that was evaluated is made of it."""
    for sentence in first(folder.damage.remade):
        tell(f"not used here, but altered: {sentence}")


def stored_results(folder: RunFolder) -> dict[str, Any]:
    """Return the results that a run has stored; raises InputError where they cannot be used."""
    stored = folder.path / RESULTS
    if not stored.is_file():
        raise InputError(f"{folder.path} has no stored {RESULTS} to compare with")
    if altered := folder.damage.against(RESULTS):
        raise DamagedRecord(f"{altered[0]}; leave --compare out")
    try:
        old: dict[str, Any] = json.loads(stored.read_text(encoding="utf-8"))
        largest_difference(old, old)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise DamagedRecord(
            f"{stored} was altered: it is no result document ({reason_of(error)}); "
            "leave --compare out"
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


def analyse_dataset(
    path: Path, output: Path | None, propagate: Propagate | None = None
) -> ResultDocument:
    """Analyse an imported dataset; with `output` its results and report are written there."""
    from station.report.run_report import report_of_dataset

    raw = read_dataset(path)
    document, findings = evaluate_dataset(raw, propagate)
    if output is not None:
        made(output)
        write_results(output, document)
        write_files(output, document, findings)
        page = report_of_dataset(raw, document, parts_of_text(plots_of(document, findings)))
        write_whole_file(output / REPORT, page.encode())
        tell(f"written: {output / RESULTS}, {output / REPORT}")
    return document


def export_run(path: Path, format: str) -> None:
    """Write the raw data of a run into its `exports` folder, and print the path of what it wrote.

    HDF5 and MAT are one file each, CSV is a folder with a file for each source and unit of work.
    Damaged blocks are passed over and named; their units count as unfinished. Raises DamagedRecord
    where plan, bench or log is not the one of the run.
    """
    folder = read_run(path)
    folder.damage.refuse_altered()
    folder.leave_out(folder.damage.units)
    for part in folder.damage.parts[:MAX_FLAGS]:
        tell(sentence_of(part))
    exports = path / EXPORTS
    name = path.resolve().name
    if format == "hdf5":
        from station.record.export.hdf5 import export_hdf5

        written = exports / f"{name}.h5"
        export_hdf5(folder, written)
    elif format == "mat":
        from station.record.export.mat import export_mat

        written = exports / f"{name}.mat"
        export_mat(folder, written)
    else:
        from station.record.export.csv_files import export_csv

        written = exports / "csv"
        export_csv(folder, written)
    print(written)
