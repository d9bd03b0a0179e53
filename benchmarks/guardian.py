"""Kill and stop runs at random moments and say when their coils were at rest; JSON lines.

python benchmarks/guardian.py --kills 24 --stops 6 --doubles 12 --procedure 10

`station sim` serves the bench in another process; its own account of the world is the oracle. Real
seconds from the signal: `to_zero_s` until the supply drove nothing any more, `to_verified_s` until
the guardian had read it back; of that `safe_state_s` in the safe state itself (the wait for a zero
of the sine, up to half a period for each coil, the ramp, the reading back) and `before_s` until it
began (noticing, ending the process, opening the instruments). `limit_s` is the promise: 2 s after
SIGKILL or 7 s after SIGSTOP, and the slew: half a period for each coil, 0.3 s for what follows it.

The small runs drive sines at once, in real time. `--procedure` kills `station run` of the laser
gyro's plan on scaled time, anywhere from its start on; `before_s` is real time there, too.
`--doubles` ends run and first guardian together: both are killed, or the guardian is stopped and
the run killed, or the guardian killed and the run stopped; `limit_s` is then 60 s.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from campaign_helpers import only_run, short_plan
from command_line import station_command
from guardian_helpers import GuardedRun, World, start_run, until, world

NOTICED_WITHIN_S = {signal.SIGKILL: 2.0, signal.SIGSTOP: 7.0}
DOUBLE_DEATH_S = 60.0
DOUBLES = (
    (signal.SIGKILL, signal.SIGKILL),
    (signal.SIGKILL, signal.SIGSTOP),
    (signal.SIGSTOP, signal.SIGKILL),
)
"""What ends the run and what its first guardian, one pair after the other."""
SETTLES_S = 0.3
CASES = ((0.5, "x"), (0.5, "x"), (0.1, "y"), (0.5, "xyz"))
"""Frequency in Hz and the coils that are driven, one case after the other."""
PROCEDURE_SPEED, PROCEDURE_Hz, MAX_RUN_S = 20.0, 0.1, 16.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=24)
    parser.add_argument("--stops", type=int, default=6)
    parser.add_argument("--doubles", type=int, default=12)
    parser.add_argument("--procedure", type=int, default=10)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        lines = []
        ends = [signal.SIGKILL] * arguments.kills + [signal.SIGSTOP] * arguments.stops
        with world(folder) as bench:
            for seed, end in enumerate(ends):
                lines.append(small_run(bench, seed, end, folder / f"small-{seed}"))
                print(json.dumps(lines[-1]), flush=True)
            doubles = []
            for seed in range(arguments.doubles):
                end, of_guardian = DOUBLES[seed % len(DOUBLES)]
                place_of_run = folder / f"double-{seed}"
                doubles.append(small_run(bench, seed, end, place_of_run, of_guardian))
                print(json.dumps(doubles[-1]), flush=True)
            steps_A = largest_steps_A(bench)
        for end in NOTICED_WITHIN_S:
            told = [line for line in lines if line["end"] == end.name]
            if told:
                print(json.dumps({**summary(told), "largest_step_A": steps_A}), flush=True)
        if doubles:
            print(json.dumps({**summary(doubles), "end": "double"}), flush=True)
        lines = []
        for seed in range(arguments.procedure):
            lines.append(procedure(seed, folder / f"procedure-{seed}"))
            print(json.dumps(lines[-1]), flush=True)
        if lines:
            print(json.dumps(summary(lines)))


def small_run(
    bench: World,
    seed: int,
    end: signal.Signals,
    folder: Path,
    of_guardian: signal.Signals | None = None,
) -> dict[str, Any]:
    frequency_Hz, axes = CASES[seed % len(CASES)]
    coils = [f"coil_supply.{axis}" for axis in axes]
    run = start_run(bench, folder, *coils, frequency_Hz=frequency_Hz)
    time.sleep(np.random.default_rng(seed).uniform(0.0, 1.0 / frequency_Hz))
    return ended(bench, run, end, "small", seed, frequency_Hz, axes, of_guardian)


def procedure(seed: int, folder: Path) -> dict[str, Any]:
    plan = short_plan(folder / "plan", axes=["IA"])
    with world(folder, PROCEDURE_SPEED) as bench:
        process = subprocess.Popen(
            station_command(
                *("run", plan, "--served", bench.head, "--non-interactive"),
                *("--output", folder / "runs"),
            ),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        until(lambda: only_run(folder / "runs") is not None)
        run_folder = only_run(folder / "runs")
        assert run_folder is not None
        time.sleep(np.random.default_rng(1000 + seed).uniform(0.0, MAX_RUN_S))
        run = GuardedRun(process, run_folder)
        return ended(bench, run, signal.SIGKILL, "procedure", seed, PROCEDURE_Hz, "xyz")


def ended(
    bench: World,
    run: GuardedRun,
    end: signal.Signals,
    kind: str,
    seed: int,
    frequency_Hz: float,
    axes: str,
    of_guardian: signal.Signals | None = None,
) -> dict[str, Any]:
    """End a run, wait for its guardian, and tell what the world and the log say of the times."""
    before = bench.report()
    first = run.guardians[:1] if of_guardian is not None else []
    signal_s = bench.bench_s(run.end_by(end))
    for guardian in first:
        os.kill(guardian, of_guardian or end)
    run.wait_for_guardian()
    line: dict[str, Any] = {
        "benchmark": "guardian",
        "runner": kind,
        "seed": seed,
        "end": end.name,
        "of_first_guardian": of_guardian.name if of_guardian is not None else None,
        "speed": bench.speed,
        "frequency_Hz": frequency_Hz,
        "was_energised": [name for name, on in before["outputs"].items() if on],
        "current_then_A": {a: round(before["coils"][a]["current_A"], 2) for a in axes},
        "at_rest": bench.at_rest(axes),
    }
    if not (run.folder / "guardian.jsonl").is_file():
        return {**line, "guardian_acted": False, "kept": line["at_rest"]}
    last = run.made_safe()
    since_s = [bench.report()["coils"][axis]["at_zero_since_s"] for axis in axes]
    verified_s = (last["t_s"] - signal_s) / bench.speed
    safe_state_s = sum(one["took_s"] for one in last.get("outcomes", ())) / bench.speed
    driven = sum(f"coil_supply.{axis}" in line["was_energised"] for axis in axes)
    slew_s = (driven * 0.5 / frequency_Hz + SETTLES_S) / bench.speed
    limit_s = NOTICED_WITHIN_S[end] + slew_s if of_guardian is None else DOUBLE_DEATH_S
    verified = all(one["verified"] for one in last.get("outcomes", [{"verified": False}]))
    return {
        **line,
        "guardian_acted": True,
        "why": run.guardian_log()[0]["message"],
        "began_s": round((run.guardian_log()[0]["t_s"] - signal_s) / bench.speed, 4),
        "attempts": last.get("attempt"),
        "verified": verified,
        "to_zero_s": None
        if None in since_s
        else round(max((max(since_s) - signal_s) / bench.speed, 0.0), 4),
        "to_verified_s": round(verified_s, 4),
        "safe_state_s": round(safe_state_s, 4),
        "before_s": round(verified_s - safe_state_s, 4),
        "limit_s": round(limit_s, 3),
        "kept": bool(line["at_rest"] and verified and verified_s <= limit_s),
    }


def largest_steps_A(bench: World) -> dict[str, float]:
    """Return the largest step of each coil's drive against its current, over everything."""
    coils = bench.report()["coils"]
    return {
        axis: round(coil["largest_slew_A_per_s"] * coil["time_constant_s"], 3)
        for axis, coil in coils.items()
    }


def summary(lines: list[dict[str, Any]]) -> dict[str, Any]:
    acted = [line for line in lines if line["guardian_acted"]]

    def spread(key: str) -> list[float] | None:
        """Return the least, the median, the 90th percentile and the largest."""
        values = [line[key] for line in acted if line[key] is not None]
        return np.quantile(values, [0.0, 0.5, 0.9, 1.0]).round(4).tolist() if values else None

    return {
        "benchmark": "guardian",
        "summary": lines[0]["runner"],
        "end": lines[0]["end"],
        "ended": len(lines),
        "while_energised": sum(bool(line["was_energised"]) for line in lines),
        "guardian_acted": len(acted),
        "promise_broken": sum(not line["kept"] for line in lines),
        **{key: spread(key) for key in ("to_zero_s", "to_verified_s", "safe_state_s", "before_s")},
    }


if __name__ == "__main__":
    main()
