"""Which mutants of the code the tests kill: 600 mutants, kept in `mutants.jsonl` beside this file.

    python benchmarks/mutants.py draw --seed 1 > benchmarks/mutants.jsonl
    python benchmarks/mutants.py cover --code DIR --coverage FOLDER [-- ARGUMENTS OF PYTEST]
    python benchmarks/mutants.py run --code DIR --coverage FOLDER --results FILE
    python benchmarks/mutants.py count --results FILE …

`draw` spreads 300 over the lines of code of `CORE` and 300 over the others: of the file at each
point an operator by lot, its chance growing with the logarithm of its replacements there, and
one of these. `mutant_sites.py` says what is mutated.

`cover` runs the tests of a checkout's last commit in a copy and writes which test runs which line
and how long each takes. `--durations XML --at-most S` leaves out the tests that take longer in a
report of `pytest --junit-xml`. `--workers 2` is two processes.

`run` writes one mutant after another into such a copy, and runs the `--tests` (40) first of the
tests that run its line, each function's quickest before its second, that fit into `--budget` (20 s
of what they took in `cover`), the quickest first, until one fails. The tests that share a fixture
with these come last: the fixture ran the line for them too.
A process that has imported the libraries but none of our code forks for each mutant; whatever the
fork leaves is killed. A test kills that fails twice with the mutant and passes without it. One line
each: `killed`, `survived`, `timeout` (over `--seconds`: counts as killed), `not-covered`, or
`not-found` where the code is no longer there. An existing file of results is continued.

A small `--budget` is quick, yet leaves out the tests that look at whole runs. What survives it is
held against more: `run --only survived-in FIRST --budget 60 --results SECOND`; `count` and `--only`
take several files, of which a later one has the last word.

Before and after a change of the tests, with the commands of that change's two checkouts:

    python benchmarks/mutants.py cover --code BEFORE --coverage C1
    python benchmarks/mutants.py run --code BEFORE --coverage C1 --results before.jsonl
    python benchmarks/mutants.py cover --code BEFORE --tests-from AFTER --coverage C2
    python benchmarks/mutants.py run --code BEFORE --tests-from AFTER --coverage C2 \
        --only killed-in before.jsonl --results after.jsonl

With `--tests-from` the copy holds `tests/` and `pyproject.toml` of the other checkout, beside the
code of `--code`. Where the code has changed too, `--code AFTER` alone: a mutant is found again by
its function, the text of its line and which of the equal lines it is.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import ctypes
import gc
import importlib
import json
import math
import os
import py_compile
import random
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mutant_coverage
import pytest
from mutant_coverage import DATA, TESTS, TIMES, Covering
from mutant_sites import Sites, code_lines

PACKAGES = ("station", "drivers", "procedures", "sim_instruments")
CORE = ("station/safety", "station/record", "station/method", "procedures/estimation")
GROUP_SIZE = 300
KEPT = Path(__file__).with_suffix(".jsonl")
LIBRARIES = """
alembic can cantools cryptography.hazmat.primitives.asymmetric.ed25519 GTC h5py hypothesis
jinja2 magpylib matplotlib.backends.backend_agg matplotlib.backends.backend_pdf
matplotlib.backends.backend_svg matplotlib.figure mcap.reader mcap.writer numpy pydantic
pymodbus.client pymodbus.server pyvisa pyvisa_py rich.console rich.live rich.progress rich.table
scipy.interpolate scipy.linalg scipy.optimize scipy.signal scipy.spatial scipy.special
scipy.stats serial sqlalchemy.orm typer.testing yaml
"""
ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MPLBACKEND": "agg",
    "PYTHONHASHSEED": "0",
}
PLUGINS = ["-p", "no:cacheprovider", "-p", "no:randomly", "-p", "no:xdist", "-p", "no:cov"]
KILLED = ("killed", "timeout")
SET_CHILD_SUBREAPER = 36


@dataclass(frozen=True)
class Mutant:
    """A piece of a line and what takes its place, to be found again after lines have moved.

    `text` is the line, the `occurrence`-th of its text in the function, or class or module, whose
    qualified name is `function`. `column` counts from 0 in the text.
    """

    id: str
    file: str
    line: int
    column: int
    operator: str
    function: str
    text: str
    occurrence: int
    original: str
    replacement: str

    def start_in(self, source: str) -> int | None:
        """Return the character of a source at which the piece stands, none if it is gone."""
        owners = owners_of_lines(source)
        starts = starts_of_lines(source)
        rows = [
            row
            for row, text in enumerate(source.splitlines())
            if text.strip() == self.text.strip() and owners[row] == self.function
        ]
        if len(rows) < self.occurrence:
            return None
        row = rows[self.occurrence - 1]
        moved = indent(source.splitlines()[row]) - indent(self.text)
        start = starts[row] + self.column + moved
        return start if source.startswith(self.original, start) else None

    def mutated(self, source: str) -> str | None:
        """Return the source with the mutant, none if the piece is gone."""
        start = self.start_in(source)
        if start is None:
            return None
        return source[:start] + self.replacement + source[start + len(self.original) :]


def indent(text: str) -> int:
    return len(text) - len(text.lstrip())


def starts_of_lines(source: str) -> list[int]:
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return starts


def owners_of_lines(source: str) -> list[str]:
    """Return the qualified name of the innermost function or class of each line."""
    owners = [""] * (len(source.splitlines()) + 1)

    def visit(node: ast.AST, name: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                own = f"{name}.{child.name}".lstrip(".")
                end = child.end_lineno or child.lineno
                owners[child.lineno - 1 : end] = [own] * (end - child.lineno + 1)
                visit(child, own)
            else:
                visit(child, name)

    visit(ast.parse(source), "")
    return owners


def read_mutants(file: Path) -> list[Mutant]:
    return [Mutant(**json.loads(line)) for line in file.read_text("utf-8").splitlines()]


def room_of(file: str) -> str:
    """Return the folder below a package in which a file lies, or the package."""
    return "/".join(file.split("/")[:2]) if file.count("/") > 1 else file.split("/")[0]


# --- draw ---------------------------------------------------------------------------------------


def draw(arguments: argparse.Namespace) -> None:
    generator = random.Random(arguments.seed)
    files = {
        str(path.relative_to(arguments.code)): path.read_text("utf-8")
        for package in PACKAGES
        for path in sorted((arguments.code / package).rglob("*.py"))
    }
    core = {file for file in files if room_of(file) in CORE}
    for name, group in (("core", core), ("rest", files.keys() - core)):
        sources = {file: files[file] for file in sorted(group)}
        for mutant in drawn(name, sources, generator):
            print(json.dumps(asdict(mutant), ensure_ascii=False), flush=True)


def drawn(group: str, sources: dict[str, str], generator: random.Random) -> Iterator[Mutant]:
    """Yield mutants at points that are spread over the lines of code of all sources."""
    lines = {file: code_lines(source) for file, source in sources.items()}
    total = sum(lines.values())
    points = [(number + generator.random()) * total / GROUP_SIZE for number in range(GROUP_SIZE)]
    sites: dict[str, Sites] = {}
    taken: set[tuple[str, int, str]] = set()
    for number, point in enumerate(points, start=1):
        file = at_line(lines, point)
        mutant: Mutant | None = None
        while mutant is None:
            if file not in sites:
                sites[file] = Sites(sources[file])
            counts = sites[file].counts()
            if not counts:  # a package's empty `__init__`
                file = at_line(lines, generator.random() * total)
                continue
            weights = [1.0 + math.log(count) for count in counts.values()]
            (operator,) = generator.choices(list(counts), weights)
            change = sites[file].change(operator, generator.randrange(counts[operator]))
            if change and (file, change.start, change.replacement) not in taken:
                taken.add((file, change.start, change.replacement))
                start, original, replacement = change.start, change.original, change.replacement
                mutant = described(
                    f"{group}-{number:03d}",
                    file,
                    sources[file],
                    operator,
                    start,
                    original,
                    replacement,
                )
        yield mutant


def at_line(lines: dict[str, int], point: float) -> str:
    for file, count in lines.items():
        if point < count:
            return file
        point -= count
    return file


def described(
    name: str, file: str, source: str, operator: str, start: int, original: str, replacement: str
) -> Mutant:
    starts, texts, owners = (
        starts_of_lines(source),
        source.splitlines(),
        owners_of_lines(source),
    )
    row = max(row for row, first in enumerate(starts[:-1]) if first <= start)
    equal = [
        other
        for other in range(row + 1)
        if texts[other].strip() == texts[row].strip() and owners[other] == owners[row]
    ]
    return Mutant(
        id=name,
        file=file,
        line=row + 1,
        column=start - starts[row],
        operator=operator,
        function=owners[row],
        text=texts[row],
        occurrence=len(equal),
        original=original,
        replacement=replacement,
    )


# --- cover --------------------------------------------------------------------------------------


def copy_of(code: Path, tests_from: Path | None, scratch: Path) -> Path:
    """Clone the last commit of a checkout, with the tests of another one where it is given."""
    shutil.rmtree(scratch, ignore_errors=True)
    git = ["git", "-c", "advice.detachedHead=false"]
    subprocess.run([*git, "clone", "-q", "--shared", str(code), str(scratch)], check=True)
    if tests_from is not None:
        shutil.rmtree(scratch / "tests")
        wanted = ["git", "-C", str(tests_from), "archive", "HEAD", "tests", "pyproject.toml"]
        archive = subprocess.run(wanted, stdout=subprocess.PIPE, check=True)
        subprocess.run(["tar", "-x", "-C", str(scratch)], input=archive.stdout, check=True)
    return scratch


def cover(arguments: argparse.Namespace) -> None:
    folder = arguments.coverage.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    scratch = copy_of(arguments.code, arguments.tests_from, arguments.scratch)
    settings = folder / "coveragerc"
    sources = "\n    ".join(str(scratch / package) for package in PACKAGES)
    settings.write_text(
        f"[run]\nparallel = true\ndata_file = {folder / DATA}\n"
        "context = ${PYTEST_CURRENT_TEST-}\n"
        f"disable_warnings = no-data-collected,couldnt-parse\nsource =\n    {sources}\n",
        encoding="utf-8",
    )
    left_out = folder / "left_out.txt"
    long = too_long(arguments.durations, arguments.at_most) if arguments.durations else []
    left_out.write_text("".join(f"{test}\n" for test in long), encoding="utf-8")
    environment = {
        **os.environ,
        **ENVIRONMENT,
        "PYTHONPATH": os.pathsep.join([str(scratch), str(Path(__file__).parent)]),
        "COVERAGE_PROCESS_START": str(settings),
        TESTS: str(folder / TIMES),
        mutant_coverage.LEFT_OUT: str(left_out),
        "PYTEST_DEBUG_TEMPROOT": str(arguments.scratch.parent),
    }
    command = [sys.executable, "-m", "pytest", "-p", "mutant_coverage", "-p", "no:cacheprovider"]
    if arguments.workers > 1:
        command += ["-n", str(arguments.workers), "--dist", "worksteal"]
    with (folder / "pytest.log").open("w", encoding="utf-8") as log:
        done = subprocess.run(
            [*command, *arguments.pytest],
            cwd=scratch,
            env=environment,
            stdout=log,
            stderr=subprocess.STDOUT,
            check=False,
        )
    combine = [sys.executable, "-m", "coverage", "combine", "-q", f"--rcfile={settings}"]
    subprocess.run(combine, cwd=folder, check=True)
    tests = (folder / TIMES).read_text("utf-8").splitlines()
    line = {
        "benchmark": "mutants",
        "tests": len(tests),
        "left_out": len(long),
        "failed": sum(json.loads(test)["failed"] for test in tests),
        "exit_code": done.returncode,
    }
    print(json.dumps(line), flush=True)


def too_long(report: Path, at_most_s: float) -> list[str]:
    """Return the tests, as `module.path::name`, that take longer in a JUnit report."""
    xml = importlib.import_module("xml.etree.ElementTree")
    times: defaultdict[str, float] = defaultdict(float)
    for case in xml.parse(report).iter("testcase"):
        times[f"{case.get('classname')}::{case.get('name')}"] += float(case.get("time"))
    return sorted(test for test, seconds in times.items() if seconds > at_most_s)


# --- run ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trial:
    """How one run of tests ended, the test that failed or ran last, those that are not there."""

    status: str
    test: str | None
    missing: tuple[str, ...] = ()


class Runner:
    """Runs tests in forks of this process, in a copy of the code.

    `pristine` is the file that remembers which tests pass there without a mutant.
    """

    def __init__(self, scratch: Path, pristine: Path) -> None:
        self.scratch = scratch
        self._pristine = pristine
        self._passes: dict[str, bool] = {}
        if pristine.exists():
            self._passes = json.loads(pristine.read_text("utf-8"))
        self._folder = Path(tempfile.mkdtemp(prefix="mutants-", dir=scratch.parent))
        self._number = 0
        os.environ.update(ENVIRONMENT)
        os.environ["PYTHONPATH"] = str(scratch)
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # compiled forms are kept, see `replaced`
        sys.dont_write_bytecode = False
        for name in LIBRARIES.split():
            with contextlib.suppress(ImportError):
                importlib.import_module(name)
        subprocess.run(
            [sys.executable, "-m", "compileall", "-q", *PACKAGES], cwd=scratch, check=True
        )
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0):
            raise OSError(ctypes.get_errno(), "cannot become the parent of what a test leaves")
        gc.collect()
        gc.freeze()

    def close(self) -> None:
        """Delete what the runs have left in the folder of the copy."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def judge(
        self, mutant: Mutant, tests: list[str], seconds: float
    ) -> tuple[str, str | None, int]:
        """Return how a mutant ends, the test that kills it, and how many tests it met.

        A test kills if it fails twice with the mutant, and passes without it.
        """
        path = self.scratch / mutant.file
        text = mutant.mutated(path.read_text("utf-8"))
        assert text is not None
        number = int("".join(filter(str.isdigit, mutant.id)))
        left = [test for test in tests if self._passes.get(test, True)]
        met = len(left)
        while left:
            with replaced(path, text, number):
                trial = self.run(left, seconds)
                again = trial.status in KILLED and trial.test in left
                fails = not again or self.run([str(trial.test)], seconds / 3.0).status in KILLED
            if trial.status == "missing":
                left = [test for test in left if test not in trial.missing]
            elif trial.status == "skipped":
                return "not-covered", None, met
            elif not again or (fails and self._passes_pristine(str(trial.test), seconds)):
                return trial.status, trial.test if trial.status in KILLED else None, met
            else:
                left = left[left.index(str(trial.test)) + 1 :]
                if not left:
                    return "survived", None, met
        return "not-covered", None, 0

    def _passes_pristine(self, test: str, seconds: float) -> bool:
        if test not in self._passes:
            self._passes[test] = self.run([test], seconds).status == "survived"
            self._pristine.write_text(json.dumps(self._passes, indent=0), encoding="utf-8")
        return self._passes[test]

    def run(self, tests: Sequence[str], seconds: float) -> Trial:
        """Run tests until one fails; kill whatever they leave."""
        self._number += 1
        place = self._folder / str(self._number)
        place.mkdir()
        witness = place / "witness.jsonl"
        child = os.fork()
        if child == 0:
            self._be_the_child(place, witness, tests)
        timeout = not ended(child, seconds)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        kill_what_is_left()
        trial = self._judged(witness, os.waitstatus_to_exitcode(status), timeout)
        shutil.rmtree(place, ignore_errors=True)
        return trial

    def _be_the_child(self, place: Path, witness: Path, tests: Sequence[str]) -> None:
        exit_code = 70
        try:
            os.setsid()
            log = os.open(place / "log.txt", os.O_CREAT | os.O_WRONLY, 0o644)
            nothing = os.open(os.devnull, os.O_RDONLY)
            for source, target in ((nothing, 0), (log, 1), (log, 2)):
                os.dup2(source, target)
            os.chdir(self.scratch)
            own = str(Path(__file__).resolve().parent)
            sys.path[:] = [str(self.scratch), *(path for path in sys.path if path != own)]
            sys.argv = ["pytest"]
            os.environ["TMPDIR"] = os.environ["PYTEST_DEBUG_TEMPROOT"] = str(place)
            tempfile.tempdir = None
            options = ["-q", "-x", *PLUGINS, "-o", "addopts=", "--strict-markers"]
            exit_code = int(pytest.main([*options, *tests], plugins=[Witness(witness)]))
            sys.stdout.flush()
        finally:
            os._exit(exit_code)

    def _judged(self, witness: Path, exit_code: int, timeout: bool) -> Trial:
        lines = witness.read_text("utf-8").splitlines() if witness.exists() else []
        told: dict[str, list[str]] = defaultdict(list)
        for line in lines:
            told[json.loads(line)["event"]].append(json.loads(line)["test"])
        failed = told["failed"]
        missing = missing_tests(witness.parent / "log.txt", self.scratch) if not failed else []
        if failed:
            status = "killed"
        elif timeout:
            status = "timeout"
        elif exit_code == 0 and told["passed"]:
            status = "survived"
        elif missing:
            status = "missing"
        elif exit_code == 0:
            status = "skipped"
        else:  # pytest or the tests' own preparation broke, or the process died
            status = "killed"
        test = failed[0] if failed else (told["started"] or [f"exit code {exit_code}"])[-1]
        return Trial(status, test, tuple(missing))


class Witness:
    """A plugin of pytest that writes down at once what starts, passes and fails."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Write that a test starts."""
        self._write("started", nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Write that a test has passed or failed."""
        if report.failed:
            self._write("failed", report.nodeid)
        elif report.passed and report.when == "call":
            self._write("passed", report.nodeid)

    def pytest_collectreport(self, report: Any) -> None:
        """Write that a file of tests cannot be read."""
        if report.failed:
            self._write("failed", report.nodeid)

    def _write(self, event: str, test: str) -> None:
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"event": event, "test": test}) + "\n")


def missing_tests(log: Path, scratch: Path) -> list[str]:
    """Return the tests that pytest does not find, such as those of a parameter that is gone."""
    mark = re.compile(r"^ERROR: (?:file or directory )?not found: (.*)$", re.MULTILINE)
    text = log.read_text("utf-8", errors="replace") if log.exists() else ""
    return [test.removeprefix(f"{scratch}/") for test in mark.findall(text)]


def ended(child: int, seconds: float) -> bool:
    """Wait for a process to end, and return whether it did so in time."""
    descriptor = os.pidfd_open(child)
    try:
        return bool(select.select([descriptor], [], [], seconds)[0])
    finally:
        os.close(descriptor)


def kill_what_is_left() -> None:
    """Kill the processes that a test has left: this process has become their parent."""
    children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
    while left := children.read_text("ascii").split():
        for process in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(process), signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(int(process), 0)


@contextlib.contextmanager
def replaced(path: Path, text: str, number: int) -> Iterator[None]:
    """Put a text into a file for a while.

    Its time is one of its own, so that no compiled form of it is taken for that of another text.
    """
    original, stat = path.read_bytes(), path.stat()
    path.write_text(text, encoding="utf-8")
    os.utime(path, (stat.st_atime, 1e9 + number))
    try:
        yield
    finally:
        path.write_bytes(original)
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
        py_compile.compile(str(path))


def run(arguments: argparse.Namespace) -> None:
    results: Path = arguments.results
    finished = {line["id"] for line in read_results(results)} if results.exists() else set()
    scratch = copy_of(arguments.code, arguments.tests_from, arguments.scratch)
    runner = Runner(scratch, results.with_suffix(".pristine.json"))
    try:
        covering = Covering(arguments.coverage, scratch)
        for mutant in chosen(arguments):
            if mutant.id in finished:
                continue
            began = time.monotonic()
            status, test, count = "not-found", None, 0
            line = line_in(mutant, scratch)
            if line is not None:
                tests = covering.tests_of(mutant.file, line)[: arguments.tests]
                tests = covering.within(tests, arguments.budget)
                status, test, count = runner.judge(mutant, tests, arguments.seconds)
            ended_so = {
                "id": mutant.id,
                "status": status,
                "test": test,
                "tests": count,
                "seconds": round(time.monotonic() - began, 2),
            }
            with results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(ended_so) + "\n")
            print(json.dumps(ended_so), flush=True)
    finally:
        runner.close()
        shutil.rmtree(scratch, ignore_errors=True)


def chosen(arguments: argparse.Namespace) -> list[Mutant]:
    """Return the mutants to run: all, those named, or those killed in a file of results.

    One of each group in turn, so that what an interrupted run has done is a fair part of all.
    """
    mutants = sorted(read_mutants(arguments.mutants), key=lambda mutant: mutant.id[-3:])
    if not arguments.only:
        return mutants
    wanted = set(arguments.only)
    statuses = {"killed-in": KILLED, "survived-in": ("survived",)}.get(arguments.only[0])
    if statuses is not None:
        status = statuses_in([Path(file) for file in arguments.only[1:]])
        wanted = {name for name, ended_so in status.items() if ended_so in statuses}
    return [mutant for mutant in mutants if mutant.id in wanted]


def line_in(mutant: Mutant, code: Path) -> int | None:
    path = code / mutant.file
    if not path.is_file():
        return None
    source = path.read_text("utf-8")
    start = mutant.start_in(source)
    return None if start is None else source.count("\n", 0, start) + 1


def read_results(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in file.read_text("utf-8").splitlines()]


def statuses_in(files: Sequence[Path]) -> dict[str, str]:
    """Return how each mutant ended; a later file has the last word."""
    return {line["id"]: line["status"] for file in files for line in read_results(file)}


# --- count --------------------------------------------------------------------------------------


def count(arguments: argparse.Namespace) -> None:
    status = statuses_in(arguments.results)
    rooms: dict[str, Counter[str]] = defaultdict(Counter)
    for mutant in read_mutants(arguments.mutants):
        if mutant.id in status:
            rooms[room_of(mutant.file)][status[mutant.id]] += 1
            rooms["all"][status[mutant.id]] += 1
    for room, counts in sorted(rooms.items()):
        print(json.dumps({"benchmark": "mutants", "room": room, **dict(sorted(counts.items()))}))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    root = Path(__file__).resolve().parents[1]
    drawing = commands.add_parser("draw")
    drawing.add_argument("--seed", type=int, default=1)
    drawing.add_argument("--code", type=Path, default=root)
    covered = commands.add_parser("cover")
    covered.add_argument("--durations", type=Path, help="a report of pytest --junit-xml")
    covered.add_argument("--at-most", type=float, default=6.0, help="seconds of a test in it")
    covered.add_argument("--workers", type=int, default=1)
    covered.add_argument("pytest", nargs="*", help="arguments of pytest, after --")
    running = commands.add_parser("run")
    running.add_argument("--only", nargs="+", help="ids, or: killed-in FILE …, survived-in FILE …")
    running.add_argument("--tests", type=int, default=40, help="at most so many for a mutant")
    running.add_argument("--budget", type=float, default=20.0, help="seconds that they take")
    running.add_argument("--seconds", type=float, default=60.0, help="longest run of a mutant")
    running.add_argument("--results", type=Path, required=True)
    counting = commands.add_parser("count")
    counting.add_argument("--results", type=Path, nargs="+", required=True)
    for command in (covered, running):
        command.add_argument("--code", type=Path, default=root)
        command.add_argument("--tests-from", type=Path, help="a checkout whose tests are run")
        command.add_argument("--coverage", type=Path, required=True, help="folder of the data")
        command.add_argument("--scratch", type=Path, default=Path("/dev/shm/mutants-copy"))
    for command in (running, counting):
        command.add_argument("--mutants", type=Path, default=KEPT)
    arguments = parser.parse_args()
    {"draw": draw, "cover": cover, "run": run, "count": count}[arguments.command](arguments)


if __name__ == "__main__":
    main()
