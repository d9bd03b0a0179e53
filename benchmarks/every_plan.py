"""Each shipped plan on each shipped bench, as a technician runs it; one JSON line each.

python benchmarks/every_plan.py --folder runs-of-every-plan

`wall_s` is that of the whole program, report included. What a bench refuses has `refused`, the
sentences why. What is in the folder already is not run again.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from figures import ROOT, Figures

from station.record.folder import RunFolder

REFUSED = 2
PLACE = re.compile(r"^\S+: (?:\S+: )?")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=None, help="where the runs go, and stay")
    parser.add_argument("--plan", action="append", default=[])
    parser.add_argument("--bench", action="append", default=[])
    figures = Figures(parser)
    arguments = figures.parse()
    folder = arguments.folder or Path(tempfile.mkdtemp())
    folder.mkdir(exist_ok=True)
    for bench in arguments.bench or shipped("benches"):
        for plan in arguments.plan or shipped("plans"):
            kept = folder / f"{plan}.{bench}.json"
            if not kept.is_file():
                kept.write_text(json.dumps(measured(plan, bench, folder)), encoding="utf-8")
            figures.line(f"{plan} on {bench}", **json.loads(kept.read_text(encoding="utf-8")))


def shipped(kind: str) -> list[str]:
    """Return the names of the plans or benches that come with the station."""
    return sorted(path.stem for path in (ROOT / "config" / kind).glob("*.yaml"))


def measured(plan: str, bench: str, folder: Path) -> dict[str, Any]:
    """Run a plan on a bench, and return what came of it."""
    output = folder / f"{plan}.{bench}"
    words = ["run", plan, "--bench", bench, "--non-interactive", "--output", str(output)]
    began_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "station", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    line: dict[str, Any] = {"exit_code": done.returncode}
    if done.returncode == REFUSED:
        return line | {"refused": [PLACE.sub("", text) for text in done.stderr.splitlines()]}
    line["wall_s"] = round(time.monotonic() - began_s, 1)
    (run,) = output.glob("[!.]*")
    results = run / "results.json"
    if results.is_file():
        line["verdict"] = json.loads(results.read_text(encoding="utf-8"))["verdict"]
    line["bench_h"] = round(RunFolder(run).events[-1].time_s / 3600.0, 2)
    return line


if __name__ == "__main__":
    main()
