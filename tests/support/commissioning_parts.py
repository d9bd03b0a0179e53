"""A commissioning of some of its parts alone."""

from __future__ import annotations

from typing import Any

from plan_runs import shipped_plan
from quick_yaml import load_yaml

from procedures.commissioning import PARTS, PROCEDURE
from station import registry
from station.files.lookup import BENCHES, find
from station.instruments.bench import read_bench

AMBIENT = {"x": "0.021 mT", "y": "-0.004 mT", "z": "-0.043 mT", "standard_uncertainty": "1.5 uT"}
EARTH = {
    "latitude": "39.9 deg",
    "elevation": "90 deg",
    "direction": "0.05 deg",
    "bias": "0.01 deg/h",
}
PULSE_WEIGHT_LIMIT = {"min": 0.995, "max": 1.005}
"""What a plan states of the simulated benches so that signs and pulse weight are decided."""


def left_out(*parts: str) -> list[str]:
    """Return the results of all other parts."""
    return [name for part in PARTS if part.name not in parts for name in part.results]


def only(*parts: str) -> tuple[str, ...]:
    """Return overrides, as of `--set`, by which the shipped plan has these parts alone."""
    without = (f"limits.{name}=null" for name in left_out(*parts))
    return (f"parameters.checks=[{', '.join(parts)}]", *without)


def plan_of(*parts: str) -> dict[str, Any]:
    """Return the shipped plan, of these parts alone, as data."""
    plan = shipped_plan("commissioning")
    plan["parameters"]["checks"] = list(parts)
    others = left_out(*parts)
    plan["limits"] = {name: one for name, one in plan["limits"].items() if name not in others}
    return plan


def whole_plan_of(part: str, bench: str = "sim") -> dict[str, Any]:
    """Return the plan of a part, fitted, with all that an engineer knows of a simulated bench."""
    plan = plan_of(part)
    read = read_bench(find(BENCHES, bench), registry.names(registry.DRIVERS))
    (own,) = (one for one in PARTS if one.name == part)
    for line in own.fits(read):
        _state(plan, line)
    return _with_known(plan)


def bench_plan_of(bench: str) -> dict[str, Any]:
    """Return what `station commission` runs on a shipped bench, with all that is known of it."""
    plan = shipped_plan("commissioning")
    read = read_bench(find(BENCHES, bench), registry.names(registry.DRIVERS))
    for line in PROCEDURE.fits(read, False, {}):
        _state(plan, line)
    return _with_known(plan)


def _with_known(plan: dict[str, Any]) -> dict[str, Any]:
    """State the ambient field, the earth's rate and what they decide, where their parts are."""
    parameters = plan["parameters"]
    if "coils" in parameters["checks"]:
        parameters["ambient"] = AMBIENT
    if "gyro" in parameters["checks"]:
        parameters["earth"] = EARTH
        plan["limits"]["pulse_weight_ratio"] = PULSE_WEIGHT_LIMIT
    return plan


def _state(plan: dict[str, Any], line: str) -> None:
    """Do what `--set` does with a line of `fits`."""
    keys, _, value = line.partition("=")
    *places, last = keys.split(".")
    place = plan
    for key in places:
        place = place.setdefault(key, {})
    if value == "null":
        place.pop(last, None)
    else:
        place[last] = load_yaml(value)
