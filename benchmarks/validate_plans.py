"""How long `station validate` takes for many plans, alone and each with a base; one JSON line each.

python benchmarks/validate_plans.py --plans 100

`command_s` is the wall time of the command as a person gives it, interpreter and imports included;
`validate_s` the part of it that grows with the plans, measured in this process.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from station.cli.validating import validate_plans
from station.files.lookup import PLANS, find

VARIANT = """\
extends: {base}
vars: {{drive: 0.2 Hz}}
dut: {{serial: SN-{number:04d}}}
parameters: {{frequency: "${{drive}}", axes: [IA]}}
"""


def write_plans(folder: Path, plan: str, count: int, *, extending: bool) -> list[str]:
    """Write plans that differ in the serial number, and return their paths."""
    text = find(PLANS, plan).read_text(encoding="utf-8")
    paths = [folder / f"plan-{number:04d}.yaml" for number in range(count)]
    for number, path in enumerate(paths):
        own = text.replace("SN-0042", f"SN-{number:04d}")
        own = VARIANT.format(base=plan, number=number) if extending else own
        path.write_text(own, encoding="utf-8")
    return [str(path) for path in paths]


def measure(plan: str, bench: str, count: int, *, extending: bool) -> dict[str, object]:
    """Return the times of one kind of plan."""
    with tempfile.TemporaryDirectory() as folder:
        paths = write_plans(Path(folder), plan, count, extending=extending)
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "station", "validate", *paths, "--bench", bench],
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        command_s = time.perf_counter() - began
        with contextlib.redirect_stdout(io.StringIO()):
            validate_plans(paths[:1], bench)
            began = time.perf_counter()
            exit_code = validate_plans(paths, bench)
        validate_s = time.perf_counter() - began
    return {
        "benchmark": "validate_plans",
        "kind": "extending" if extending else "alone",
        "plans": count,
        "exit_codes": [done.returncode, exit_code],
        "command_s": round(command_s, 3),
        "validate_s": round(validate_s, 3),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plan", default="rlg-magnetic-sensitivity")
    parser.add_argument("--bench", default="sim")
    parser.add_argument("--plans", type=int, default=100)
    arguments = parser.parse_args()
    for extending in (False, True):
        line = measure(arguments.plan, arguments.bench, arguments.plans, extending=extending)
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
