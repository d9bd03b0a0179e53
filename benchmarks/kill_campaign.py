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

from campaign_helpers import compare_with_reference, finished_units, opens, station
from command_line import station_command
from guardian_helpers import until, world
from kill_helpers import (
    Kill,
    guardian_at_work,
    kill_at_random_moment,
    lost_real_s,
    unfinished_unit,
    written_bytes,
)
from resume_helpers import GOOD, SERVED, largest_u_ratio, results_of, resume_and_judge
from short_forms import SHORT_FORMS

Plan = tuple[str, ...]
"""A shipped plan's name, `--bench` and a bench's, and the options that make the plan short."""


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
        done = station("run", *plan, "--non-interactive", "--output", folder / "reference")
        assert done.returncode in GOOD, done.stderr
        reference = next((folder / "reference").iterdir())
        for seed in range(first, first + arguments.virtual):
            lines.append(on_virtual_time(seed, folder / f"virtual-{seed}", plan, reference))
            print(json.dumps(lines[-1]), flush=True)
        for seed in range(first, first + arguments.scaled):
            speed = arguments.speeds[seed % len(arguments.speeds)]
            lines.append(on_scaled_time(seed, speed, folder / f"scaled-{seed}", plan, reference))
            print(json.dumps(lines[-1]), flush=True)
    for clock in ("virtual", "scaled"):
        print(json.dumps(counts(clock, [one for one in lines if one["clock"] == clock])))


def on_virtual_time(seed: int, folder: Path, plan: Plan, reference: Path) -> dict[str, Any]:
    parent = folder / "runs"
    command = station_command("run", *plan, "--non-interactive", "--output", parent)
    expected = written_bytes(reference.parent)
    kill = kill_at_random_moment(command, parent, expected, np.random.default_rng(seed))
    line = described("virtual", seed, kill)
    if kill.folder is not None:
        try:
            left = compare_with_reference(kill.folder, reference)
            line["share_of_the_data"] = round(sum(left.raw_bytes.values()) / expected, 3)
        except AssertionError as fault:
            line["faults"].append(str(fault))
    go_on(line, kill, reference)
    shutil.rmtree(folder, ignore_errors=True)
    return line


def go_on(line: dict[str, Any], kill: Kill, reference: Path, *options: str | Path) -> None:
    """Resume what a kill left and add how that ended."""
    if kill.folder is not None:
        line["then"], wrong = resume_and_judge(kill.folder, reference, *options)
        line["faults"] += wrong
        if line["then"] in ("resumed", "evaluated"):
            line["verdict"] = results_of(kill.folder)["verdict"]
            line["largest_u_over_undisturbed"] = round(largest_u_ratio(kill.folder, reference), 1)


def on_scaled_time(
    seed: int, speed: float, folder: Path, plan: Plan, reference: Path
) -> dict[str, Any]:
    folder.mkdir()
    parent = folder / "runs"
    expected = written_bytes(reference.parent)
    bench_name = plan[2]
    procedure = json.loads((reference / "results.json").read_text(encoding="utf-8"))["procedure"]
    with world(folder, speed, bench_name, procedure) as bench:
        command = station_command(
            "run", *plan, SERVED, bench.head, "--non-interactive", "--output", parent
        )
        rng = np.random.default_rng(1000 + seed)
        kill = kill_at_random_moment(
            command, parent, round(0.9 * expected), rng, longest_delay_s=0.3
        )
        line = {**described("scaled", seed, kill), "speed": speed, "guardian": bool(kill.left)}
        until(lambda: not guardian_at_work(kill))
        line["safe"] = bench.at_rest()
        lost_s = lost_real_s(kill, bench.epoch_unix, speed)
        go_on(line, kill, reference, SERVED, bench.head)
        line["safe_after"] = bench.at_rest()
    line["faults"] += [f"not {one}" for one in ("safe", "safe_after") if not line[one]]
    if lost_s is not None:
        interval_and_batch_s = 0.2 / speed
        line["youngest_sample_real_s"] = round(lost_s, 4)
        line["lost_real_s"] = round(max(lost_s - interval_and_batch_s, 0.0), 4)
    return line


def described(clock: str, seed: int, kill: Kill) -> dict[str, Any]:
    return {
        "benchmark": "kill_campaign",
        "clock": clock,
        "seed": seed,
        "phase": kill.phase,
        "was_running": kill.was_running,
        "has_folder": kill.folder is not None,
        "finished": finished_units(kill.folder) if kill.folder else [],
        "under_way": unfinished_unit(kill.folder) if kill.folder else None,
        "faults": list(opens(kill.folder)) if kill.folder else [],
    }


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
