"""Where the figures of a benchmark go: a JSON line each, and with `--store` into `figures/` too.

A document that gives figures names their file in a comment; `tests/house/test_figures.py` holds the
two together. What is stored says of which commit it is, so nothing is stored of changed sources.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "benchmarks" / "figures"
SOURCES = ("station", "drivers", "procedures", "sim_instruments", "config", "benchmarks/*.py")
CPU_INFO = Path("/proc/cpuinfo")


class Figures:
    """What one call of a benchmark measures; make it before the options are parsed.

    The file in `figures/` has the name of the benchmark.
    """

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--store", action="store_true", help="keep the lines in figures/")
        self._parser = parser
        self._head: dict[str, Any] = {}
        self._benchmark = Path(sys.argv[0]).stem

    def parse(self) -> argparse.Namespace:
        """Return the options; ends the program where what is to be stored is of no commit."""
        options = self._parser.parse_args()
        if options.store:
            if changed := git("status", "--porcelain", "--untracked-files=no", "--", *SOURCES):
                self._parser.error(f"commit first, figures are those of a commit:\n{changed}")
            arguments = [argument for argument in sys.argv[1:] if argument != "--store"]
            command = shlex.join(["python", f"benchmarks/{self._benchmark}.py", *arguments])
            self._head = {
                "commit": git("rev-parse", "--short=10", "HEAD"),
                "date": datetime.now(UTC).date().isoformat(),
                "machine": f"{os.cpu_count()} cores, {processor()}",
                "command": command,
            }
        return options

    def line(self, case: str, **figures: object) -> None:
        """Print the figures of a case, and store them where that was asked for."""
        line = {"case": case, **figures}
        print(json.dumps(line, ensure_ascii=False), flush=True)
        if self._head:
            FOLDER.mkdir(exist_ok=True)
            with (FOLDER / f"{self._benchmark}.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps({**line, **self._head}, ensure_ascii=False) + "\n")


def stored(benchmark: str) -> dict[str, dict[str, Any]]:
    """Return the newest stored line of each case of a benchmark, in the order of the cases."""
    newest: dict[str, dict[str, Any]] = {}
    for line in lines_of(FOLDER / f"{benchmark}.jsonl"):
        newest[line["case"]] = line
    return newest


def lines_of(file: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a stored file."""
    for line in file.read_text(encoding="utf-8").splitlines():
        yield json.loads(line)


def git(*arguments: str) -> str:
    """Return what git says of the sources."""
    done = subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=True
    )
    return done.stdout.strip()


def processor() -> str:
    """Return the model of the processor."""
    if CPU_INFO.is_file():
        for line in CPU_INFO.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
