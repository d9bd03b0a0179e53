"""Whatever fault strikes wherever: the world ends safe, the operator is told, the data are there.

A covering part of the campaign: every kind of fault, every role with some of them, and every
third step of every procedure. `benchmarks/fault_campaign.py` does the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from campaigns.faults import (
    FIRST,
    LASTING,
    MIDDLE,
    Case,
    Reference,
    all_cases,
    judged,
    plans,
    reference_run,
    roles_and_kinds,
    steps,
)
from campaigns.truths import TRUTHS

from sim_instruments.faults.catalogue import applicable_faults
from sim_instruments.faults.lasting import LASTING_FAULTS
from sim_instruments.faults.wire import WIRE_FAULTS

PLANS = plans()

IN_PLANS: dict[tuple[str, str], list[str]] = {}
for _plan in PLANS:
    for _pair in roles_and_kinds(_plan):
        IN_PLANS.setdefault(_pair, []).append(_plan)
ONE_IN = 37
"""Of the faults of a wire, that every role can have, a role gets one in so many here."""


def chosen() -> list[tuple[str, str]]:
    """Return the pairs of a role and a kind that are tried: another share of the kinds a role."""
    roles = list(dict.fromkeys(role for role, _ in IN_PLANS))
    kinds = list(WIRE_FAULTS)
    return [
        (role, kind)
        for role, kind in IN_PLANS
        if kind not in kinds or (roles.index(role) + kinds.index(kind)) % ONE_IN == 0
    ]


KINDS = [
    (IN_PLANS[pair][number % len(IN_PLANS[pair])], *pair) for number, pair in enumerate(chosen())
]
ONE_IN_QUICK = 20
"""Of the cases, so many are with the quick tests."""
STEPS = [(plan, step) for plan in PLANS if plan in TRUTHS for step in steps(plan)][::3]
"""Every third step; the other faults of this module strike in many of the others."""
STRIDE = 7
"""Steps through the cases of a kind so that neighbours get other steps and placements."""
Referred = Callable[[str], Reference]

ALTERNATE, ONE_PLAN = "sim-alternate", "rlg-magnetic-sensitivity"
ONE_IN_ALTERNATE = 31
ON_ALTERNATE = [
    (role, kind)
    for number, (role, kind) in enumerate(roles_and_kinds(ONE_PLAN, ALTERNATE))
    if role != "interlock_chain" and number % ONE_IN_ALTERNATE == 0
]


@pytest.fixture(scope="session")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Referred:
    """Return the run without faults of a plan, made once."""
    made: dict[str, Reference] = {}

    def of(plan: str) -> Reference:
        if plan not in made:
            made[plan] = reference_run(plan, tmp_path_factory.mktemp("reference"))
        return made[plan]

    return of


@pytest.mark.parametrize(
    ("plan", "role", "kind"),
    [
        pytest.param(
            *case, id=" ".join(case), marks=[pytest.mark.campaign] * bool(number % ONE_IN_QUICK)
        )
        for number, case in enumerate(KINDS)
    ],
)
def test_every_kind_of_fault_ends_in_order(
    plan: str, role: str, kind: str, reference: Referred, tmp_path: Path
) -> None:
    ran = reference(plan)
    possible = [
        (case, entry)
        for case, entry in all_cases(plan, ran)
        if case.role == role and case.kind == kind
    ]
    assert possible, "no message of the run can have this fault"
    case, entry = possible[STRIDE * KINDS.index((plan, role, kind)) % len(possible)]
    verdict = judged(case, entry, ran, tmp_path / "case")
    assert not verdict.violations, (str(case), entry, verdict)


@pytest.fixture(scope="session")
def alternate(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    """Return the run without faults on the bench with second models."""
    return reference_run(ONE_PLAN, tmp_path_factory.mktemp("alternate"), ALTERNATE)


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("role", "kind"), ON_ALTERNATE, ids=[" ".join(one) for one in ON_ALTERNATE]
)
def test_a_fault_of_a_second_model_ends_in_order(
    role: str, kind: str, alternate: Reference, tmp_path: Path
) -> None:
    possible = [
        (case, entry)
        for case, entry in all_cases(ONE_PLAN, alternate)
        if case.role == role and case.kind == kind
    ]
    assert possible, "no message of the run can have this fault"
    case, entry = possible[STRIDE * ON_ALTERNATE.index((role, kind)) % len(possible)]
    verdict = judged(case, entry, alternate, tmp_path / "case")
    assert not verdict.violations, (str(case), entry, verdict)


ON_NO_SHIPPED_BENCH = {"device-shorted"}
"""Of a supply for the device, tried in its own tests."""


def test_every_kind_of_fault_that_there_is_is_in_the_campaign() -> None:
    tried = {kind for _, kind in IN_PLANS} | ON_NO_SHIPPED_BENCH
    assert {*WIRE_FAULTS, *LASTING_FAULTS} == tried


@pytest.mark.campaign
@pytest.mark.parametrize(("plan", "step"), STEPS, ids=[" ".join(one) for one in STEPS])
def test_a_fault_in_any_step_ends_in_order(
    plan: str, step: str, reference: Referred, tmp_path: Path
) -> None:
    ran = reference(plan)
    kinds = [
        (name, kind)
        for name, (protocol, driver) in ran.instruments.items()
        for kind in ("no-reply", "garbled")
        if kind in applicable_faults(protocol, driver)
    ]
    places = [
        (case, entry)
        for name, kind in kinds
        for placement in (FIRST, LASTING, MIDDLE)
        if (entry := ran.entry(case := Case(plan, name, kind, step, placement))) is not None
    ]
    case, entry = places[STRIDE * STEPS.index((plan, step)) % len(places)]
    verdict = judged(case, entry, ran, tmp_path / "case")
    assert not verdict.violations, (str(case), entry, verdict)


@pytest.mark.campaign
@pytest.mark.parametrize("plan", PLANS)
def test_a_run_without_a_fault_breaks_no_promise(
    plan: str, reference: Referred, tmp_path: Path
) -> None:
    ran = reference(plan)
    # A fault that never comes: the oracle finds nothing where nothing happens.
    name = next(iter(ran.instruments))
    entry = {"instrument": name, "fault": "port-gone", "at": "1000 h"}
    verdict = judged(Case(plan, name, "port-gone", "S1", "never"), entry, ran, tmp_path / "case")
    assert not verdict.struck
    assert verdict.exit_code == ran.outcome.exit_code
    assert not verdict.violations


def test_every_procedure_in_the_campaign_says_what_is_true() -> None:
    from short_forms import BENCH, read_bench_at, short

    from station.files.lookup import BENCHES, find

    bench = read_bench_at(find(BENCHES, BENCH))
    procedures = {short(plan, bench).procedure for plan in PLANS}
    assert procedures <= set(TRUTHS), "give the truth of the new procedure in fault_oracle.TRUTHS"
