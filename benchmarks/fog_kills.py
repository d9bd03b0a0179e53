"""The long run over temperature, killed at random moments and gone on with; JSON lines.

python benchmarks/fog_kills.py --kills 10 [--seed 1] [--set KEY=VALUE …]

The shipped plan on virtual time, in processes of its own: each is killed with SIGKILL after a turn
that is drawn (the first of them at the end of the soak), the next goes on by `station resume`, the
last one to the end. A line for each kill: the hour of bench time, and how far the gyros were, at
the first turn after it, from where they had been at the last one before. The last line: at how many
kills a raw file was not left as it was, and for each axis the largest distance of the curve from
the world's truth over its range, in ppm and in half widths of the band of the whole curve there.
`--kills 0` gives that of an undisturbed run.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from campaign_helpers import only_run
from command_line import station_command
from fault_truths import fog_curve_off
from resume_helpers import raw_hashes

from station.record.folder import RunFolder

PLAN = "fog-scale-factor-temperature"
TURNS = 684
LOOKS_EVERY_S = 0.02


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    arguments = parser.parse_args()
    drawn = np.sort(np.random.default_rng(arguments.seed).integers(1, TURNS, arguments.kills))
    drawn[:1] = 0
    options = [part for one in arguments.overrides for part in ("--set", one)]
    with tempfile.TemporaryDirectory() as place:
        parent, changed = Path(place), 0
        command = station_command("run", PLAN, "--non-interactive", "--output", parent, *options)
        before: dict[str, str] = {}
        for turns in drawn.tolist():
            if not kill_after(turns, command, parent):
                break
            command = station_command("resume", folder_in(parent))
            after = raw_hashes(folder_in(parent))
            changed += not before.items() <= after.items()
            before = after
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        folder = folder_in(parent)
        changed += not before.items() <= raw_hashes(folder).items()
        for line in gaps(folder):
            print(json.dumps(line))
        print(json.dumps({"exit_code": done.returncode, "changed": changed, **distances(folder)}))


def folder_in(parent: Path) -> Path:
    """Return the folder of the one run."""
    folder = only_run(parent)
    assert folder is not None
    return folder


def kill_after(turns: int, command: list[str], parent: Path) -> bool:
    """Start a process of the run and kill it after so many turns; False where it ended before.

    With none, when the device has been switched on, at the end of the soak.
    """
    told = '"unit-finished"' if turns else '"dut-power-on"'
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while process.poll() is None:
        folder = only_run(parent) if parent.is_dir() else None
        if folder is not None:
            log = (folder / "events.jsonl").read_text(encoding="utf-8")
            if log.count(told) >= max(turns, 1):
                process.kill()
                process.wait()
                return True
        time.sleep(LOOKS_EVERY_S)
    return False


def gaps(folder: Path) -> list[dict[str, Any]]:
    """Return, for each kill, the hour and how far from their old temperature the gyros went on."""
    found: list[dict[str, Any]] = []
    gyro_degC, killed_s = None, 0.0
    for event in RunFolder(folder).events:
        if event.kind == "resumed":
            found.append({"killed_at_h": round(killed_s / 3600.0, 2)})
        stands = event.details.get("stands")
        if stands is not None:
            if found and gyro_degC is not None:
                found[-1].setdefault("gyros_K", round(stands["gyro_degC"] - gyro_degC, 2))
            gyro_degC = stands["gyro_degC"]
        killed_s = event.time_s
    return [{"benchmark": "fog_kills", **one} for one in found]


def distances(folder: Path) -> dict[str, Any]:
    """Return how far the curves are from the truth of the simulated gyros."""
    bench = yaml.safe_load((folder / "bench.yaml").read_text(encoding="utf-8"))
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]
    found: dict[str, Any] = {}
    for one in results:
        if one["name"] == "scale_factor_error":
            off_ppm, in_band = fog_curve_off(bench, one)
            found[one["axis"]] = {
                "largest_ppm": round(off_ppm, 3),
                "largest_in_band": round(in_band, 2),
            }
    return {"segments": len(list((folder / "raw").glob("navigator-*"))), "axes": found}


if __name__ == "__main__":
    main()
