"""Plant known faults in clean datasets and hold each analysis against the truth.

    python benchmarks/sabotage.py [--procedure NAME …] [--fault TEXT] [--seeds 3] [--clean 0]

Each `sabotage_*.py` beside this file makes datasets of one procedure, with their true values, and
plants faults in them. A dataset is written as a folder and analysed as `station analyse` does. One
JSON object a fault and seed: `error_u` is the largest error of a result in its standard
uncertainties, `shown` whether the data can show the fault: a test that knows its cause detects it
in 99 % of such data and the error is above 4 u. `broken` is a fault that the data can show and that
no flag names. The last line of each procedure counts. With `--clean N` the same datasets without a
fault, seeds 1000 to 999+N: `false` are flags that a clean dataset must not raise.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

for folder in ("", "tests/support", "benchmarks"):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / folder))

Array = NDArray[Any]

PROCEDURES = {
    "accelerometer-magnetic-sensitivity": "sabotage_accelerometer",
    "fog-scale-factor-temperature": "sabotage_fog",
    "nine-axis-calibration": "sabotage_nine_axis",
    "rlg-magnetic-sensitivity": "sabotage_rlg",
    "serf-nonorthogonality": "sabotage_serf",
}
SILENT_ABOVE_U = 4.0
FOUND_ABOVE = 4.65
"""Where a test with 1 % of false alarms detects 99 %: twice the 99 % point of a normal deviate."""


@dataclass(frozen=True)
class Made:
    """One dataset and what is true of it.

    `truth` maps (name, axis, at) of results to values, `write` puts the dataset into a folder.
    `data` (n,) are its readings in one order, `model` (n, p) their derivatives by everything that
    a clean dataset leaves free, `noise` (n,) their standard deviations. `further_error_u` returns
    the largest error, in standard uncertainties, of what a result holds beside its value.
    """

    truth: Mapping[tuple[str, str | None, str | None], float]
    write: Callable[[Path], None]
    data: Array
    model: Array
    noise: Array
    further_error_u: Callable[[Sequence[Mapping[str, Any]]], float] | None = None


@dataclass(frozen=True)
class Fault:
    """A fault planted in a dataset.

    `clean` and `planted` make the same dataset of a seed, without and with it. `flags` are the
    codes that name its cause. `detectable` says so where rows differ and nothing can be compared.
    """

    name: str
    flags: frozenset[str]
    clean: Callable[[int], Made]
    planted: Callable[[int], Made]
    detectable: bool | None = None
    details: Mapping[str, Any] = field(default_factory=dict)


def deviates(clean: Made, planted: Made) -> float:
    """Return how many standard deviations a test that knows the cause sees in the data.

    It is the norm of what the fault changes, weighted, less all that a free parameter can take up.
    """
    weight = 1.0 / clean.noise
    change = (planted.data - clean.data) * weight
    model = clean.model * weight[:, None]
    taken, *_ = np.linalg.lstsq(model, change, rcond=None)
    return float(np.linalg.norm(change - model @ taken))


def analysed(made: Made) -> dict[str, Any]:
    """Return the results of a dataset as the contract writes them; none where it is refused."""
    from station.dataset_reading import read_dataset
    from station.errors import InputError
    from station.files.faults import FaultList
    from station.runner.evaluation import evaluate_dataset

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "dataset"
        folder.mkdir()
        made.write(folder)
        try:
            document, _ = evaluate_dataset(read_dataset(folder))
        except (InputError, FaultList) as faults:
            return {"results": [], "flags": [{"code": "refused", "message": str(faults)}]}
        return document.to_data()


def error_u(made: Made, results: Sequence[Mapping[str, Any]]) -> float:
    """Return the largest error of a result in its standard uncertainties, 0 where none is given."""
    worst = 0.0 if made.further_error_u is None else made.further_error_u(results)
    for one in results:
        key = (one["name"], one.get("axis"), one.get("at"))
        if one["value"] is None or key not in made.truth:
            continue
        off, u = abs(one["value"] - made.truth[key]), one["standard_uncertainty"]
        worst = max(worst, off / u if u else float("inf") if off else 0.0)
    return worst


def judged(fault: Fault, seed: int) -> dict[str, Any]:
    """Plant a fault and return what followed."""
    clean, planted = fault.clean(seed), fault.planted(seed)
    document = analysed(planted)
    codes = sorted({flag["code"] for flag in document["flags"]})
    worst = error_u(planted, document["results"])
    strength = None if fault.detectable is not None else deviates(clean, planted)
    detectable = fault.detectable if strength is None else strength > FOUND_ABOVE
    named = bool(fault.flags & set(codes))
    shown = bool(detectable) and worst > SILENT_ABOVE_U
    return {
        "benchmark": "sabotage",
        "fault": fault.name,
        "seed": seed,
        "error_u": round(worst, 2),
        "deviates": None if strength is None else round(strength, 1),
        "shown": shown,
        "named": named,
        "flags": codes,
        "broken": shown and not named,
        **fault.details,
    }


def faults_of(procedure: str) -> Sequence[Fault]:
    """Return the faults of a procedure."""
    found: Sequence[Fault] = importlib.import_module(PROCEDURES[procedure]).FAULTS
    return found


def clean_runs(procedure: str, count: int) -> Iterator[dict[str, Any]]:
    """Analyse datasets without a fault; each kind of dataset in turn."""
    module = importlib.import_module(PROCEDURES[procedure])
    makers: Sequence[Callable[[int], Made]] = module.CLEAN
    usual: frozenset[str] = module.USUAL_FLAGS
    for seed in range(1000, 1000 + count):
        made = makers[seed % len(makers)](seed)
        document = analysed(made)
        codes = {flag["code"] for flag in document["flags"]}
        yield {
            "benchmark": "sabotage",
            "procedure": procedure,
            "clean": seed,
            "error_u": round(error_u(made, document["results"]), 2),
            "false": sorted(codes - usual),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--procedure", nargs="+", default=list(PROCEDURES), choices=PROCEDURES)
    parser.add_argument("--fault", default="", help="only faults whose name holds this text")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--clean", type=int, default=0, help="this many datasets without a fault")
    options = parser.parse_args()
    for procedure in options.procedure:
        if options.clean:
            lines = []
            for one in clean_runs(procedure, options.clean):
                lines.append(one)
                if one["false"]:
                    print(json.dumps(one), flush=True)
            report = {"clean": len(lines), "false": sum(bool(one["false"]) for one in lines)}
        else:
            chosen = [one for one in faults_of(procedure) if options.fault in one.name]
            lines = []
            for fault in chosen:
                for seed in range(options.seeds):
                    lines.append(judged(fault, seed))
                    print(json.dumps(lines[-1]), flush=True)
            report = {
                "faults": len(chosen),
                "planted": len(lines),
                "shown": sum(one["shown"] for one in lines),
                "broken": sum(one["broken"] for one in lines),
            }
        print(json.dumps({"benchmark": "sabotage", "procedure": procedure, **report}), flush=True)


if __name__ == "__main__":
    main()
