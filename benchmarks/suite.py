"""How long the tests take, with every process that they start, and what they leave: JSON lines.

python benchmarks/suite.py [quick] [campaign] [--repeat N]

Each tier is run as the README says. `processor_s` is that of all its processes, orphans too, by a
control group where one can be made, else of all that ended before it; `loop_s` is the processor
time of a fixed loop before and after, by which machines compare. What it left is counted two
seconds after its end: processes, mounts and files in the shared folders that were not there
before, and by how much less memory is available.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from killed_session import seen
from places import ROOT

TIERS: dict[str, list[str]] = {"quick": [], "campaign": ["-m", "campaign"]}
LOOPS = 40_000_000
GROUPS = {Path("/sys/fs/cgroup/cpuacct"): "cpuacct.usage", Path("/sys/fs/cgroup"): "cpu.stat"}
"""Where control groups are made, and the file that says what one has used."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("tier", nargs="*", help=f"of {', '.join(TIERS)}; all if none")
    parser.add_argument("--repeat", type=int, default=1, help="how often, one after the other")
    arguments = parser.parse_args()
    for _ in range(arguments.repeat):
        for tier in arguments.tier or TIERS:
            print(json.dumps(measured(tier)), flush=True)


def measured(tier: str) -> dict[str, object]:
    """Run a tier, and return what it took and what it left."""
    command = [sys.executable, "-m", "pytest", "-n", "3", "--dist", "worksteal", *TIERS[tier]]
    before, free_bytes, loops_s = seen(), available_bytes(), [fixed_loop_s()]
    group = own_group()
    began_s, used_s = time.monotonic(), processor_s(group)
    done = subprocess.run(
        ["sh", "-c", f'echo $$ > {group / "cgroup.procs"}; exec "$@"', "sh", *command]
        if group
        else command,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        check=False,
        text=True,
        encoding="utf-8",
    )
    wall_s, used_s = time.monotonic() - began_s, processor_s(group) - used_s
    time.sleep(2.0)
    after = seen()
    loops_s.append(fixed_loop_s())
    last = next((line for line in reversed(done.stdout.splitlines()) if " in " in line), "")
    return {
        "tier": tier,
        "exit_code": done.returncode,
        **{
            word: int(number) for number, word in re.findall(r"(\d+) (passed|failed|skipped)", last)
        },
        "wall_s": round(wall_s, 1),
        "processor_s": round(used_s, 1),
        "loop_s": loops_s,
        "left": {what: len(after[what] - before[what]) for what in before},
        "memory_MB": round((free_bytes - available_bytes()) / 1e6),
    }


def own_group() -> Path | None:
    """Make a control group and return it, None where none can be made."""
    for parent, usage in GROUPS.items():
        group = parent / f"tests-{os.getpid()}"
        try:
            group.mkdir(exist_ok=True)
        except OSError:
            continue
        if (group / usage).is_file():
            return group
    return None


def processor_s(group: Path | None) -> float:
    """Return the processor time that a group has used, or the processes that have ended."""
    if group is None:
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
        return ended.ru_utime + ended.ru_stime
    text = (group / GROUPS[group.parent]).read_text(encoding="ascii")
    if found := re.search(r"usage_usec (\d+)", text):
        return int(found[1]) / 1e6
    return int(text) / 1e9


def available_bytes() -> int:
    """Return the memory that processes could still have."""
    text = Path("/proc/meminfo").read_text(encoding="ascii")
    return int(re.findall(r"MemAvailable:\s+(\d+) kB", text)[0]) * 1024


def fixed_loop_s() -> float:
    """Return the processor time of a loop that is always the same."""
    began_s, total = time.process_time(), 0
    for number in range(LOOPS):
        total += number * number % 7
    return round(time.process_time() - began_s, 2)


if __name__ == "__main__":
    main()
