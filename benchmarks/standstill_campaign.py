"""Attack runs as an operating system can, in every step of every plan; a JSON line an attack.

python benchmarks/standstill_campaign.py [--plan NAME …] [--case PATTERN …] [--part 1/40]
python benchmarks/standstill_campaign.py --once

`station sim` serves the bench in one process, `station run --served` is another, and its guardian
stands beside it. One of them, or what it stands on, is struck at a drawn moment of a step: the disk
of the run folder stands still (so that a writer cannot even be killed), is taken away or
moved; the terminal stands still, and somebody then wishes the run to end; the run, its guardian or
both are stopped or killed; there is no memory left (`prlimit`); an instrument cannot be reached for
20 s or 120 s just when the bench is to be made safe. The simulated world, the exit code, the words,
the folder and the system's list of processes say what followed. A disk of its own needs FUSE.

Real seconds from the attack: `to_rest_s` until the world was at rest and stayed so, `to_end_s`
until no process of the run lived any more, `to_guardian_s` until there was another guardian. What
is left is opened, analysed and resumed (`--no-resume` leaves that out). `broken` are the
promises that were not kept. A run that a busy computer ends, because a simulated instrument did not
answer in time, is counted apart. The cases are shuffled, the same way always: any part is a sample.
The last line of each attack holds its tries, the broken ones and the largest times.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaigns.faults import plans, steps
from campaigns.standstill.cases import ATTACKS, Case
from campaigns.standstill.oracle import Observed, attack
from user_space_disk import why_not

SHUFFLED_BY = 15
MAX_WORDS = 400


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("--plan", nargs="+", help="these plans; all if none")
    parser.add_argument("--case", nargs="+", default=[], help="attacks, as patterns")
    parser.add_argument("--step", nargs="+", help="these steps; all if none")
    parser.add_argument("--part", default="1/1", help="which part of the cases, such as 2/40")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="moments of each step")
    parser.add_argument("--once", action="store_true", help="each once a plan, steps in turn")
    parser.add_argument("--speed", type=float, help="times faster than real; per plan if none")
    parser.add_argument("--no-resume", action="store_true", help="do not resume what is left")
    arguments = parser.parse_args()
    part, parts = map(int, arguments.part.split("/"))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended; disks and processes are put away"))
    lines = []
    with tempfile.TemporaryDirectory() as place:
        for number, case in enumerate(cases(arguments)):
            if number % parts != part - 1:
                continue
            folder = Path(place) / f"case-{number}"
            seen = attack(case, folder, speed=arguments.speed, resume=not arguments.no_resume)
            lines.append(line_of(seen))
            print(json.dumps(lines[-1], ensure_ascii=False), flush=True)
            shutil.rmtree(folder, ignore_errors=True)
    for name in dict.fromkeys(line["case"] for line in lines):
        print(json.dumps(summary(name, [line for line in lines if line["case"] == name])))
    print(json.dumps(summary("all", lines)))


def cases(arguments: argparse.Namespace) -> list[Case]:
    """Return the cases that are asked for, shuffled."""
    wanted = [
        one
        for name, one in ATTACKS.items()
        if not arguments.case or any(re.search(text, name) for text in arguments.case)
    ]
    if (reason := why_not()) is not None:
        print(f"without attacks on disks: {reason}", file=sys.stderr)
        wanted = [one for one in wanted if not one.disk]
    found = [
        Case(plan, one, step, seed)
        for seed in arguments.seeds
        for plan in arguments.plan or plans()
        for number, step in enumerate(steps(plan))
        if not arguments.step or step in arguments.step
        for turn, one in enumerate(wanted)
        if not arguments.once or turn % len(steps(plan)) == number
    ]
    order = np.random.default_rng(SHUFFLED_BY).permutation(len(found))
    return [found[place] for place in order]


def line_of(seen: Observed) -> dict[str, Any]:
    case = seen.case
    return {
        "benchmark": "standstill_campaign",
        "case": case.attack.name,
        "plan": case.plan,
        "step": case.step,
        "seed": case.seed,
        "speed": seen.speed,
        "struck": seen.struck,
        "energised": seen.energised,
        "to_rest_s": None if case.attack.within_s is None else seen.to_rest_s,
        "to_end_s": seen.to_end_s,
        "to_guardian_s": seen.to_guardian_s,
        "exit_code": seen.exit_code,
        "followed": seen.followed,
        "broken": seen.broken,
        **({"busy": seen.busy} if seen.busy else {}),
        **({"words": seen.words[-MAX_WORDS:]} if seen.broken or not seen.struck else {}),
    }


def summary(name: str, lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the tries, how many of them broke a promise, and the largest times."""
    struck = [line for line in lines if line["struck"]]

    def largest(key: str, of: list[dict[str, Any]]) -> float | None:
        return max((line[key] for line in of if line[key] is not None), default=None)

    hot = [line for line in struck if line["energised"]]
    return {
        "benchmark": "standstill_campaign",
        "summary": name,
        "tries": len(lines),
        "struck": len(struck),
        "while_energised": len(hot),
        "broken": sum(bool(line["broken"]) for line in lines),
        "ended_by_a_busy_computer": sum("busy" in line for line in lines),
        "largest_to_rest_s": largest("to_rest_s", hot),
        "largest_to_end_s": largest("to_end_s", struck),
        "largest_to_guardian_s": largest("to_guardian_s", struck),
    }


if __name__ == "__main__":
    main()
