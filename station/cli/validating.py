"""`station validate`, and the reading of a plan with its bench that `run` shares."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from station import registry
from station.bench import Bench, read_bench
from station.errors import EXIT_DONE, EXIT_WRONG_INPUT
from station.lookup import BENCHES, PLANS, find
from station.plan import Plan, read_plan
from station.yaml_reading import Fault, FaultList


def read_bench_named(name: str) -> Bench:
    """Return the bench of a path or name."""
    return read_bench(find(BENCHES, name), registry.names(registry.DRIVERS))


def read_plan_for(name: str, bench: Bench) -> Plan:
    """Return a plan that can run on the bench; FaultList holds every reason why it cannot."""
    plan = read_plan(find(PLANS, name), registry.Procedures())
    procedure = registry.procedure(plan.procedure)
    faults = [
        plan.fault(problem.where, problem.what)
        for problem in procedure.check(plan.parameters, bench)
    ]
    if faults:
        raise FaultList(faults)
    return plan


def validate_plans(names: Sequence[str], bench_name: str, *, as_json: bool) -> int:
    """Print every fault of every plan, and return the exit code."""
    faults: list[Fault] = []
    bench = None
    try:
        bench = read_bench_named(bench_name)
    except FaultList as found:
        faults.extend(found.faults)
    for name in names:
        try:
            if bench is None:
                read_plan(find(PLANS, name), registry.Procedures())
            else:
                read_plan_for(name, bench)
        except FaultList as found:
            faults.extend(found.faults)
    if as_json:
        rows = [
            {
                "file": fault.file,
                "line": fault.line,
                "column": fault.column,
                "where": fault.where,
                "what": fault.what,
                "hint": fault.hint,
            }
            for fault in faults
        ]
        print(json.dumps({"valid": not faults, "faults": rows}, indent=1, ensure_ascii=False))
    else:
        for fault in faults:
            print(fault, file=sys.stderr)
        if not faults:
            count = len(names)
            print(f"{count} plan{'s' if count > 1 else ''} without a fault on bench {bench_name}")
    return EXIT_WRONG_INPUT if faults else EXIT_DONE
