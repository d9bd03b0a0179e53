"""The long run over temperature, killed at random moments and resumed; JSON lines.

    python benchmarks/fog_kills.py --kills 10 [--seeds 1 2 3] [--set KEY=VALUE …]

The shipped plan on virtual time, in processes of its own, once undisturbed and once killed, on a
simulated bench of each seed, from which the kills are drawn too. Each process is killed with
SIGKILL after a turn (the first of them at the end of the soak), the next goes on by `station
resume`, the last one to the end. A line for each kill: the hour of bench time, and how far the
gyros were, at the first turn after it, from where they had been at the last one before. A line for
each seed: at how many kills a raw file was not left as it was, how many turns were made, and how
far the curves are over their range, at most, in half widths of the band of the whole curve:
undisturbed and killed from the world's truth, and from each other in half widths of both together.
The last line: how many curves there were, and how many were farther off than one.
`--kills 0` leaves out the killed runs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.interpolate import CubicSpline

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaign_helpers import only_run
from campaigns.kills import raw_hashes
from campaigns.truths import fog_curve_off
from command_line import station_command
from plan_runs import shipped_bench

from station.record.folder import RunFolder

PLAN = "fog-scale-factor-temperature"
TURNS = 684
LOOKS_EVERY_S = 0.02
UNDISTURBED, KILLED, APART = "undisturbed", "killed", "from each other"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    arguments = parser.parse_args()
    options = [part for one in arguments.overrides for part in ("--set", one)]
    found: dict[str, list[float]] = {}
    for seed in arguments.seeds:
        for kind, in_band in world(seed, arguments.kills, options):
            found.setdefault(kind, []).extend(in_band.values())
    outside = {kind: sum(one > 1.0 for one in all_of) for kind, all_of in found.items()}
    curves = max(map(len, found.values()))
    print(json.dumps({"benchmark": "fog_kills", "curves": curves, "outside": outside}))


def world(seed: int, kills: int, options: list[str]) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield how far the curves of a bench with a seed are from the truth, and from each other."""
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "bench.yaml"
        data = shipped_bench()
        data["simulation"]["seed"] = seed
        file.write_text(yaml.safe_dump(data), encoding="utf-8")
        told: dict[str, Any] = {"benchmark": "fog_kills", "seed": seed}
        folders = {}
        for kind, count in ((UNDISTURBED, 0), (KILLED, kills))[: 1 + bool(kills)]:
            parent = Path(place) / kind
            command = station_command("run", PLAN, "--bench", file, "--non-interactive")
            told[kind] = run(seed, count, [*command, "--output", str(parent), *options], parent)
            folders[kind] = folder_in(parent)
            off = from_truth(folders[kind])
            told[kind] |= {"ppm": {axis: round(ppm, 2) for axis, (ppm, _) in off.items()}}
            told[kind] |= {"in_band": {axis: round(part, 2) for axis, (_, part) in off.items()}}
            yield kind, told[kind]["in_band"]
        if kills:
            told[APART] = from_each_other(*folders.values())
            yield APART, told[APART]
        print(json.dumps(told), flush=True)


def run(seed: int, kills: int, command: list[str], parent: Path) -> dict[str, Any]:
    """Run to the end over some kills."""
    drawn = np.sort(np.random.default_rng(seed).integers(1, TURNS, kills))
    drawn[:1] = 0
    before: dict[str, str] = {}
    changed, ended = 0, None
    for turns in drawn.tolist():
        ended = killed_after(turns, command, parent)
        after = raw_hashes(folder_in(parent))
        changed += not before.items() <= after.items()
        before, command = after, station_command("resume", folder_in(parent))
        if ended is not None:
            break
    if ended is None:
        ended = subprocess.run(command, capture_output=True, check=False).returncode
    folder = folder_in(parent)
    changed += not before.items() <= raw_hashes(folder).items()
    for line in gaps(folder):
        print(json.dumps(line), flush=True)
    units = [name.split(" ")[0] for name in RunFolder(folder).finished_units()]
    turns = {name: units.count(name) for name in ("ramp", "proof")}
    return {"exit_code": ended, "changed": changed, "turns": turns}


def folder_in(parent: Path) -> Path:
    """Return the folder of the one run."""
    folder = only_run(parent)
    assert folder is not None
    return folder


def killed_after(turns: int, command: list[str], parent: Path) -> int | None:
    """Start a process of the run and kill it after so many turns; its exit code where it ended.

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
                return None
        time.sleep(LOOKS_EVERY_S)
    return process.returncode


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


def curves_of(folder: Path) -> dict[str, Any]:
    """Return the curves in the results of a run by axis."""
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]
    return {one["axis"]: one for one in results if one["name"] == "scale_factor_error"}


def from_truth(folder: Path) -> dict[str, tuple[float, float]]:
    """Return how far each curve is from that of the simulated gyro, in ppm and half widths."""
    bench = yaml.safe_load((folder / "bench.yaml").read_text(encoding="utf-8"))
    curves = curves_of(folder)
    return {axis: fog_curve_off(bench, one) for axis, one in curves.items()}


def from_each_other(one: Path, other: Path) -> dict[str, float]:
    """Return how far the curves of two runs are from each other where both were measured."""
    found = {}
    for axis, first in curves_of(one).items():
        bands = [first["band"], curves_of(other)[axis]["band"]]
        heats = [np.array(band["temperature_degC"]) for band in bands]
        low, high = max(heat[0] for heat in heats), min(heat[-1] for heat in heats)
        grid = np.linspace(low, high, len(heats[0]))
        values, wide = (
            [CubicSpline(heat, band[key])(grid) for heat, band in zip(heats, bands, strict=True)]
            for key in ("value", "whole_curve_uncertainty")
        )
        off = np.abs(values[0] - values[1]) / np.hypot(*wide)
        found[axis] = round(float(off.max()), 2)
    return found


if __name__ == "__main__":
    main()
