"""Contacts: a healthy door passes, one that follows once is loose; an open chain ends the run."""

from __future__ import annotations

from pathlib import Path

import pytest
from campaigns.planted.commissioning import named
from commissioning_parts import whole_plan_of
from plan_runs import run_of, shipped_bench
from quick_yaml import dump_yaml
from short_forms import read_bench_at

from procedures.commissioning import PROCEDURE
from procedures.commissioning.contacts import analyse_door, door_is_free
from procedures.commissioning.parameters import CommissioningParameters
from station.record.folder import RunFolder


@pytest.mark.parametrize("bench", ["sim", "sim-alternate"])
def test_healthy_contacts_raise_no_alarm(bench: str, tmp_path: Path) -> None:
    outcome = run_of(tmp_path, whole_plan_of("contacts", bench), shipped_bench(bench))
    assert (named(outcome), outcome.exit_code) == (set(), 0)
    tested = [
        one.details["contact"]
        for one in RunFolder(outcome.folder).events_of("contact-test-finished")
    ]
    assert tested == {"sim": ["e-stop", "door"], "sim-alternate": ["thermal_chamber door"]}[bench]


def test_a_contact_that_follows_once_is_loose() -> None:
    _, flags = analyse_door({"closed": "closed", "open": "open", "closed again": "open"})
    assert [flag.code for flag in flags] == ["door-contact-loose"]


@pytest.mark.parametrize("contact", ["door", "e-stop"])
def test_a_chain_that_is_open_ends_the_commissioning_by_name(contact: str, tmp_path: Path) -> None:
    bench = shipped_bench()
    fault = {"instrument": "interlock_chain", "fault": "chain-open", "contact": contact}
    bench["simulation"]["faults"] = [{**fault, "at": "0 s", "for": "1 h"}]
    outcome = run_of(tmp_path, whole_plan_of("contacts"), bench)
    assert outcome.exit_code == 5
    assert "the interlock chain tripped" in str(outcome.error)


def test_a_door_that_an_interlock_watches_is_not_opened(tmp_path: Path) -> None:
    bench = shipped_bench()
    when = {"instrument": "thermal_chamber", "quantity": "door", "equals": "open"}
    bench["interlocks"].append({"name": "door", "when": when})
    path = tmp_path / "bench.yaml"
    path.write_text(dump_yaml(bench), encoding="utf-8")
    assert not door_is_free(read_bench_at(path))


def test_a_plan_without_contacts_of_its_own_opens_none() -> None:
    parameters = CommissioningParameters(checks=("contacts",))
    assert [one.id for one in PROCEDURE.walk(parameters).prompts] == [
        "close-door",
        "open-door",
        "close-door-again",
    ]


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        ("door", "not under test: door"),
        # It opened by hand, and stays open.
        ("e-stop", "interlock_chain chain is open (open: e-stop)"),
    ],
)
def test_a_contact_that_is_open_beside_or_after_the_test_ends_the_run_by_name(
    contact: str, said: str, tmp_path: Path
) -> None:
    bench, plan = shipped_bench(), whole_plan_of("contacts")
    plan["parameters"]["contacts"] = {"door": False, "chain": ["e-stop"], "settle": "20 s"}
    del plan["limits"]["door_contact_errors"]
    fault = {"instrument": "interlock_chain", "fault": "chain-open", "contact": contact}
    bench["simulation"]["faults"] = [{**fault, "at": "10 s", "for": "1 h"}]
    outcome = run_of(tmp_path, plan, bench)
    assert outcome.exit_code == 5
    assert said in str(outcome.error)
    kinds = [one.kind for one in RunFolder(outcome.folder).events]
    assert "contact-test-started" in kinds
    assert "contact-test-finished" not in kinds
