"""What an operating system does to a run ends with a safe bench: a covering part of the campaign.

Another procedure and step for each attack. `benchmarks/standstill_campaign.py` does the whole.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

if sys.platform != "linux":
    pytest.skip("signals, terminals and disks of Linux", allow_module_level=True)

from fault_cases import plans, steps
from loop_disk import why_not
from standstill_attacks import ATTACKERS
from standstill_cases import ATTACKS, SPEEDS, Case
from standstill_oracle import Observed, attack, reference_of

GYRO, CELL, ACCELEROMETER = (
    "rlg-magnetic-sensitivity",
    "serf-nonorthogonality",
    "accelerometer-magnetic-sensitivity",
)
CASES = [
    Case(GYRO, ATTACKS["disk-frozen"], "S4"),
    Case(CELL, ATTACKS["both-killed"], "2"),
    Case(GYRO, ATTACKS["terminal-unread-sigterm"], "S4"),
    Case(ACCELEROMETER, ATTACKS["guardian-stopped-runner-killed"], "(3)"),
    Case(CELL, ATTACKS["guardian-killed"], "2"),
    Case(GYRO, ATTACKS["folder-moved"], "S4"),
]
AT_ONCE = 3
"""Most of a case is waiting."""
TRIES = 3
"""On a busy computer a run may be over before it is attacked."""


@dataclass
class Runner:
    """Makes the attacks in the background, all of them on benches of their own."""

    pool: ThreadPoolExecutor
    made: dict[str, Future[Observed]]

    def seen(self, case: Case) -> Observed:
        """Return what became of a case."""
        return self.made[str(case)].result()


def attacked(case: Case, folder: Path) -> Observed:
    """Attack a run, another one where it was over by then."""
    for seed in range(TRIES):
        seen = attack(replace(case, seed=seed), folder / str(seed), resume=False)
        if seen.struck:
            break
    return seen


@pytest.fixture(scope="module")
def attacks(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runner]:
    wanted = [case for case in CASES if not case.attack.disk or why_not() is None]
    for plan in {case.plan for case in wanted}:
        reference_of(plan)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        folder = tmp_path_factory.mktemp("attacks")
        yield Runner(
            pool,
            {
                str(case): pool.submit(attacked, case, folder / str(number))
                for number, case in enumerate(wanted)
            },
        )


@pytest.mark.parametrize("case", CASES, ids=str)
def test_an_attack_of_the_operating_system_breaks_no_promise(case: Case, attacks: Runner) -> None:
    if case.attack.disk and (reason := why_not()) is not None:
        pytest.skip(reason)
    seen = attacks.seen(case)
    assert seen.struck, seen
    assert not seen.broken, seen


def test_every_attack_can_be_made_in_every_plan_and_step() -> None:
    named = {one for one in ATTACKS if not one.startswith(("terminal-", "outage-"))}
    assert named == set(ATTACKERS)
    assert set(plans()) <= set(SPEEDS), "say how fast the bench of a new plan is served"
    assert all(steps(plan) for plan in plans())
