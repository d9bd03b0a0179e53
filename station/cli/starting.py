"""A run that is started from the panel: looked at first, then begun as a process of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from threading import Lock
from typing import Any

from station.cli.attaching import begin_detached, in_english
from station.cli.instruments import identified
from station.cli.validating import read_bench_named, read_plan_for
from station.errors import InputError, StationError
from station.files.faults import FaultList
from station.files.plan import Plan
from station.panel.access import Role
from station.panel.starting import Wanted
from station.procedure import procedure_of
from station.record.folder import RunFolder
from station.recorded import read_plan_and_bench
from station.runner.dry_run import walk

CERTIFICATE_WITHIN_S = 120.0


def not_for(role: Role, plan: Plan, what: str) -> str | None:
    """Return why a role may not run a plan, None where it may."""
    if role == "engineer" or plan.header.released:
        return None
    return f"{what} is not released (`released: true` in the plan); an engineer may start it"


def of_form(fault: str) -> str:
    """Return a fault of what was typed into the form without its place among the options."""
    return re.sub(r"^--set:\d+:\d+: (dut\.)?", "", fault)


class DetachedRuns:
    """Begins runs below a folder."""

    def __init__(self, runs: Path) -> None:
        self._runs = runs
        self._prints = Lock()
        """One certificate at a time: whoever clicks again waits."""

    def look(self, wanted: Wanted, role: Role) -> dict[str, Any]:
        """Return what a run would do, or in `faults` what keeps it from being started."""
        try:
            bench = read_bench_named(wanted.bench)
            plan = read_plan_for(wanted.plan, bench, wanted.overrides)
            walked = walk(plan, bench, self._runs)
        except FaultList as error:
            return {"faults": [of_form(str(fault)) for fault in error.faults]}
        except StationError as error:
            return {"faults": [str(error)]}
        fault = not_for(role, plan, f"the plan {wanted.plan}")
        faults = [fault] if fault else []
        if bench.simulation is None and not faults:  # what is simulated answers
            used = procedure_of(plan.procedure).walk(plan.parameters).used_on(bench)
            asked = identified(bench, plan.procedure, used, "`station panel`, before a run")
            faults += [
                f"{answer.name}: {answer.said.removeprefix(f'{answer.name}: ')}"
                for answer in asked
                if not answer.ok
            ]
        return {
            "faults": faults,
            **walked.to_data(),
            "title": plan.header.title or procedure_of(plan.procedure).title,
        }

    def start(self, wanted: Wanted, role: Role) -> str:
        """Begin the run and return the name of its folder; raises InputError.

        A simulated bench asks every prompt all the same, so that people can practise.
        """
        if faults := self.look(wanted, role)["faults"]:
            raise InputError("; ".join(faults))
        arguments = ["run", wanted.plan, "--bench", wanted.bench, "--output", str(self._runs)]
        arguments += [part for override in wanted.overrides for part in ("--set", override)]
        if read_bench_named(wanted.bench).simulation is not None:
            arguments.append("--rehearse")
        return begin_detached(arguments).name

    def resume(self, folder: Path, role: Role) -> None:
        """Go on with a run; raises InputError with what is wrong."""
        plan, bench = read_plan_and_bench(RunFolder(folder))
        if fault := not_for(role, plan, "this run's plan"):
            raise InputError(fault)
        rehearse = ["--rehearse"] if bench.simulation is not None else []
        begin_detached(["resume", str(folder), *rehearse])

    def certificate(self, folder: Path, language: str) -> Path:
        """Make the certificate of a run as PDF and return it; raises InputError.

        A process of its own draws it: the panel's does not grow by what it needs.
        """
        asked = ["report", str(folder), "--kind", "certificate", "--format", "pdf"]
        with self._prints:
            try:
                made = subprocess.run(
                    [sys.executable, "-m", "station", *in_english(asked), "--lang", language],
                    capture_output=True,
                    text=True,
                    timeout=CERTIFICATE_WITHIN_S,
                )
            except subprocess.TimeoutExpired as error:
                raise InputError(
                    f"the certificate was not made within {CERTIFICATE_WITHIN_S:g} s; try again "
                    "when the computer is less busy"
                ) from error
        if made.returncode:
            raise InputError(made.stderr.strip() or "the certificate was not made")
        return Path(made.stdout.splitlines()[-1])
