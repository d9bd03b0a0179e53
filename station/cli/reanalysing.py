"""`station analyse --all`: every run of a store again, in one table."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from station.cli.analysing import made
from station.clock import RealClock
from station.console import span, tell
from station.errors import EXIT_DONE, EXIT_WRONG_INPUT, InputError, StationError
from station.files.faults import listed, meant, nearest
from station.findings import Findings
from station.reanalysis.one_run import Row
from station.record.layout import EVENTS
from station.record.run_names import find_run
from station.record.stores import is_url, refuse_keys, run_urls
from station.runner.evaluation import Propagate
from station.speech import show

Done = TypeVar("Done")
TABLE = "analysis.parquet"
SAYS_EVERY_S = 5.0
MAX_LISTED = 20
NOTICED_U = 1e-6
"""A change below this part of its uncertainty is the last digit of another processor."""


def analyse_store(
    store: str,
    output: Path | None,
    scheduler: str | None,
    calibration: Path | None,
    *,
    as_json: bool,
) -> int:
    """Evaluate every run of a store again, write the table, print what changed.

    The store is a folder or a URL. Returns the exit code: 2 where a run cannot be evaluated. Raises
    InputError where there is none.
    """
    from station.reanalysis.recall import read_recall
    from station.reanalysis.scheduling import evaluated, refuse_without_packages
    from station.reanalysis.table import write_table

    refuse_without_packages()
    recall = read_recall(calibration) if calibration else None
    refuse_keys(store)
    if not is_url(store):
        store = str(find_run(Path(store)))
    folders = runs_of(store, output)
    file = made(output or Path(store)) / TABLE
    write_table([], file.with_name(f".{TABLE}.tried"))  # before hours of work, not after them
    file.with_name(f".{TABLE}.tried").unlink()
    if recall:
        refuse_unknown(recall.replaces, folders)
    rows: list[Row] = []

    def say(number: int, left: str) -> None:
        tell(f"{number} of {len(folders)} runs evaluated, about {left} left")

    for several in reported(evaluated(folders, recall, scheduler), len(folders), say):
        rows.extend(several)
    rows.sort(key=lambda row: row["folder"])
    write_table(rows, file)
    summary = summary_of(rows, len(folders), file)
    if as_json:
        print(json.dumps(summary, indent=1, ensure_ascii=False))
    else:
        print_summary(summary, recall.replaces if recall else None)
    return EXIT_WRONG_INPUT if summary["failed"] else EXIT_DONE


def refuse_without_all(
    data: str, scheduler: str | None, calibration: Path | None, trials: int | None = None
) -> None:
    """Raise InputError where an option or a store is given that needs another option."""
    refuse_keys(data)
    if is_url(data):
        raise InputError(f"the runs of {data} are evaluated by `station analyse --all`")
    if calibration is not None:
        raise InputError("--with-calibration goes with --all, and with a store")
    if scheduler is not None and trials is None:
        raise InputError("--scheduler goes with --all and a store, or with --monte-carlo")


def refuse_trials_of_many(trials: int | None) -> None:
    """Raise InputError where many runs are to have a Monte Carlo."""
    if trials is not None:
        raise InputError("--monte-carlo goes with one run or dataset, not with --all")


def by_trials(trials: int | None, seed: int, scheduler: str | None) -> Propagate | None:
    """Return what propagates a budget by so many trials; None without them."""
    if trials is None:
        return None

    def passing(done: Iterator[Done], chunks: int) -> Iterator[Done]:
        def say(number: int, left: str) -> None:
            tell(f"{number * trials // chunks} of {trials} trials done, about {left} left")

        return reported(done, chunks, say)

    def propagate(findings: Findings) -> Findings:
        from station.reanalysis.monte_carlo import propagated

        return propagated(findings, trials, seed, scheduler, passing)

    return propagate


def runs_of(store: str, output: Path | None) -> list[str]:
    """Return the run folders of a store, at any depth; raises InputError for none.

    The table of a store by its URL goes into `output`: nothing is written there.
    """
    if not is_url(store):
        return run_folders(Path(store))
    if output is None:
        raise InputError(f"nothing is written into {store}; say by --output where the table goes")
    return run_urls(store)


def run_folders(store: Path) -> list[str]:
    """Return the run folders below a folder, at any depth; raises InputError for none."""
    folders = sorted({str(path.parent.resolve()) for path in store.rglob(EVENTS)})
    folders = [folder for folder in folders if not Path(folder).name.startswith(".")]
    if not folders:
        raise InputError(f"there is no run folder below {store}; name the folder that holds them")
    return folders


def refuse_unknown(certificate: str, folders: Sequence[str]) -> None:
    """Raise InputError where no run used a certificate, with those that runs used.

    It is asked before hours of work; the newest runs are looked at first, until one used it.
    """
    from station.reanalysis.one_run import certificates_of

    known, unread = set[str](), list[StationError]()
    for folder in reversed(folders):
        try:
            known |= certificates_of(folder)
        except StationError as error:
            unread.append(error)
        if certificate in known:
            return
    if unread and not known:
        raise unread[0]
    names = sorted(known)
    what = f"no run used certificate '{certificate}'; those that runs used: {listed(names)}"
    near = nearest(certificate, names)
    raise InputError(meant(what, f"'{near}'" if near else None))


def summary_of(rows: Sequence[Row], runs: int, file: Path) -> dict[str, Any]:
    """Return how many runs and results there are, what changed most, and what failed."""
    results = [row for row in rows if "error" not in row]
    changed = [row for row in results if _has_changed(row)]
    changed.sort(key=lambda row: -abs(row["change_in_u"] or float("inf")))
    keys = ("run", "name", "axis", "stored_value", "value", "unit", "change_in_u", "result_verdict")
    return {
        "runs": runs,
        "evaluated": len({row["folder"] for row in results}),
        "results": len(results),
        "changed": len(changed),
        "largest_changes": [{key: row[key] for key in keys} for row in changed[:MAX_LISTED]],
        "verdicts_changed": sorted(
            {row["run"] for row in results if row["verdict"] != row["stored_verdict"]}
        ),
        "failed": {row["folder"]: row["error"] for row in rows if "error" in row},
        "table": str(file),
    }


def print_summary(summary: dict[str, Any], recalled: str | None) -> None:
    """Print a summary for a person; `recalled` is the certificate that was asked about."""
    if recalled is not None:
        show(f"{summary['evaluated']} of {summary['runs']} runs used certificate {recalled}")
    else:
        show(f"{summary['evaluated']} of {summary['runs']} runs evaluated again")
    show(f"{summary['changed']} of {summary['results']} results differ from the stored ones")
    for row in summary["largest_changes"]:
        moved = "" if row["change_in_u"] is None else f", {row['change_in_u']:+.3g} u"
        show(
            f"  {row['run']} {row['name']} {row['axis'] or ''}: {row['stored_value']} → "
            f"{row['value']} {row['unit']}{moved}"
        )
    if summary["changed"] > MAX_LISTED:
        show(f"  {summary['changed'] - MAX_LISTED} more are in the table")
    for run in summary["verdicts_changed"]:
        show(f"another verdict: {run}")
    for folder, why in summary["failed"].items():
        show(f"cannot be evaluated: {folder}: {why}")
    show(f"written: {summary['table']}")


def _has_changed(row: Row) -> bool:
    if row["value"] is None or row["stored_value"] is None:
        return row["value"] is not row["stored_value"]
    before, now = row["stored_expanded_uncertainty"], row["expanded_uncertainty"]
    if None not in (before, now) and abs(now - before) > NOTICED_U * before:
        return True
    return row["change_in_u"] is not None and abs(row["change_in_u"]) > NOTICED_U


def reported(done: Iterator[Done], count: int, say: Callable[[int, str], None]) -> Iterator[Done]:
    """Pass on what comes, and say every few seconds how many came and what time is left."""
    clock = RealClock()
    began_s = reported_s = clock.now()
    for number, item in enumerate(done, start=1):
        yield item
        if number == 1:  # before it workers were started
            began_s = reported_s = clock.now()
        elif clock.now() - reported_s >= SAYS_EVERY_S and number < count:
            reported_s = clock.now()
            say(number, span((reported_s - began_s) / (number - 1) * (count - number)))
