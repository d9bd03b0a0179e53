"""`station resume`."""

from __future__ import annotations

import json
from pathlib import Path

from station.cli.running import may_ask, read_answers, read_served, told
from station.cli.validating import read_bench_named
from station.console import tell
from station.control.client import go_on
from station.errors import EXIT_DONE, InputError
from station.files.locks import is_held
from station.record.creation import EVENTS
from station.record.folder import RunFolder
from station.record.manifest import LOCK
from station.record.recorded import read_plan_and_bench
from station.runner.resuming import ResumeRequest, resume


def resume_run(
    folder: Path,
    bench_name: str | None,
    *,
    served: Path | None,
    answers: Path | None,
    non_interactive: bool,
    trace: bool,
    as_json: bool,
) -> int:
    """Go on with a run: one that is paused in another process, or one that ended too early."""
    if not (folder / EVENTS).is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    if is_held(folder / LOCK):
        if not go_on(folder):
            raise InputError(f"{folder} is being run and is not paused; see `station status`")
        tell(f"{folder} goes on in its own process")
        if as_json:
            print(json.dumps({"run": str(folder), "went_on": True, "exit_code": EXIT_DONE}))
        return EXIT_DONE
    plan, _ = read_plan_and_bench(RunFolder(folder))
    request = ResumeRequest(
        folder,
        read_bench_named(bench_name) if bench_name else None,
        answers=read_answers(answers) if answers else {},
        interactive=may_ask(non_interactive=non_interactive),
        served=read_served(served) if served else None,
        trace=trace,
    )
    return told(resume(request), plan.procedure, as_json=as_json)
