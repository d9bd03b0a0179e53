"""A commissioning of some of its parts alone."""

from __future__ import annotations

from typing import Any

from plan_runs import shipped_plan

from procedures.commissioning import PARTS


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
