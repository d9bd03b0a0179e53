"""What an operating system does to a run, and what is promised then: one entry for each attack.

An attack strikes at a drawn moment of a step. Real seconds: a guardian's deadlines are real, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

GOOD = frozenset({0, 1, 6})
ABORTED, FAULT, TRIPPED, KILLED = 4, 3, 5, -9
ENDED_BY_GUARDIAN = frozenset({KILLED})
OUT_OF_MEMORY = frozenset({FAULT, TRIPPED, KILLED, -6, -11})
OUTAGES_S = {"": 20.0, "-long": 120.0}
"""How long an instrument cannot be reached."""


@dataclass(frozen=True)
class Attack:
    """What is done to a run and what must follow."""

    name: str
    within_s: float | None
    """From the attack to a bench at rest, ramps aside; None where the run goes on to its end."""
    exits: frozenset[int]
    """Also that of a run which is over before it notices, its bench at rest in time."""
    resumes: bool = True
    """What is left opens, can be analysed and goes on."""
    disk: bool = False
    """The run folder lies on a disk of its own."""
    terminal: bool = False
    """The run stands on a terminal."""
    guardian: bool = False
    """The guardian is struck: it is noticed, and there is a new one."""
    may_go_on: bool = False
    """It may also do nothing to the run, which then goes on to its end."""
    outage_s: float = 0.0
    """The instrument that is struck is out of reach for so long."""


def _attacks() -> dict[str, Attack]:
    made = [
        Attack("disk-frozen", 30.0, ENDED_BY_GUARDIAN | {FAULT, TRIPPED} | GOOD, disk=True),
        Attack("folder-removed", 10.0, frozenset({FAULT}), resumes=False),
        Attack("folder-moved", 10.0, frozenset({FAULT})),
        Attack("folder-unmounted", 10.0, frozenset({FAULT}), disk=True),
        Attack("terminal-unread", None, GOOD, terminal=True),
        Attack("terminal-ctrl-s", None, GOOD, terminal=True),
        Attack("terminal-unread-ctrl-c", 10.0, GOOD | {ABORTED}, terminal=True),
        Attack("terminal-unread-sigterm", 10.0, GOOD | {ABORTED}, terminal=True),
        Attack("terminal-unread-abort", 10.0, GOOD | {ABORTED}, terminal=True),
        Attack("runner-stopped", 7.0, ENDED_BY_GUARDIAN),
        Attack("runner-killed", 2.0, ENDED_BY_GUARDIAN),
        Attack("guardian-killed", None, GOOD, guardian=True),
        Attack("guardian-stopped", None, GOOD, guardian=True),
        Attack("guardian-killed-runner-later", 2.0, ENDED_BY_GUARDIAN, guardian=True),
        Attack("guardian-stopped-runner-killed", 60.0, ENDED_BY_GUARDIAN),
        Attack("both-killed", 60.0, ENDED_BY_GUARDIAN),
        Attack("memory-gone", 30.0, OUT_OF_MEMORY | GOOD, may_go_on=True),
    ]
    for suffix, outage_s in OUTAGES_S.items():
        for fault in ("port-gone", "no-reply"):
            at_end = frozenset({FAULT, ABORTED, KILLED})
            within_s = outage_s + 30.0
            made += [
                Attack(f"outage-{fault}-abort{suffix}", within_s, at_end, outage_s=outage_s),
                Attack(
                    f"outage-{fault}-killed{suffix}",
                    within_s,
                    ENDED_BY_GUARDIAN,
                    outage_s=outage_s,
                ),
            ]
    return {one.name: one for one in made}


ATTACKS: Mapping[str, Attack] = _attacks()

SPEEDS: Mapping[str, float] = {
    "rlg-magnetic-sensitivity": 15.0,
    "rlg-magnetic-sensitivity-simultaneous": 25.0,
    "accelerometer-magnetic-sensitivity": 10.0,
    "accelerometer-tumble": 10.0,
    "serf-nonorthogonality": 4.0,
    "fog-scale-factor-temperature": 30.0,
    "nine-axis-calibration": 15.0,
    "nine-axis-calibration-coil": 15.0,
    "commissioning": 4.0,
    "gyro-static-noise": 15.0,
    "gyro-rate-table": 10.0,
    "gyro-static-noise-imu": 15.0,
    "gyro-static-noise-navigator": 15.0,
    "gyro-rate-table-imu": 10.0,
    "gyro-rate-table-navigator": 10.0,
    "gyro-bias-temperature": 60.0,
}
"""How many times faster than real a plan's bench is served: a run takes 10 to 60 s.
The turns of a table can be counted at these speeds on a busy computer, too."""

SHORTER: Mapping[str, tuple[str, ...]] = {
    "fog-scale-factor-temperature": ("parameters.warm_up.at_most=10 min",),
    "serf-nonorthogonality": ("parameters.cell_temperature=null",),
}
"""What bounds the waits of a plan further than its short form: a resumed run may wait in vain for
the temperature at which it was interrupted, and goes on then. The cell of a served bench is warm
already, so that step 1 would be over long before a moment that is drawn of it."""


@dataclass(frozen=True)
class Case:
    """One attack at a drawn moment of one step of a plan's run."""

    plan: str
    attack: Attack
    step: str
    seed: int = 0

    def __str__(self) -> str:
        return f"{self.plan} {self.attack.name} {self.step} {self.seed}"
