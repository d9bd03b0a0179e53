"""Put every fault at every step of every shipped plan and hold each run against one oracle.

python benchmarks/fault_campaign.py [--bench NAME] [--plan NAME …] [--only TEXT] [--part 1/4]
[--sample SEED --minutes N]

In this process, on virtual time, plans in a short form. One JSON line for each case that struck
and breaks a promise, then for each plan the counts, and for each kind of fault the bench times
from the fault until the last coil is driven no more, and until every instrument that can harm was
read back safe (runs that the fault ended while a coil was energised). A sample has each kind of
fault of each role of each plan once, then what there is time for; `not_run` is the rest.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaigns.faults import Case, Verdict, all_cases, judged, plans, reference_run
from short_forms import BENCH

Drawn = tuple[Case, dict[str, Any]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bench", default=BENCH, help="a simulated bench, such as sim-alternate")
    parser.add_argument("--plan", nargs="+", help="these plans; all valid on the bench if none")
    parser.add_argument("--only", default="", help="cases whose name holds this text")
    parser.add_argument("--part", default="1/1", help="which part of the cases, such as 2/4")
    parser.add_argument("--sample", type=int, help="draw the cases in an order of this seed")
    parser.add_argument("--minutes", type=float, default=math.inf, help="of all plans, of a sample")
    parser.add_argument("--all-lines", action="store_true", help="a line for every case")
    arguments = parser.parse_args()
    part, parts = map(int, arguments.part.split("/"))
    with tempfile.TemporaryDirectory() as place:
        os.environ["XDG_STATE_HOME"] = str(Path(place) / "state")
        names = arguments.plan or plans(arguments.bench)
        began_s = time.monotonic()
        for number, plan in enumerate(names):
            left_s = 60.0 * arguments.minutes - (time.monotonic() - began_s)
            until_s = time.monotonic() + left_s / (len(names) - number)
            campaign(plan, Path(place) / plan, (part, parts), arguments, until_s)


def campaign(
    plan: str,
    folder: Path,
    part: tuple[int, int],
    arguments: argparse.Namespace,
    until_s: float,
) -> None:
    reference = reference_run(plan, folder / "reference", arguments.bench)
    cases = [one for one in all_cases(plan, reference) if arguments.only in str(one[0])]
    due = [case for number, case in enumerate(cases) if number % part[1] == part[0] - 1]
    each_once = len(due)
    if arguments.sample is not None:
        due, each_once = drawn(due, arguments.sample)
    verdicts = []
    for number, (case, entry) in enumerate(due):
        if number >= each_once and time.monotonic() > until_s:
            break
        place = folder / f"case-{number}"
        verdict = judged(case, entry, reference, place)
        verdicts.append(verdict)
        if verdict.violations or arguments.all_lines:
            print(json.dumps(line_of(verdict, entry)), flush=True)
        shutil.rmtree(place)
    print(json.dumps(counts(plan, arguments, len(cases), verdicts)), flush=True)
    for kind in sorted({one.case.kind for one in verdicts}):
        mine = [one for one in verdicts if one.case.kind == kind]
        print(
            json.dumps({"benchmark": "fault_campaign", "plan": plan, "kind": kind, **times(mine)})
        )


def drawn(cases: list[Drawn], seed: int) -> tuple[list[Drawn], int]:
    """Return cases in a drawn order, and how many come first: each kind of each role once."""
    order = np.random.default_rng(seed).permutation(len(cases))
    first: dict[tuple[str, str], Drawn] = {}
    for number in order:
        case = cases[number][0]
        first.setdefault((case.role, case.kind), cases[number])
    chosen = {str(case) for case, _ in first.values()}
    rest = [cases[number] for number in order if str(cases[number][0]) not in chosen]
    return [*first.values(), *rest], len(first)


def line_of(verdict: Verdict, entry: dict[str, Any]) -> dict[str, Any]:
    return {
        "case": str(verdict.case),
        "entry": entry,
        "struck": verdict.struck,
        "exit_code": verdict.exit_code,
        "to_zero_s": verdict.to_zero_s,
        "to_verified_s": verdict.to_verified_s,
        "sentence": verdict.sentence,
        "violations": verdict.violations,
    }


def counts(
    plan: str, arguments: argparse.Namespace, cases: int, verdicts: list[Verdict]
) -> dict[str, Any]:
    struck = [one for one in verdicts if one.struck]
    return {
        "benchmark": "fault_campaign",
        "plan": plan,
        "part": arguments.part,
        "sample": arguments.sample,
        "cases_of_the_plan": cases,
        "injected": len(verdicts),
        "not_run": cases - len(verdicts),
        "struck": len(struck),
        "struck_while_energised": sum(one.energised for one in struck),
        "exit_codes": dict(sorted(Counter(one.exit_code for one in struck).items())),
        "violations": sum(len(one.violations) for one in verdicts),
        "cases_with_violations": sum(bool(one.violations) for one in verdicts),
    }


def times(verdicts: list[Verdict]) -> dict[str, Any]:
    return {
        "struck": sum(one.struck for one in verdicts),
        "violations": sum(len(one.violations) for one in verdicts),
        "to_zero_s": spread([one.to_zero_s for one in verdicts if one.to_zero_s is not None]),
        "to_verified_s": spread(
            [one.to_verified_s for one in verdicts if one.to_verified_s is not None]
        ),
    }


def spread(values: list[float]) -> dict[str, float] | None:
    if not values:
        return None
    least, median, most_of_them, largest = np.quantile(values, [0.0, 0.5, 0.95, 1.0])
    return {
        "n": len(values),
        "min": round(float(least), 3),
        "median": round(float(median), 3),
        "p95": round(float(most_of_them), 3),
        "max": round(float(largest), 3),
    }


if __name__ == "__main__":
    main()
