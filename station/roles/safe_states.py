"""How each role is made safe, and what proves it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class SafeState:
    """What `make_safe` brings an instrument of a role to, and what `read_safety` reads to prove it.

    Where several orders are thinkable the order of the words is that in which it is done.
    """

    brought_to: str
    proven_by: str


SAFE_STATES: Mapping[str, SafeState] = {
    "coil_supply": SafeState(
        "current ramped to zero within the slew limit, then the output off",
        "output off, no list running, measured current below zero_current",
    ),
    "rotary_stage": SafeState(
        "decelerated to rest; the motor stays on and holds a load that may be out of balance",
        "motion done, and two readings of the encoder that agree",
    ),
    "turntable": SafeState(
        "every axis decelerated to rest within its acceleration limit",
        "the measured rate of every axis",
    ),
    "thermal_chamber": SafeState(
        "heater and compressor off", "control mode off, and no power at the output"
    ),
    "signal_generator": SafeState("both outputs off", "the output state of both channels"),
    "digitizer": SafeState("the trigger output at rest", "the state of the output pin"),
    "pump_laser": SafeState("the shutter closed", "the blade's own sensor"),
}
"""By role. A role without an entry cannot harm."""
