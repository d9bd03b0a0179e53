"""A run with a fault, in this process on virtual time, and all that can be seen of its end."""

from __future__ import annotations

import io
import json
import sys
import threading
import warnings
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fault_cases import Case, bench_data, read_bench_at, short
from quick_yaml import dump_yaml

from station.cli.running import report_outcome
from station.errors import StationError
from station.record.folder import RunFolder
from station.runner.execute import Request, execute
from station.runner.outcome import Outcome


@dataclass
class Ended:
    """A run with a fault, after its end."""

    outcome: Outcome | None
    exit_code: int
    error: str
    said: str
    world: dict[str, Any]
    left_behind: list[str]
    warned: list[str]
    """Warnings of the program's own parts, which an operator would see and not understand."""

    @property
    def folder(self) -> RunFolder | None:
        """The run's folder, None where it never got one."""
        return RunFolder(self.outcome.folder) if self.outcome else None

    @property
    def first_s(self) -> float | None:
        """When the fault struck first."""
        first: float | None = self.world["faults"][0]["first_s"]
        return first


def run_case(case: Case, entry: Mapping[str, Any], folder: Path) -> Ended:
    """Run a plan with a fault, in this process on virtual time."""
    folder.mkdir(parents=True)
    data = bench_data(case.bench)
    report = folder / "world.json"
    data["simulation"] |= {"report": str(report), "faults": [dict(entry)]}
    (folder / "bench.yaml").write_text(dump_yaml(data), encoding="utf-8")
    bench = read_bench_at(folder / "bench.yaml")
    request = Request(short(case.plan, bench), bench, folder / "runs", quiet=True, report=False)
    before, children = set(threading.enumerate()), child_processes()
    said = io.StringIO()
    outcome, error, exit_code = None, "", 0
    with (
        redirect_stderr(said),
        redirect_stdout(said),
        warnings.catch_warnings(record=True) as warned,
    ):
        warnings.simplefilter("always")
        try:
            outcome = execute(request)
            exit_code = report_outcome(outcome, request.plan.procedure, as_json=False)
            error = outcome.error or ""
        except StationError as raised:
            exit_code, error = raised.exit_code, str(raised)
    threads = set(threading.enumerate()) - before
    for thread in threads:
        thread.join(10)
    left = [thread.name for thread in threads if thread.is_alive()]
    left += [f"process {one}" for one in child_processes() - children]
    assert report.is_file(), f"{case}: the world gave no account of itself: {error}"
    world = json.loads(report.read_text(encoding="utf-8"))
    remarks = [f"{one.category.__name__}: {one.message}" for one in warned]
    return Ended(outcome, exit_code, error, said.getvalue(), world, left, remarks)


def child_processes() -> set[str]:
    """Return the children of this process; nothing where the system does not tell."""
    lists = Path("/proc/self/task").glob("*/children") if sys.platform == "linux" else ()
    return {child for one in lists for child in one.read_text(encoding="utf-8").split()}
