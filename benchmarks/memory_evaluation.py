"""How much memory the evaluation of a long record takes; one JSON line a case and a kind of work.

python benchmarks/memory_evaluation.py --hours 72 --sample-interval 0.1 --excitation simultaneous

The run folder is written as a run writes it, block by block, by a made-up laser gyro (with spikes
and lost samples); then `station analyse` and `station export` work on it, each in a process of its
own whose largest resident set is measured, beside what `validate` foresaw of the plan.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from procedures.rlg_magnetic_sensitivity.records import PlannedRecord, sensitivity_records
from station import registry
from station.bench import Bench, read_bench
from station.clock import VirtualClock
from station.lookup import BENCHES, PLANS, find
from station.plan import Plan, read_plan
from station.record.folder import RunRecord
from station.runner.execute import head_of

GYRO, GAUSSMETER = "gyro_acquisition", "gaussmeter"
LOOK_S = 1.037
FIELD_S = 0.1
SENSITIVITY = {"IA": 0.05, "NA": -0.02, "LA": 0.001}
AMBIENT_T = np.array([0.021e-3, -0.004e-3, -0.043e-3])
WALK_DEG_PER_SQRT_H = 1e-3
EARTH_DEG_PER_H = 9.6
SPIKES = 1e-5
COLUMNS = {
    GYRO: {"sequence": "1", "counts": "1", "temperature_degC": "degC"},
    GAUSSMETER: {"instrument_time_s": "s", "x_T": "T", "y_T": "T", "z_T": "T", "state": "1"},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--sample-interval", type=float, default=0.1)
    parser.add_argument("--axes", default="IA,NA,LA")
    parser.add_argument("--frequency", type=float, default=0.1)
    parser.add_argument("--excitation", default="sequential")
    parser.add_argument("--formats", default="hdf5", help="of `station export`, with commas")
    parser.add_argument("--keep", type=Path, help="a folder in which the run folder is left")
    arguments = parser.parse_args()
    simultaneous = arguments.excitation == "simultaneous"
    frequency = "null" if simultaneous else f"{arguments.frequency} Hz"
    settings = [
        f"parameters.sample_interval={arguments.sample_interval} s",
        f"parameters.duration={arguments.hours} h",
        f"parameters.axes=[{arguments.axes}]",
        f"parameters.excitation={arguments.excitation}",
        f"parameters.frequency={frequency}",
    ]
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    with tempfile.TemporaryDirectory() as parent:
        plan = read_plan(find(PLANS, "rlg-magnetic-sensitivity"), registry.Procedures(), settings)
        began = time.perf_counter()
        folder = made_run(arguments.keep or Path(parent), plan, bench)
        case = {
            "benchmark": "memory_evaluation",
            "hours": arguments.hours,
            "sample_interval_s": arguments.sample_interval,
            "excitation": arguments.excitation,
            "axes": arguments.axes,
            "raw_MB": sum(file.stat().st_size for file in folder.rglob("*.mcap")) // 1_000_000,
        }
        print(f"{folder} made in {time.perf_counter() - began:.0f} s", file=sys.stderr)
        work = [("analyse", folder)]
        work += [("export", folder, "--format", one) for one in arguments.formats.split(",") if one]
        for verb in work:
            print(json.dumps({**case, **measured(verb)}), flush=True)


def measured(verb: Any) -> dict[str, Any]:
    """Return the largest resident set and the time of a command of the station."""
    began = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-m", "station", *map(str, verb)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stderr is not None
    said = child.stderr.read()
    _, status, usage = os.wait4(child.pid, 0)
    return {
        "work": " ".join(str(one) for one in verb if not isinstance(one, Path)),
        "exit": os.waitstatus_to_exitcode(status),
        "peak_MB": round(usage.ru_maxrss / 1000),
        "wall_s": round(time.perf_counter() - began, 1),
        "said": said.splitlines()[-1:],
    }


def made_run(parent: Path, plan: Plan, bench: Bench) -> Path:
    """Write a run folder with every record of the plan, and return it."""
    record = RunRecord(
        parent, plan.procedure, "SN-1", VirtualClock(), head_of(plan, bench, VirtualClock())
    )
    for name in (GYRO, GAUSSMETER):
        record.event("identified", instrument=name, maker="", model="", serial="", firmware="")
    began_s = 700.0
    for number, planned in enumerate(sensitivity_records(plan.parameters)):
        made_record(record, plan.parameters, planned, began_s, number)
        record.finish_unit(
            planned.unit,
            drive={axis: vars(sine) for axis, sine in planned.drive.items()},
            field_averaging_s=FIELD_S,
            field_timestamp="interval-end",
            samples=planned.samples,
        )
        began_s += planned.samples * plan.parameters.sample_interval_s + 60.0
    record.event("safe-state", outcomes=[])
    record.close()
    record.seal()
    return record.path


def made_record(
    record: RunRecord, parameters: Any, planned: PlannedRecord, began_s: float, seed: int
) -> None:
    """Write the rows of one record, a block at each look."""
    generator = np.random.default_rng([seed, 15])
    interval_s, weight = parameters.sample_interval_s, parameters.pulse_weight_arcsec
    end_s = began_s + planned.samples * interval_s
    angle = 0.0
    first, first_field, now_s = 0, 0, began_s
    while now_s < end_s + 2 * LOOK_S:
        now_s += LOOK_S
        last = int((now_s - began_s) / interval_s)
        time_s = began_s + (np.arange(first, last) + 0.5) * interval_s
        field_mT = field_T(planned, time_s, began_s) * 1e3
        rate = EARTH_DEG_PER_H + sum(
            field_mT[:, k] * SENSITIVITY[axis] for k, axis in enumerate(SENSITIVITY)
        )
        rate = rate + 60 * WALK_DEG_PER_SQRT_H / np.sqrt(interval_s) * generator.standard_normal(
            len(rate)
        )
        angles = angle + np.cumsum(rate * interval_s)
        angle = float(angles[-1])
        counts = np.floor(angles / weight).astype(np.int64)
        for place in np.flatnonzero(generator.random(len(rate)) < SPIKES):
            counts[place:] += 500
            angle += 500 * weight
        rows = np.empty(
            last - first,
            [
                ("sequence", "u2"),
                ("counts", "i8"),
                ("temperature_degC", "f8"),
                ("arrival_time_s", "f8"),
            ],
        )
        rows["sequence"] = np.arange(first + 1, last + 1) % 65536
        rows["counts"] = counts
        rows["temperature_degC"] = 25.0
        rows["arrival_time_s"] = np.minimum(
            time_s + 0.5 * interval_s + 0.002 + 0.004 * generator.random(len(rows)), now_s
        )
        keep = generator.random(len(rows)) > SPIKES
        record.block(GYRO, planned.unit, COLUMNS[GYRO], rows[keep])
        first = last
        last_field = int((now_s - began_s) / FIELD_S)
        stamp_s = began_s + np.arange(first_field + 1, last_field + 1) * FIELD_S
        measured_T = field_T(planned, stamp_s - 0.5 * FIELD_S, began_s, FIELD_S)
        measured_T += 4e-7 * generator.standard_normal(measured_T.shape)
        rows = np.empty(
            len(stamp_s), [(name, "f8") for name in (*COLUMNS[GAUSSMETER], "arrival_time_s")]
        )
        rows["instrument_time_s"] = stamp_s * (1 + 12e-6) + 0.37
        rows["x_T"], rows["y_T"], rows["z_T"] = measured_T.T
        rows["state"] = 0.0
        rows["arrival_time_s"] = now_s + 0.002
        if len(rows):
            record.block(GAUSSMETER, planned.unit, COLUMNS[GAUSSMETER], rows)
        first_field = last_field


def field_T(planned: PlannedRecord, time_s: Any, began_s: float, averaging_s: float = 0.0) -> Any:
    """Return the field on IA, NA, LA, shape (n, 3)."""
    field = np.tile(AMBIENT_T, (len(time_s), 1))
    for k, axis in enumerate(SENSITIVITY):
        if axis in planned.drive:
            sine = planned.drive[axis]
            wave = np.sin(2 * np.pi * sine.frequency_Hz * (time_s - began_s))
            field[:, k] += (
                1e-3 * sine.amplitude_mT * np.sinc(sine.frequency_Hz * averaging_s) * wave
            )
    return field


if __name__ == "__main__":
    main()
