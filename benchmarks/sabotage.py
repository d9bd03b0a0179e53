"""Plant known faults in clean datasets and hold each analysis against the truth.

    python benchmarks/sabotage.py [NAME …] [--fault TEXT] [--seeds 3] [--first 0] [--clean 0]

The tables are those of the tests, `tests/support/campaigns/planted`. A dataset is written as a
folder and analysed as `station analyse` does. One JSON object a fault and seed: `error_u` is the
largest error of a result in its standard uncertainties, `worst` that result, `shown` whether the
data can show the fault and the error is above 4 u, `silent` an error above 4 u that no flag names,
`broken` one of a fault that the data can show, or a refusal in no words of ours. The last line of
each procedure counts. With `--clean N` the same datasets without a fault, seeds 1000 to 999+N:
`false` are flags that a clean dataset must not raise.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from campaigns.planted.judging import PROCEDURES, clean_runs, faults_of, judged


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="procedures; all without one")
    parser.add_argument("--procedure", nargs="+", default=[], choices=PROCEDURES)
    parser.add_argument("--fault", default="", help="only faults whose name holds this text")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--clean", type=int, default=0, help="this many datasets without a fault")
    options = parser.parse_args()
    if unknown := set(options.names) - set(PROCEDURES):
        parser.error(f"there is no procedure {', '.join(sorted(unknown))}")
    for procedure in [*options.names, *options.procedure] or PROCEDURES:
        if options.clean:
            lines = list(clean_runs(procedure, options.clean))
            for one in lines:
                if one["false"]:
                    print(json.dumps(one), flush=True)
            report = {"clean": len(lines), "false": sum(bool(one["false"]) for one in lines)}
        else:
            chosen = [one for one in faults_of(procedure) if options.fault in one.name]
            lines = []
            for fault in chosen:
                for seed in range(options.first, options.first + options.seeds):
                    lines.append({"procedure": procedure, **judged(fault, seed)})
                    print(json.dumps(lines[-1]), flush=True)
            report = {
                "faults": len(chosen),
                "planted": len(lines),
                "shown": sum(one["shown"] for one in lines),
                "silent": sum(one["silent"] for one in lines),
                "broken": sum(one["broken"] for one in lines),
            }
        print(json.dumps({"benchmark": "sabotage", "procedure": procedure, **report}), flush=True)


if __name__ == "__main__":
    main()
