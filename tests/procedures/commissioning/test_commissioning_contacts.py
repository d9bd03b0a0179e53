"""Contacts: a healthy door passes, each planted fault is named; an open chain ends the run."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from commissioning_parts import plan_of
from fault_cases import read_bench_at
from plan_runs import run_of, shipped_bench
from plants import Plant, named
from plants_contacts import PLANTS
from quick_yaml import dump_yaml

from procedures.commissioning.contacts import is_possible
from procedures.commissioning.contacts.analysis import analyse


def test_a_healthy_door_raises_no_alarm(tmp_path: Path) -> None:
    outcome = run_of(tmp_path, plan_of("contacts"), shipped_bench())
    assert (named(outcome), outcome.exit_code) == (set(), 0)


@pytest.mark.parametrize("plant", PLANTS, ids=lambda one: one.name)
def test_a_planted_fault_is_named_alone(tmp_path: Path, plant: Plant) -> None:
    bench = shipped_bench()
    cause = plant.plant(bench, random.Random(1))
    outcome = run_of(tmp_path, plan_of("contacts"), bench)
    assert named(outcome) == {cause}
    assert outcome.exit_code == 1


def test_a_contact_that_follows_once_is_loose() -> None:
    found = analyse({"closed": "closed", "open": "open", "closed again": "open"})
    assert [flag.code for flag in found.flags] == ["door-contact-loose"]


@pytest.mark.parametrize("contact", ["door", "e-stop"])
def test_a_chain_that_is_open_ends_the_commissioning_by_name(contact: str, tmp_path: Path) -> None:
    bench = shipped_bench()
    fault = {"instrument": "interlock_chain", "fault": "chain-open", "contact": contact}
    bench["simulation"]["faults"] = [{**fault, "at": "0 s", "for": "1 h"}]
    outcome = run_of(tmp_path, plan_of("contacts"), bench)
    assert outcome.exit_code == 5
    assert "the interlock chain tripped" in str(outcome.error)


def test_a_door_that_an_interlock_watches_is_not_opened(tmp_path: Path) -> None:
    bench = shipped_bench()
    when = {"instrument": "thermal_chamber", "quantity": "door", "equals": "open"}
    bench["interlocks"].append({"name": "door", "when": when})
    path = tmp_path / "bench.yaml"
    path.write_text(dump_yaml(bench), encoding="utf-8")
    assert not is_possible(read_bench_at(path))
