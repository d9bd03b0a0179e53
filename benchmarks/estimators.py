"""What the estimators of all nine procedures are worth: one line a result, and one table.

    python benchmarks/estimators.py [--procedure NAME …] [--case TEXT] [--runs 2000] [--first 5000]
        [--clean 0] [--processes 1] > after.jsonl
    python benchmarks/estimators.py --table before.jsonl after.jsonl

A line has procedure, case and quantity: root mean square error over the Cramér-Rao bound, where
that is known, and over the stated standard uncertainty, each with its standard error; coverage of
the 95 % interval; the largest error in u; the share of datasets that leave it undetermined. All
axes of a result are one line, the worst of them beside. A line with the quantity `flags` says in
which share of a case's datasets each flag came, and how often the analysis ended in an exception.
Where an analysis takes longer than half a second a quarter of the runs is made. With `--clean N`
the datasets without a fault of the planted faults (`sabotage.py`) are analysed too: a line with the
quantity `false flags`. The cases are those of the benchmarks `*_estimator.py`, their noise is new.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

# Matrices of a hundred rows gain nothing from threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from campaigns.planted.judging import clean_runs
from cases import Trial, Trials, shares, summary

MODULES = {
    "rlg-magnetic-sensitivity": "rlg_estimator",
    "accelerometer-magnetic-sensitivity": "accelerometer_estimator",
    "serf-nonorthogonality": "serf_estimator",
    "fog-scale-factor-temperature": "fog_estimator",
    "nine-axis-calibration": "nine_axis_estimator",
    "gyro-static-noise": "gyro_static_estimator",
    "gyro-rate-table": "gyro_rate_estimator",
    "accelerometer-tumble": "tumble_estimator",
    "gyro-bias-temperature": "bias_temperature_estimator",
}
"""The benchmark of each procedure that makes its cases."""
SLOW_S, SLOW_SHARE = 0.5, 4
"""From this time of an analysis on only this part of the runs is made."""
FAILED = "exception"
"""Stands among the flags for an analysis that ends in one."""
COLUMNS = ("rmse_over_bound", "rmse_over_u", "coverage_95", "largest_error_u", "undetermined")


def trials_of(procedure: str) -> Trials:
    """Return what makes and analyses a dataset of each case of a procedure."""
    trials: Trials = import_module(MODULES[procedure]).trials()
    return trials


def tried(procedure: str, case: str, seed: int) -> Trial:
    """Analyse one dataset; an exception is counted."""
    try:
        return trials_of(procedure)[case](seed)
    except (ArithmeticError, ValueError, LookupError, TypeError, AssertionError) as error:
        return Trial({}, frozenset({f"{FAILED} {type(error).__name__}"}))


def clean_flags(procedure: str, seed: int) -> list[str]:
    """Return the flags of one dataset without a fault that it must not raise."""
    (run,) = clean_runs(procedure, 1, first=seed)
    return list(run["false"])


def lines_of_case(procedure: str, case: str, seeds: range, pool: Any) -> Iterator[dict[str, Any]]:
    """Yield a line for each result of a case, then that of its flags."""
    tried(procedure, case, seeds[0])  # what is worked out once
    begin = time.process_time()
    tried(procedure, case, seeds[0])
    seconds = time.process_time() - begin
    if seconds > SLOW_S:
        seeds = seeds[: max(1, len(seeds) // SLOW_SHARE)]
    trials: Sequence[Trial] = pool(partial(tried, procedure, case), seeds)
    names = dict.fromkeys(name for one in trials for name in one.results)
    head = {"procedure": procedure, "case": case}
    for name in names:
        yield {**head, "quantity": name, **summary(trials, name)}
    raised = {"runs": len(trials), "seconds": round(seconds, 3), "shares": shares(trials)}
    yield {**head, "quantity": "flags", **raised}


def clean_line(procedure: str, seeds: range, pool: Any) -> dict[str, Any]:
    """Return how many datasets without a fault raise a flag of one, and which."""
    flags: Sequence[list[str]] = pool(partial(clean_flags, procedure), seeds)
    count = Counter(code for one in flags for code in one)
    return {
        "procedure": procedure,
        "case": "clean",
        "quantity": "false flags",
        "runs": len(flags),
        "false": sum(bool(one) for one in flags),
        "by_code": dict(sorted(count.items())),
    }


def table(files: Sequence[Path]) -> Iterator[str]:
    """Yield the rows of one table: each line of the files' results, file beside file."""
    read = [_by_key(file) for file in files]
    names = [file.stem for file in files]
    yield (
        "| procedure, case | quantity | "
        + " | ".join(f"{name}: rmse/CRLB; rmse/u; covered; largest; null" for name in names)
        + " |"
    )
    yield "|---" * (2 + len(files)) + "|"
    for key in dict.fromkeys(key for one in read for key in one):
        procedure, case, quantity = key
        if quantity != "flags":
            cells = [_cell(one[key]) if key in one else "" for one in read]
            yield f"| {procedure}: {case} | {quantity} | " + " | ".join(cells) + " |"


def _by_key(file: Path) -> dict[tuple[str, str, str], dict[str, Any]]:
    lines = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {(one["procedure"], one["case"], one["quantity"]): one for one in lines}


def _cell(line: dict[str, Any]) -> str:
    if "false" in line:
        codes = ", ".join(f"{code} {count}" for code, count in line["by_code"].items())
        return f"{line['false']} of {line['runs']}" + (f": {codes}" if codes else "")
    values = [line.get(name) for name in COLUMNS]
    texts = ["–" if one is None else f"{one:.3g}" for one in values]
    if values[2] is not None:
        texts[2] = f"{100.0 * values[2]:.1f} %"
    return "; ".join(texts) + f" ({line['runs']})"


def main() -> None:
    """Print the lines, or the table of files of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--procedure", nargs="+", default=list(MODULES), choices=MODULES)
    parser.add_argument("--case", default="", help="only cases whose name holds this text")
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--first", type=int, default=5000, help="the first seed")
    parser.add_argument("--clean", type=int, default=0, help="datasets without a fault as well")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--table", nargs="+", type=Path, help="make a table of printed lines")
    options = parser.parse_args()
    if options.table:
        print("\n".join(table(options.table)))
        return
    processes = multiprocessing.Pool(options.processes) if options.processes > 1 else None

    def pool(work: Any, seeds: range) -> list[Any]:
        return processes.map(work, seeds, 8) if processes else [work(seed) for seed in seeds]

    for procedure in options.procedure:
        if options.runs:
            for case in trials_of(procedure):
                if options.case in case:
                    seeds = range(options.first, options.first + options.runs)
                    for line in lines_of_case(procedure, case, seeds, pool):
                        print(json.dumps(line, ensure_ascii=False), flush=True)
        if options.clean:
            seeds = range(options.first, options.first + options.clean)
            line = clean_line(procedure, seeds, pool)
            print(json.dumps(line, ensure_ascii=False), flush=True)


if __name__ == "__main__":
    main()
