"""What an operating system does to a run ends with a safe bench: a covering part of the campaign.

Another procedure and step for each attack. `benchmarks/standstill_campaign.py` does the whole.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

if sys.platform != "linux":
    pytest.skip("signals, terminals and disks of Linux", allow_module_level=True)

from campaigns.faults import plans, steps
from campaigns.standstill.attacks import ATTACKERS, Scene, strike
from campaigns.standstill.cases import ATTACKS, SPEEDS, Case
from campaigns.standstill.oracle import Observed, attack, reference_of, steps_were_done
from user_space_disk import why_not

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


@pytest.mark.campaign
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


@dataclass
class Signalled(Scene):
    """A scene in which nobody is hurt."""

    signals: tuple[tuple[int, signal.Signals], ...] = ()

    def signal(self, pid: int, number: signal.Signals) -> None:
        self.signals += ((pid, number),)


def test_a_guardian_that_came_before_the_run_is_killed_is_seen() -> None:
    guardians = iter([[11, 12], [11], [11, 13], [11]])
    run: Any = SimpleNamespace(
        guardians=lambda: next(guardians), alive=True, process=SimpleNamespace(pid=10)
    )
    rng: Any = SimpleNamespace(integers=lambda _: 1, uniform=np.minimum)
    scene = Signalled(run, None, None, rng, [], 0.0, [])  # type: ignore[arg-type]
    strike("guardian-killed-runner-later", scene)
    assert scene.signals == ((12, signal.SIGKILL), (10, signal.SIGKILL))
    assert scene.has_new_guardian()
    assert scene.to_guardian_s is not None


def test_steps_that_were_done_before_an_abort_are_distinguished() -> None:
    events = [
        {"event": "run-started", "t_s": 0.0, "steps": [{}, {}]},
        {"event": "step-finished", "t_s": 4.0},
        {"event": "step-finished", "t_s": 9.0},
    ]
    bench: Any = SimpleNamespace(bench_s=lambda unix_s: unix_s)
    run: Any = SimpleNamespace(events=lambda: events)
    rng: Any = None
    assert steps_were_done(Scene(run, bench, None, rng, [], 0.0, [], struck_s=10.0))
    assert not steps_were_done(Scene(run, bench, None, rng, [], 0.0, [], struck_s=8.0))
    del events[-1]
    assert not steps_were_done(Scene(run, bench, None, rng, [], 0.0, [], struck_s=10.0))
