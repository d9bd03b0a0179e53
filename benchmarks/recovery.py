"""How well a shipped plan recovers the truth of the simulated bench, over many seeds.

    python benchmarks/recovery.py --seeds 40
    python benchmarks/recovery.py --plan serf-nonorthogonality --seeds 20 \
        --set parameters.shots=as_published --world serf.gyro_was_running=false

`--set` changes the plan, `--short` makes it the short form of the campaigns, `--world` changes what
the bench file says below `simulation`. With `--drawn` the errors of gain and clock of every
instrument are drawn, whose calibration record states a relative uncertainty.

One JSON line a run, then one over all: the share of errors within three standard uncertainties, the
mean square of error / uncertainty (design goals: at least 98 %, and 0.7 to 1.4), how often the 95 %
interval held the truth, and how often, over all of its range, the band of a whole curve. Results
for which the world has no one number are left out.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaigns.truths import TRUTHS, fog_curve_off
from short_forms import SHORT_FORMS

from station import registry
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.results import Result
from station.runner.execute import Request, execute
from station.units import parse_as

DRAWN = ("gain_error", "clock_error")
"""What an instrument that is off by a part of its value has in its simulator."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plan", default="rlg-magnetic-sensitivity")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--world", action="append", default=[])
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--drawn", action="store_true")
    arguments = parser.parse_args()
    short = SHORT_FORMS[arguments.plan] if arguments.short else ()
    changes = [*short, *arguments.overrides]
    plan = read_plan(find(PLANS, arguments.plan), Procedures(), changes)
    ratios: dict[str, list[float]] = {}
    inside: list[bool] = []
    curves: list[float] = []
    for seed in range(arguments.seeds):
        data = bench_data(seed, arguments.world)
        if arguments.drawn:
            draw_errors(data, seed)
        with tempfile.TemporaryDirectory() as parent:
            file = Path(parent) / "bench.yaml"
            file.write_text(yaml.safe_dump(data), encoding="utf-8")
            bench = read_bench(file, registry.names(registry.DRIVERS))
            outcome = execute(Request(plan, bench, Path(parent), quiet=True, report=False))
        if outcome.document is None:
            raise SystemExit(f"seed {seed}: {outcome.error}")
        line: dict[str, object] = {"benchmark": "recovery", "plan": arguments.plan, "seed": seed}
        errors = dict(errors_of(outcome.document.results, data, plan.procedure))
        for name, (ratio, covered) in errors.items():
            line[name] = round(ratio, 3)
            ratios.setdefault(name, []).append(ratio)
            inside.append(covered)
        off = dict(curves_of(outcome.document.results, data))
        line |= {name: round(in_band, 3) for name, in_band in off.items()}
        curves += off.values()
        line["flags"] = sorted({flag.code for flag in outcome.document.flags} - {"simulated"})
        print(json.dumps(line), flush=True)
    told = summary(arguments.plan, arguments.seeds, ratios, inside)
    if curves:
        told["whole_curves_inside"] = round(float(np.mean(np.array(curves) <= 1.0)), 4)
    print(json.dumps(told))


def bench_data(seed: int, changes: Sequence[str]) -> dict[str, Any]:
    """Return the shipped simulated bench with a seed, and its world changed."""
    data: dict[str, Any] = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))
    data["simulation"]["seed"] = seed
    for change in changes:
        path, _, value = change.partition("=")
        *above, last = path.split(".")
        place = data["simulation"]
        for key in above:
            place = place[key]
        place[last] = yaml.safe_load(value)
    return data


def draw_errors(data: dict[str, Any], seed: int) -> None:
    """Let each instrument be off as its calibration record says it may be."""
    random = np.random.default_rng((seed, 17))

    def drawn(told: Any, u: float) -> Any:
        if isinstance(told, dict):
            return {axis: drawn(one, u) for axis, one in told.items()}
        return f"{100.0 * u * random.standard_normal():.6g} %"

    for entry in data["instruments"].values():
        records = entry.get("calibration", {}).get("uncertainty", ())
        stated = [record for record in records if "relative" in record]
        truth = entry.get("simulator", {})
        for key in DRAWN:
            if stated and key in truth:
                u = parse_as(stated[0]["relative"], "1") / stated[0]["coverage_factor"]
                truth[key] = drawn(truth[key], u)


def errors_of(
    results: Sequence[Result], data: dict[str, Any], procedure: str
) -> Iterator[tuple[str, tuple[float, bool]]]:
    """Yield for each result with a truth: error over uncertainty, and whether U covers it."""
    for result in results:
        estimate, combined = result.estimate, result.combined
        true = TRUTHS[procedure](data, result.to_data())
        if true is None:
            continue
        name = f"{estimate.name} {estimate.axis or ''}".strip()
        if combined is None or estimate.value is None:
            raise SystemExit(f"{name} is undetermined")
        error = estimate.value - true
        yield (
            name,
            (error / combined.standard_uncertainty, abs(error) < combined.expanded_uncertainty),
        )


def curves_of(results: Sequence[Result], data: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield for each result with a curve how far that is from the truth, in widths of its band."""
    for result in results:
        one = result.to_data()
        if "band" in one:
            yield f"whole curve {one['axis']}", fog_curve_off(data, one)[1]


def summary(
    plan: str, seeds: int, ratios: dict[str, list[float]], inside: list[bool]
) -> dict[str, object]:
    """Return the figures over all runs, and the mean error of each result."""
    every = np.concatenate([np.array(one) for one in ratios.values()])
    return {
        "benchmark": "recovery",
        "plan": plan,
        "seeds": seeds,
        "quantities": len(every),
        "share_within_3_u": round(float(np.mean(np.abs(every) < 3)), 4),
        "mean_square_error_over_u": round(float(np.mean(every**2)), 3),
        "its_standard_error": round(float(np.std(every**2) / np.sqrt(len(every))), 3),
        "mean_error_over_u": {name: round(float(np.mean(one)), 2) for name, one in ratios.items()},
        "coverage_of_95_percent": round(float(np.mean(inside)), 4),
    }


if __name__ == "__main__":
    main()
