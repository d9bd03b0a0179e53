"""Every verb of a bench's roles is tried by a commissioning, or the guide says why it is not."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import pytest
from commissioning_parts import bench_plan_of
from places import ROOT
from plan_runs import run_of, shipped_bench

from station import registry
from station.roles import ROLES

GUIDE = ROOT / "docs" / "how-to" / "first-day-on-hardware.md"
PROTOCOLS = {role.name: role.protocol for role in ROLES}


def in_the_guide() -> set[tuple[str, str]]:
    """Return instrument and verb of each that the guide says is not tried."""
    section = GUIDE.read_text(encoding="utf-8").partition("## What no part tries")[2]
    rows = re.findall(r"^\| (`.*?`) \| (`.*?`) \| ", section.partition("\n## ")[0], re.MULTILINE)
    return {
        (name, verb)
        for names, verbs in rows
        for name in re.findall("`(.*?)`", names)
        for verb in re.findall("`(.*?)`", verbs)
    }


def verbs_of(name: str) -> set[str]:
    """Return the verbs of an instrument's role."""
    protocol = PROTOCOLS[name.partition(".")[0]]
    return {
        verb
        for verb in dir(protocol)
        if not verb.startswith("_") and callable(getattr(protocol, verb, None))
    }


@pytest.mark.campaign
def test_every_verb_of_a_role_is_tried_or_in_the_guide(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, plan = shipped_bench(), bench_plan_of("sim")
    plan["parameters"]["lines"]["disconnected"] = ["gaussmeter"]
    called: set[tuple[str, str]] = set()

    def noted(verb: str, method: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(method)
        def call(self: Any, *args: Any, **kwargs: Any) -> Any:
            called.add((self.place.name, verb))
            return method(self, *args, **kwargs)

        return call

    wanted = {(name, verb) for name in bench["instruments"] for verb in verbs_of(name)}
    drivers = {
        registry.load(registry.DRIVERS, entry["driver"]) for entry in bench["instruments"].values()
    }
    for driver in drivers:
        for verb in {verb for _, verb in wanted}:
            if inspect.isfunction(method := inspect.getattr_static(driver, verb, None)):
                monkeypatch.setattr(driver, verb, noted(verb, method))
    assert run_of(tmp_path / "run", plan, bench).exit_code == 0
    assert wanted - called == in_the_guide()
