"""The last half of a run and the whole of `analyse`: data on disk to results and report."""

from __future__ import annotations

import json
import mmap
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.console import span
from station.errors import (
    EXIT_DONE,
    EXIT_FAULT,
    EXIT_OUTSIDE_LIMIT,
    EXIT_UNDETERMINED,
    InputError,
    MissingRows,
)
from station.files.faults import FaultList, not_there
from station.findings import Findings, Flag
from station.instruments.bench import Bench
from station.parts import parts_of_text, text_of_parts
from station.procedure import Procedures, check_findings, procedure_of
from station.record.events import RESUMED, SAFE_STATE, STANDARD_ALARM, TIME_MISSED
from station.record.files import write_whole_file
from station.record.folder import PLOTS, REPORT, RESULTS, RunFolder
from station.record.integrity import FolderState, first
from station.record.later import add_own_revision, draft_revision
from station.record.layout import MANIFEST, write_manifest
from station.recorded import left_out, left_unverified, read_plan_and_bench, used_instruments
from station.report.trial_tables import trial_tables
from station.results import UNSAFE, ResultDocument, conclude
from station.runner.calibration_flags import record_flags

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.files.plan import Plan

MAX_UNITS = 6
LIBRARIES_BYTES = 280_000_000
"""Address space that SciPy and a report take, once a record is read; little of it is touched."""


Propagate = Callable[[Findings], Findings]
"""Propagates the budgets of findings in another way than by their sensitivities."""


def evaluate_run(
    folder: RunFolder,
    recalled: Callable[[Bench], Bench] | None = None,
    propagate: Propagate | None = None,
) -> tuple[ResultDocument, Findings]:
    """Return the results of a run and what lies behind them, from its folder alone.

    `recalled` puts other calibration records in the place of those of its bench. Units of work
    whose raw data are damaged or missing are left out and named. Raises DamagedRecord where plan,
    bench, log or a file that the plan named is not the one of the run, InputError where the
    analysis finds no solution.
    """
    folder.damage.refuse_altered()
    plan, bench = read_plan_and_bench(folder)
    bench = recalled(bench) if recalled else bench
    procedure = procedure_of(plan.procedure)
    damage = procedure.damage_of(folder, plan.parameters)
    folder.leave_out(damage.units)
    try:
        with quiet_numbers():
            findings, missing = findings_of_run(folder, plan, bench)
            findings = propagate(findings) if propagate else findings
        flags = [
            *findings.flags,
            *flags_of_run(folder, bench),
            *record_flags(procedure, plan.parameters, bench, findings.measured),
            *damage.flags(),
            *nothing_left(folder, damage),
            *missing,
        ]
        findings = replace(findings, flags=flags)
        document = conclude(
            plan.procedure,
            findings,
            plan.limits_by_axis(),
            plan.decision_rule,
            measured=procedure.measured_axes(plan.parameters),
        )
    except (ArithmeticError, ValueError) as error:  # LinAlgError is a ValueError
        raise InputError(
            f"{folder.path}: the analysis finds no solution in the data of this run; look at "
            "them with `station export`"
        ) from error
    return document, findings


def findings_of_run(folder: RunFolder, plan: Plan, bench: Bench) -> tuple[Findings, list[Flag]]:
    """Return what the procedure finds, and a flag for each finished unit that has no raw data.

    Such a unit is left out, and the others are evaluated again.
    """
    procedure, missing = procedure_of(plan.procedure), list[Flag]()
    while True:
        try:
            findings = procedure.evaluate_run(folder, plan.parameters, bench)
            return check_findings(procedure, findings), missing
        except MissingRows as error:
            if error.unit not in folder.finished_units():
                raise
            folder.leave_out([error.unit])
            message = f"Finished, but {error.what}; left out: {error.unit}."
            missing.append(Flag("data-damaged", message, details={"units": [error.unit]}))


def nothing_left(folder: RunFolder, damage: FolderState) -> Iterator[Flag]:
    """Yield a flag where damage leaves no finished unit of work: what is needed, and what to do."""
    parts = [part for part in damage.parts if part.units]
    if parts and not folder.finished_units():
        files = ", ".join(first(tuple(dict.fromkeys(part.file for part in parts))))
        message = (
            f"No result is left: each unit of work needs what was recorded in {files}. Put it back "
            "from a copy of the run folder, then analyse the run again."
        )
        yield Flag("data-damaged", message, details={"units": list(damage.units)})


def flags_of_run(folder: RunFolder, bench: Bench) -> list[Flag]:
    """Return what the run itself, not its data, makes the reader know."""
    flags = []
    if bench.is_simulated:
        flags.append(
            Flag("simulated", "The bench is simulated: these numbers say nothing of a real device.")
        )
    if folder.goes_on:
        flags.append(
            Flag(
                "run-goes-on",
                "The run went on when this was made of what was measured by then, and the bench "
                "was not made safe yet; run `station analyse` again once the run has ended.",
            )
        )
    flags.extend(
        Flag(
            STANDARD_ALARM,
            f"An alarm of a check standard stood when the run began: {event.details['message']}.",
        )
        for event in folder.events_of(STANDARD_ALARM)
    )
    flags.extend(flags_of_gaps(folder))
    flags.extend(flags_of_guardians(folder))
    flags.extend(flags_of_missed_time(folder))
    used = used_instruments(folder)
    for name, entry in bench.instruments.items():
        if (
            name in used
            and entry.calibration is not None
            and entry.calibration.overdue(folder.last_day)
        ):
            flags.append(
                Flag(
                    "calibration-overdue",
                    f"The calibration of {name} was due on {entry.calibration.due}.",
                    details={"instrument": name},
                )
            )
    flags.extend(
        Flag(
            UNSAFE,
            f"The safe state of {name} was not verified at the end of the run: {read_back}.",
            details={"instrument": name},
        )
        for name, read_back in left_unverified(folder, bench).items()
    )
    flags.extend(
        Flag(
            "ambient-changed",
            f"The {witness['instrument']} does not read at the end what it read before: "
            f"{witness['sentence']}. The ambient field changed, or something magnetic was left.",
            details={"instrument": witness["instrument"]},
        )
        for event in list(folder.events_of(SAFE_STATE))[-1:]
        for witness in event.details.get("witnesses", ())
        if witness["ambient"]
    )
    if unread := left_out(folder):
        listed = " and ".join(f"{name} ({why})" for name, why in unread.items())
        flags.append(
            Flag(
                "not-read-back",
                f"Not everything on the bench that can harm was read back at the end: {listed}.",
                details={"instruments": list(unread)},
            )
        )
    return flags


def units_in_words(units: Sequence[str]) -> str:
    """Return the units of work that are finished: their names, or how many where they are many."""
    if len(units) > MAX_UNITS:
        return f"{len(units)} units of work, the last {units[-1]}"
    return ", ".join(units) or "nothing"


def flags_of_gaps(folder: RunFolder) -> Iterator[Flag]:
    """Yield a flag for each time the run was resumed, and where its software had changed."""
    for event in folder.events_of(RESUMED):
        details = event.details
        before = units_in_words(details["units_finished"])
        backwards = {key: details[key] for key in ("backwards_s",) if key in details}
        message = (
            f"The run stopped at {details['stopped_s']:.0f} s of run time and was resumed "
            f"{silence(details['silent_s'], backwards)} later; finished by then: {before}."
        )
        if backwards:
            message += f" {runs_backwards(**backwards)}"
        yield Flag(
            "resumed",
            message,
            details={"stopped_s": details["stopped_s"], "gap_s": details["silent_s"], **backwards},
        )
        changed = details["software_changed"]
        if changed:
            listed = ", ".join(f"{name} {old} → {new}" for name, (old, new) in changed.items())
            yield Flag(
                "software-changed",
                f"The run was resumed by other software than it began with: {listed}.",
                details={"changed": changed},
            )


def flags_of_missed_time(folder: RunFolder) -> Iterator[Flag]:
    """Yield a flag where nothing of the run ran for a while, its watching included."""
    missed = [event.details for event in folder.events_of(TIME_MISSED)]
    if missed:
        listed = ", ".join(f"{m['seconds']:.0f} s until {m['at_s']:.0f} s" for m in missed)
        yield Flag(
            "time-missed",
            f"The run stood still, and nobody watched the bench: {listed} of run time. Its process "
            "was stopped, or the computer slept.",
            details={"seconds": [m["seconds"] for m in missed]},
        )


def silence(silent_s: float, backwards: Mapping[str, float]) -> str:
    """Return how long nothing was heard of a run; a clock that was set back does not tell."""
    return "an unknown time" if backwards and not silent_s else span(silent_s)


def runs_backwards(backwards_s: float) -> str:
    """Say that the clock on which a run was resumed was behind the log's last event."""
    return (
        f"The clock stands {span(backwards_s)} before the run's last event: time runs backwards "
        "there, and no times before and after it compare; look at this computer's clock, or at the "
        "clock of the served bench."
    )


def flags_of_guardians(folder: RunFolder) -> Iterator[Flag]:
    """Yield a flag where a guardian of the run was lost while the run went on."""
    lost = list(folder.events_of("guardian-lost"))
    replaced = len(list(folder.events_of("guardian-replaced")))
    if lost:
        listed = "; ".join(
            f"{words['guardian']} {words['message']} at {words['at_s']:.0f} s"
            for words in (event.details for event in lost[:MAX_UNITS])
        )
        yield Flag(
            "guardian-lost",
            f"A guardian of the run was lost {len(lost)} times and replaced {replaced} times: "
            f"{listed} of run time.",
            details={"count": len(lost), "replaced": replaced},
        )


def conclude_run(path: Path, *, report: bool = True) -> ResultDocument:
    """Evaluate a run for the first time: revision 000, and its copies at the top of the folder."""
    folder = RunFolder(path)
    document, findings = evaluate_run(folder)
    with draft_revision(path) as draft:
        write_revision(folder, draft, document, findings, report=report)
        revision = add_own_revision(path, draft)
    for file in sorted(revision.iterdir()):
        if file.name != MANIFEST:
            write_whole_file(path / file.name, file.read_bytes())
    return document


def write_revision(
    folder: RunFolder,
    place: Path,
    document: ResultDocument,
    findings: Findings,
    *,
    report: bool = True,
) -> None:
    """Write what was evaluated into `place`: results, plots and report if wanted, a manifest."""
    write_results(place, document)
    write_files(place, document, findings)
    if report:
        from station.report.run_report import report_of_run

        plots = plots_of(document, findings)
        write_whole_file(place / PLOTS, plots.encode())
        page = report_of_run(folder, document, parts_of_text(plots))
        write_whole_file(place / REPORT, page.encode())
    write_manifest(place)


def plots_of(document: ResultDocument, findings: Findings) -> str:
    """Return the text of `plots.json`: what the procedure adds to the report, and Monte Carlo."""
    parts = procedure_of(document.procedure).report(findings, document)
    return text_of_parts([*parts, *trial_tables(document)])


def write_results(place: Path, document: ResultDocument) -> None:
    """Write `results.json` into `place`."""
    write_whole_file(place / RESULTS, text_of(document).encode())


def text_of(document: ResultDocument) -> str:
    """Return the text of `results.json`."""
    text = json.dumps(document.to_data(), indent=1, ensure_ascii=False, allow_nan=False)
    return f"{text}\n"


def write_files(place: Path, document: ResultDocument, findings: Findings) -> None:
    """Write what the procedure leaves beside the results, such as a calibration file."""
    procedure = procedure_of(document.procedure)
    for name, text in procedure.files(findings, document).items():
        write_whole_file(place / name, text.encode())


def evaluate_dataset(
    raw: RawDataset, propagate: Propagate | None = None
) -> tuple[ResultDocument, Findings]:
    """Return the results of an imported dataset; without a plan there are no limits.

    Raises FaultList when there is no such procedure, or for whatever is wrong in its files.
    """
    known = Procedures()
    if raw.procedure not in known:
        what = f"there is no procedure '{raw.procedure}'"
        fault = not_there(what, raw.procedure, known)
        raise FaultList([raw.document.fault(("procedure",), *fault)])
    procedure = procedure_of(raw.procedure)
    try:
        with quiet_numbers():
            findings = check_findings(procedure, procedure.evaluate_dataset(raw))
            findings = propagate(findings) if propagate else findings
            return conclude(raw.procedure, findings, {}, "simple"), findings
    except (ArithmeticError, ValueError) as error:  # LinAlgError is a ValueError
        raise InputError(
            f"{raw.document.path}: the analysis finds no solution in these numbers; look for "
            "columns that never change, that repeat each other, or that have another unit"
        ) from error


@contextmanager
def quiet_numbers() -> Iterator[None]:
    """Keep the libraries' warnings off the terminal: what they warn of is null and flagged.

    Raises MemoryError where there is no room for these libraries.
    """
    refuse_without_room()
    import numpy as np

    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def exit_code_of(document: ResultDocument) -> int:
    """Return the exit code of a verdict; a wrong excitation is a fault of the bench."""
    if not document.excited:
        return EXIT_FAULT
    codes: Mapping[str, int] = {"fail": EXIT_OUTSIDE_LIMIT, "inconclusive": EXIT_UNDETERMINED}
    return codes.get(document.verdict, EXIT_DONE)


def largest_difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> float:
    """Return the largest change of a value between two result documents, in its uncertainty."""
    before = {(entry["name"], entry["axis"]): entry for entry in old["results"]}
    largest = 0.0
    for entry in new["results"]:
        earlier = before.get((entry["name"], entry["axis"]))
        values = (entry["value"], earlier and earlier["value"])
        if values[0] is None or values[1] is None:
            if values[0] is not values[1]:
                return float("inf")
            continue
        change, u = abs(values[0] - values[1]), entry["standard_uncertainty"]
        if change:
            largest = max(largest, change / u if u else float("inf"))
    return largest


def refuse_without_room() -> None:
    """Raise MemoryError where the libraries of an evaluation get no address space (`ulimit -v`).

    Their linear algebra would wait for ever, or end the process with an exit code of its own.
    """
    if sys.platform == "win32" or "scipy.linalg" in sys.modules:
        return
    try:
        flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
        mmap.mmap(-1, LIBRARIES_BYTES, flags, mmap.PROT_READ).close()
    except OSError as error:
        raise MemoryError("no room for the libraries of an evaluation") from error
