"""What a dry run says of each shipped plan, against what the run does; one JSON line a plan.

python benchmarks/declared.py
python benchmarks/declared.py --plan rlg-magnetic-sensitivity --bench sim-alternate

Durations are bench time in s, by step: expected, shortest, longest, actual. Rows are those of each
source, commands those that were met by the dry run and those that were sent.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from figures import Figures

from station.cli.validating import read_bench_named, read_plan_for
from station.files.lookup import PLANS, available
from station.method.set_points import Bounded, Command
from station.procedure import procedure_of
from station.record.export.reading import blocks_of, sources
from station.record.folder import RunFolder
from station.runner.execute import Request, execute
from station.runner.run import ActingRun
from station.runner.static_limits import problems_of_plan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plan", action="append", help="by default all that fit the bench")
    parser.add_argument("--bench", default="sim")
    figures = Figures(parser)
    arguments = figures.parse()
    sent: list[Command[Any]] = []
    apply = ActingRun.apply

    def noted(run: ActingRun, command: Command[Any], *takes: Any, **named: Any) -> Any:
        sent.append(command)
        return apply(run, command, *takes, **named)

    setattr(ActingRun, "apply", noted)  # noqa: B010
    bench = read_bench_named(arguments.bench)
    for name in arguments.plan or [name for name, _ in available(PLANS)]:
        plan = read_plan_for(name, bench, ())
        procedure = procedure_of(plan.procedure)
        if any(problems_of_plan(procedure, plan.parameters, bench)):
            continue
        sent.clear()
        walk = procedure.walk(plan.parameters)
        met = [command for command in walk.commands if not isinstance(command, Bounded)]
        with tempfile.TemporaryDirectory() as parent:
            outcome = execute(Request(plan, bench, Path(parent), quiet=True, report=False))
            folder = RunFolder(outcome.folder)
            rows: Counter[str] = Counter()
            for source in sources(folder):
                for _, block in blocks_of(folder, source):
                    rows[source] += len(block)
            actual_s = step_times(folder)
        declared = {row.instrument: row.rows for row in walk.recordings(bench)}
        durations = {
            step.number: [
                *(round(value, 2) for value in vars(walk.duration(step.number)).values()),
                round(actual_s.get(step.number, 0.0), 2),
            ]
            for step in procedure.steps
        }
        whole = walk.duration()
        figures.line(
            name,
            bench=arguments.bench,
            exit_code=outcome.exit_code,
            expected_s=round(whole.expected_s, 1),
            actual_s=round(sum(actual_s.values()), 1),
            outside=[
                number
                for number, (_, shortest_s, longest_s, took_s) in durations.items()
                if not shortest_s - 0.3 <= took_s <= longest_s + 0.3
            ],
            steps=durations,
            rows_declared=sum(declared.values()),
            rows_recorded=sum(rows.values()),
            commands_met=len(met),
            commands_sent=len(sent),
            not_met=len([command for command in sent if command not in met]),
        )


def step_times(folder: RunFolder) -> dict[str, float]:
    """Return how long each step took, in s of bench time."""
    began_s: dict[str, float] = {}
    took_s: dict[str, float] = {}
    for event in folder.events:
        if event.kind == "step-started":
            began_s[event.details["step"]] = event.time_s
        elif event.kind == "step-finished":
            took_s[event.details["step"]] = event.time_s - began_s[event.details["step"]]
    return took_s


if __name__ == "__main__":
    main()
