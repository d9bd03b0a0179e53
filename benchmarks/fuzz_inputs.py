"""Odd inputs: no plan, bench or dataset may end as a fault of the program, hang, or flood.

`python benchmarks/fuzz_inputs.py --count 10000` mutates the shipped plans and benches and the data
sets of the tests, by their structure and by their bytes, and gives each to the command that reads
it, in this process. Each input is made of its number alone. One JSON object a line: the inputs that
broke a promise (all with `--all`), and a summary last. `--datasets FOLDER` takes others in.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType

sys.path.insert(0, str(Path(__file__).parent))

from odd_changes import ODD, TABLE, YAML, mutated

from station.cli import main

ROOT = Path(__file__).parent.parent
MAX_S = 10.0
MAX_BYTES = 100_000
MAX_MEMORY_BYTES = 6 << 30
RIGHT = (0, 1, 2, 6)


@dataclass(frozen=True)
class Outcome:
    """How one input ended; `broken` says which promise it broke, empty for none."""

    number: int
    kind: str
    source: str
    mutations: tuple[str, ...]
    command: tuple[str, ...]
    exit_code: int
    seconds: float
    bytes: int
    broken: str
    said: str


class TooLong(BaseException):
    """An input that took longer than it may."""


def lay_out(
    rng: random.Random, place: Path, datasets: Sequence[Path]
) -> tuple[str, str, list[str], list[str]]:
    """Write one odd input into a folder; return its kind, source, mutations, and the command."""
    plans = sorted((ROOT / "config" / "plans").glob("*.yaml"))
    benches = sorted((ROOT / "config" / "benches").glob("*.yaml"))
    kind = rng.choice(("plan", "bench", "dataset", "dataset", "set", "files"))
    plan = rng.choice(plans)
    verb = rng.choice((["validate"], ["validate", "--json"], ["run", "--dry-run"]))
    if kind == "plan":
        file = place / "plan.yaml"
        shutil.copy(plan, file)
        return kind, plan.name, mutated(rng, file, YAML), [*verb, str(file)]
    if kind == "bench":
        file, bench = place / "bench.yaml", rng.choice(benches)
        shutil.copy(bench, file)
        return kind, bench.name, mutated(rng, file, YAML), [*verb, plan.stem, "--bench", str(file)]
    if kind == "set":
        keys = (
            "parameters",
            "parameters.amplitude",
            "limits",
            "dut.serial",
            "x",
            "",
            "parameters.axes[0]",
        )
        given = f"{rng.choice(keys)}={rng.choice(ODD)}"
        return kind, plan.name, [given[:60]], [*verb, plan.stem, f"--set={given}"]
    dataset = rng.choice(datasets)
    data = place / "data"
    shutil.copytree(dataset, data)
    if kind == "dataset":
        file = rng.choice(sorted(data.glob("*.csv")))
        names = mutated(rng, file, TABLE)
    else:
        names = mutated(rng, data / "dataset.yaml", YAML)
    command = [
        "analyse",
        str(data),
        *rng.choice(([], ["--json"], ["--output", odd_output(rng, place)])),
    ]
    return kind, dataset.name, names, command


def odd_output(rng: random.Random, place: Path) -> str:
    """Return a place for results: a folder to be made, a file, a link that leads nowhere."""
    name = rng.choice(("new/deep", "file", "link", "file/below", "link/below"))
    (place / "file").write_text("")
    (place / "link").symlink_to(place / "nowhere" / "at all")
    return str(place / name)


@contextmanager
def bounded() -> Iterator[None]:
    """End what takes longer than an input may, several times longer: the machine may be busy."""

    def stop(signum: int, frame: FrameType | None) -> None:
        raise TooLong

    signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, 6 * MAX_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def attempt(number: int, datasets: Sequence[Path]) -> Outcome:
    """Make the input of a number, give it to its command, and judge how that ended."""
    rng = random.Random(number)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        kind, source, mutations, command = lay_out(rng, Path(folder), datasets)
        out, err = io.StringIO(), io.StringIO()
        argv, sys.argv = sys.argv, ["station", *command]
        code, broken, began_s = -1, "", time.process_time()
        try:
            with redirect_stdout(out), redirect_stderr(err), warnings.catch_warnings(), bounded():
                warnings.simplefilter("always")
                main()
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 0
        except TooLong:
            broken = f"longer than {MAX_S:g} s"
        finally:
            sys.argv = argv
        seconds = time.process_time() - began_s
    said = err.getvalue() + out.getvalue()
    size = len(said.encode("utf-8", "replace"))
    if "a fault of the program" in said or "Traceback" in said:
        broken = "a fault of the program"
    elif "Warning: " in err.getvalue():
        broken = "a warning of a library"
    elif code not in RIGHT and not (code == 3 and "There is no verdict on the device" in said):
        broken = broken or f"exit code {code}"
    elif seconds > MAX_S:
        broken = f"longer than {MAX_S:g} s"
    elif size > MAX_BYTES:
        broken = f"more than {MAX_BYTES} bytes"
    shown = tuple(word.replace(folder, "…")[:200] for word in command)
    return Outcome(
        number,
        kind,
        source,
        tuple(mutations),
        shown,
        code,
        round(seconds, 3),
        size,
        broken,
        said[:400],
    )


def datasets_in(folders: Sequence[Path]) -> list[Path]:
    """Return the folders below that hold a dataset."""
    return [file.parent for folder in folders for file in sorted(folder.glob("*/dataset.yaml"))]


def run(first: int, count: int, folders: Sequence[Path]) -> Iterator[Outcome]:
    """Yield how each of `count` inputs ended, from number `first` on."""
    datasets = datasets_in(folders)
    for number in range(first, first + count):
        yield attempt(number, datasets)


def arguments() -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--datasets", type=Path, action="append", default=[])
    parser.add_argument(
        "--all", action="store_true", help="print the inputs that broke nothing, too"
    )
    return parser.parse_args()


if __name__ == "__main__":
    given = arguments()
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    os.environ["COLUMNS"] = "200"
    ended: Counter[str] = Counter()
    slowest_s, largest = 0.0, 0
    for one in run(given.first, given.count, [ROOT / "tests" / "data", *given.datasets]):
        ended[one.broken or f"exit code {one.exit_code}"] += 1
        slowest_s, largest = max(slowest_s, one.seconds), max(largest, one.bytes)
        if one.broken or given.all:
            print(json.dumps(asdict(one), ensure_ascii=False), flush=True)
    summary = {"inputs": given.count, "first": given.first, "ended": dict(ended)}
    print(json.dumps({**summary, "slowest_s": slowest_s, "most_bytes": largest}))
