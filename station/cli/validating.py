"""`station validate`, and the reading of what `run` is given: plan, bench, served bench."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from station import registry
from station.console import span, tell
from station.errors import EXIT_DONE, EXIT_WRONG_INPUT, InputError
from station.files.faults import MAX_FAULTS, listed, nearest, shortened, shown
from station.files.lookup import BENCHES, PLANS, find, is_missing
from station.files.plan import Plan, read_plan
from station.files.plan.model import LONGEST, MAX_S
from station.files.plan.resolved import resolved_data, resolved_text
from station.files.statements import statements_of_plan
from station.files.yaml.reading import Fault, FaultList
from station.instruments.bench import Bench, read_bench
from station.procedure import Procedures, procedure_of
from station.roles.role import collected
from station.runner.preflight import warned_of_limits, warned_of_memory, warned_of_records
from station.runner.resources import in_bytes, memory_of
from station.runner.static_limits import problems_of_plan
from station.speech import show

SERVED_WRONG = (
    OSError, ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError,
)  # fmt: skip


def read_bench_named(name: str) -> Bench:
    """Return the bench of a path or name; FaultList names each driver that cannot be loaded."""
    for sentence in registry.offers()[1]:
        tell(f"WARNING: {sentence}")
    bench = read_bench(find(BENCHES, name), registry.names(registry.DRIVERS))
    faults = list(cmc_of_nothing(bench))
    wrong = {
        instance: registry.why_not(registry.DRIVERS, entry.driver)
        for instance, entry in bench.instruments.items()
    }
    faults += [
        bench.document.fault(("instruments", instance, "driver"), why)
        for instance, why in wrong.items()
        if why is not None
    ]
    if faults:
        raise FaultList(faults)
    return bench


def cmc_of_nothing(bench: Bench) -> Iterator[Fault]:
    """Yield a fault for each CMC of the bench's laboratory that is of no procedure's result."""
    laboratory = bench.file.laboratory
    if laboratory is None or not laboratory.cmc:
        return
    known = Procedures()
    loaded = [known[name] for name in known if not registry.why_not(registry.PROCEDURES, name)]
    results = dict.fromkeys(result for procedure in loaded for result in procedure.results)
    for name in laboratory.cmc:
        if name not in results:
            hint = nearest(name, results)
            what = f"no procedure has a result '{name}', so no U would be held against this CMC"
            yield bench.document.fault(
                ("laboratory", "cmc", name), what, hint and f"'{hint}'", at_key=True
            )


def read_plan_for(name: str, bench: Bench, overrides: Sequence[str] = ()) -> Plan:
    """Return a plan that can run on the bench; FaultList holds every reason why it cannot."""
    plan = read_plan(find(PLANS, name), Procedures(), overrides)
    procedure = procedure_of(plan.procedure)
    expected_s = procedure.duration(plan.parameters).expected_s
    if not expected_s <= MAX_S:
        what = f"the plan takes {span(expected_s)} of bench time, more than {LONGEST}; divide it"
        raise FaultList([plan.fault(("parameters",), what)])
    faults = [
        plan.fault(problem.where, problem.what)
        for problem in problems_of_plan(procedure, plan.parameters, bench)
    ]
    if not faults:
        memory = memory_of(procedure.forecast(plan.parameters, bench))
        faults += [plan.fault(("parameters",), memory.fault())] if memory.too_small else []
    faults += limits_never_held(plan, procedure.measured_axes(plan.parameters))
    faults += limits_missing(plan, procedure.needs_limits(plan.parameters))
    faults += statements_of_plan(plan.document)
    if faults:
        raise FaultList(faults)
    return plan


def read_served(path: Path) -> dict[str, Any]:
    """Return where a `station sim` in another process serves, from a file with its first line."""
    if is_missing(path):
        raise InputError(f"the path {path} does not exist")
    try:
        head = json.loads(path.read_text(encoding="utf-8").splitlines()[0])
        clock = {name: float(head["clock"][name]) for name in ("speed", "epoch_unix")}
        instruments = {name: {**served} for name, served in head["instruments"].items()}
        all(instrument["address"] for instrument in instruments.values())
        return {**head, "instruments": instruments, "clock": {**head["clock"], **clock}}
    except SERVED_WRONG as error:
        raise InputError(
            f"{path} does not hold the first line of `station sim` ({error}); "
            "start it as `station sim BENCH > FILE`"
        ) from error


def outlook_of(plan: Plan, bench: Bench) -> dict[str, Any]:
    """Return what a plan takes, what it determines, and its warnings.

    It takes `expected_s` of bench time, between `shortest_s` and `longest_s`, and `memory_bytes` of
    this computer for its evaluation.
    """
    procedure = procedure_of(plan.procedure)
    memory = memory_of(procedure.forecast(plan.parameters, bench))
    warned = (
        *warned_of_limits(plan, procedure),
        *warned_of_records(plan, procedure, bench),
        *warned_of_memory(memory),
    )
    return {
        "plan": str(plan.path),
        **procedure.duration(plan.parameters).to_data(),
        "memory_bytes": memory.needed_bytes,
        "determines": list(procedure.outlook(plan.parameters)),
        "warnings": [warning.sentence for warning in warned],
    }


def first_of(faults: Sequence[Fault]) -> list[dict[str, Any]]:
    """Return the first faults as data, and one that counts the others."""
    short = [
        replace(fault, where=shortened(fault.where), what=shortened(fault.what))
        for fault in faults[:MAX_FAULTS]
    ]
    more = len(faults) - MAX_FAULTS
    if more > 0:
        last = faults[MAX_FAULTS]
        short.append(replace(last, where="file", what=f"and {more} more faults", hint=None))
    return [vars(fault) for fault in short]


def limits_never_held(plan: Plan, measured: Mapping[str, tuple[str, ...]]) -> Iterator[Fault]:
    """Yield a fault for each limit of a result, or of its axis, that the plan does not measure."""
    given = plan.document.data.get("limits") or {}
    limited = {name for name, _ in plan.limits}
    for name, axes in measured.items():
        if not axes and name in limited:
            what = "is not measured by this plan; take the limit out, or have the plan measure it"
            yield plan.document.fault(("limits", name), what, at_key=True)
            continue
        for axis in given.get(name) or {}:
            if (name, axis) in plan.limits and axis not in axes:
                what = f"is not measured by this plan; it measures {listed(axes)}"
                yield plan.document.fault(("limits", name, axis), what, at_key=True)


def limits_missing(plan: Plan, needed: Mapping[str, tuple[str, ...]]) -> Iterator[Fault]:
    """Yield a fault for each result that a plan decides about and gives no limit."""
    for name, axes in needed.items():
        without = [axis for axis in axes if (name, axis) not in plan.limits]
        if without:
            what = f"has no limit for {listed(without)}, which an early decision needs"
            yield plan.fault(("limits", name), what)


def validate_plans(
    names: Sequence[str],
    bench_name: str,
    overrides: Sequence[str] = (),
    *,
    resolved: bool = False,
    as_json: bool = False,
) -> int:
    """Print every fault of every plan, and return the exit code.

    `resolved` prints each plan that has no fault with all its values and their origins.
    """
    faults: list[Fault] = []
    plans: list[Plan] = []
    bench = None
    for sentence in collected()[1]:
        tell(f"WARNING: {sentence}")
    try:
        bench = read_bench_named(bench_name)
    except FaultList as error:
        faults.extend(error.faults)
    for name in names:
        try:
            if bench is None:
                plans.append(read_plan(find(PLANS, name), Procedures(), overrides))
            else:
                plans.append(read_plan_for(name, bench, overrides))
        except FaultList as error:
            faults.extend(error.faults)
    # Several plans may share a base, a --set or the bench, and with it a fault.
    faults = list(dict.fromkeys(faults))
    if as_json:
        document: dict[str, Any] = {"valid": not faults, "faults": first_of(faults)}
        if resolved:
            document["resolved"] = [resolved_data(plan) for plan in plans]
        if bench is not None and not faults:
            document["outlook"] = [outlook_of(plan, bench) for plan in plans]
        print(json.dumps(document, indent=1, ensure_ascii=False))
    else:
        for line in shown(faults):
            tell(line)
        if resolved:
            print("---\n".join(resolved_text(plan) for plan in plans), end="")
        if bench is not None and not faults:
            to = tell if resolved else show
            count = len(names)
            if count > 1:
                to(f"{count} plans without a fault on bench {bench_name}")
            else:
                to(f"1 plan without a fault on bench {bench_name}")
            for plan in plans:
                expected = outlook_of(plan, bench)
                takes, memory = span(expected["expected_s"]), in_bytes(expected["memory_bytes"])
                to(f"{plan.path.name}: about {takes} of bench time, {memory} of memory to evaluate")
                for line in expected["determines"]:
                    to(f"  {line}")
                for warning in expected["warnings"]:
                    tell(f"WARNING: {warning}")
    return EXIT_WRONG_INPUT if faults else EXIT_DONE
