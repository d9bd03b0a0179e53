"""Kill runs at random moments, look at what they left, and resume it; a JSON line a kill.

python benchmarks/kill_campaign.py --virtual 100 --scaled 20 [--plan NAME] [--bench NAME]

The shipped plan NAME (that of the laser gyro unless given) is killed in its short form, that of the
fault campaign. On virtual time each remainder is held byte by byte against the same run
undisturbed. On scaled time `station sim` serves the bench in another process, the run's guardian
makes it safe, and the simulated world is asked whether it is; `lost_real_s` is how old the youngest
recorded sample of a laser gyro was at the kill, less one sample interval and the board's batch of
0.1 s of bench time. What the operating system had is there: a kill of the process, not of the
machine. Every remainder is resumed by `station resume`; it must end with results within three
combined uncertainties of the undisturbed run's and as near the truth as their u says, and
every raw file of before as it was. The verdict must be the undisturbed run's. On scaled time alone
a result may be undecided instead, where its U is larger: `largest_u_over_undisturbed`, for instants
are as many times less sure as time is faster. The last lines are counts.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaign_helpers import station
from campaigns.kills import GOOD, cases, judge
from short_forms import SHORT_FORMS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plan", default="rlg-magnetic-sensitivity", help="a shipped plan")
    parser.add_argument("--bench", default="sim", help="a simulated bench, such as sim-alternate")
    parser.add_argument("--virtual", type=int, default=100)
    parser.add_argument("--scaled", type=int, default=20)
    parser.add_argument("--speeds", type=float, nargs="+", default=[20.0, 50.0, 100.0])
    parser.add_argument("--first-seed", type=int, default=0, help="to do it in pieces")
    arguments = parser.parse_args()
    lines = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        # What trips here is acknowledged with the folder, and is no matter of the user's own bench.
        os.environ["XDG_STATE_HOME"] = str(folder / "state")
        changes = [part for one in SHORT_FORMS.get(arguments.plan, ()) for part in ("--set", one)]
        plan = (arguments.plan, "--bench", arguments.bench, *changes)
        first = arguments.first_seed
        seeds = range(first, first + arguments.virtual), range(first, first + arguments.scaled)
        done = station("run", *plan, "--non-interactive", "--output", folder / "reference")
        assert done.returncode in GOOD, done.stderr
        reference = next((folder / "reference").iterdir())
        for case in cases(plan, reference, arguments.bench, seeds, arguments.speeds):
            lines.append(judge(case, folder / "killed"))
            print(json.dumps(lines[-1]), flush=True)
            shutil.rmtree(folder / "killed", ignore_errors=True)
    for clock in ("virtual", "scaled"):
        print(json.dumps(counts(clock, [one for one in lines if one["clock"] == clock])))


def counts(clock: str, lines: list[dict[str, Any]]) -> dict[str, Any]:
    lost = [line["lost_real_s"] for line in lines if "lost_real_s" in line]
    return {
        "benchmark": "kill_campaign",
        "clock": clock,
        "kills": len(lines),
        "while_it_ran": sum(line["was_running"] for line in lines),
        "folders": sum(line["has_folder"] for line in lines),
        "then": dict(Counter(line["then"] for line in lines if "then" in line)),
        "verdicts": dict(Counter(line["verdict"] for line in lines if "verdict" in line)),
        "phases": dict(Counter(line["phase"] for line in lines)),
        "units_finished": sum(len(line["finished"]) for line in lines),
        "killed_within_a_unit": sum(line["under_way"] is not None for line in lines),
        "with_faults": sum(bool(line["faults"]) for line in lines),
        "largest_lost_real_s": max(lost, default=None),
        "median_lost_real_s": round(float(np.median(lost)), 4) if lost else None,
    }


if __name__ == "__main__":
    main()
