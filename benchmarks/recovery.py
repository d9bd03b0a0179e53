"""How well the shipped plan recovers the truth of the simulated bench, over many seeds.

    python benchmarks/recovery.py --seeds 40

One JSON line a run, then one over all: the share of errors within three standard uncertainties,
the mean square of error / uncertainty (design goals: at least 98 %, and 0.7 to 1.4), and how often
the 95 % interval held the truth.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from station import registry
from station.bench import bench_of
from station.lookup import BENCHES, PLANS, find
from station.plan import read_plan
from station.runner.execute import Request, execute
from station.units import parse_as
from station.yaml.reading import read_yaml_text

PROCEDURE = "rlg-magnetic-sensitivity"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    arguments = parser.parse_args()
    plan = read_plan(find(PLANS, PROCEDURE), registry.Procedures())
    path = find(BENCHES, "sim")
    text = path.read_text(encoding="utf-8")
    errors, covered = [], []
    for seed in range(arguments.seeds):
        document = read_yaml_text(text.replace("\n  seed: 1\n", f"\n  seed: {seed}\n"), path)
        bench = bench_of(document, registry.names(registry.DRIVERS))
        truth = document.data["simulation"]["gyro"]["magnetic_sensitivity"]
        with tempfile.TemporaryDirectory() as parent:
            outcome = execute(Request(plan, bench, Path(parent), quiet=True, report=False))
        if outcome.document is None:
            raise SystemExit(f"seed {seed}: {outcome.error}")
        line: dict[str, object] = {"benchmark": "recovery", "seed": seed}
        for result in outcome.document.results:
            axis, combined = result.estimate.axis, result.combined
            if axis is None or combined is None or result.estimate.value is None:
                raise SystemExit(f"seed {seed}: {axis} undetermined")
            error = result.estimate.value - parse_as(truth[axis], "deg/h/mT")
            errors.append(error / combined.standard_uncertainty)
            covered.append(abs(error) < combined.expanded_uncertainty)
            line[axis] = round(errors[-1], 3)
        line["flags"] = sorted({flag.code for flag in outcome.document.flags} - {"simulated"})
        print(json.dumps(line), flush=True)
    ratios = np.array(errors)
    summary = {
        "benchmark": "recovery",
        "seeds": arguments.seeds,
        "quantities": len(ratios),
        "share_within_3_u": round(float(np.mean(np.abs(ratios) < 3)), 4),
        "mean_square_error_over_u": round(float(np.mean(ratios**2)), 3),
        "its_standard_error": round(float(np.std(ratios**2) / np.sqrt(len(ratios))), 3),
        "mean_error_over_u": round(float(np.mean(ratios)), 3),
        "coverage_of_95_percent": round(float(np.mean(covered)), 4),
    }
    print(json.dumps(summary))


if __name__ == "__main__":
    main()
