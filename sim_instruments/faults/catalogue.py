"""The faults there are, by protocol and by instrument, and an entry of `simulation.faults` read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any

import numpy as np

from sim_instruments.faults.lasting import EVERYWHERE, LASTING_FAULTS, Chatter, LastingFault
from sim_instruments.faults.trigger import (
    Matcher,
    Trigger,
    any_message,
    frame_named,
    text_within,
)
from sim_instruments.faults.wire import CAN, LINES, MODBUS, WIRE_FAULTS, WireFault
from sim_instruments.truth import SimulationError, Truth


def wire_faults(protocol: str) -> list[str]:
    """Return the faults that a wire of this protocol can have."""
    return [kind for kind, fault in WIRE_FAULTS.items() if protocol in fault.protocols]


def possible_faults(protocol: str, simulator: Any) -> list[str]:
    """Return the faults of a simulated instrument; its class names its own `lasting_faults`."""
    everywhere = (*EVERYWHERE, Chatter.kind) if protocol in LINES | MODBUS else EVERYWHERE
    return [*wire_faults(protocol), *everywhere, *getattr(simulator, "lasting_faults", ())]


def applicable_faults(protocol: str, driver: str) -> list[str]:
    """Return every fault that the instrument of a driver can have, in a fixed order.

    `protocol` is the one that `station sim` prints for it. Instruments without a simulator have
    none. Each kind can be injected with its options left out.
    """
    simulators = [
        entry_point
        for entry_point in entry_points(group="station.simulators")
        if entry_point.name == driver
    ]
    return possible_faults(protocol, simulators[0].load()) if simulators else []


WHEN = ("at", "for", "command", "nth")
LARGEST_IDENTIFIER = 0x1FFFFFFF


def read_fault(
    entry: Mapping[str, Any],
    truth: Truth,
    protocol: str,
    possible: list[str],
    now_s: float,
    rng: np.random.Generator,
) -> tuple[WireFault | LastingFault, bool]:
    """Return the fault that an entry describes, and whether it waits for a message to begin.

    `possible` are the kinds that the instrument, which speaks `protocol`, can have. Without `at`
    and `command` the fault begins at `now_s`. Raises SimulationError with one sentence.
    """
    kind = truth.text("fault")
    if kind not in possible:
        raise SimulationError(
            f"{truth.where}.fault: {truth.text('instrument')} cannot have the fault '{kind}' "
            f"(it can have: {', '.join(possible)})"
        )
    on_wire = WIRE_FAULTS.get(kind)
    lasting = LASTING_FAULTS.get(kind)
    options = on_wire.options if on_wire else lasting.options if lasting else ()
    keys = ("instrument", "fault", *WHEN, *(("count",) if on_wire else ()), *options)
    for key in entry:
        if key not in keys:
            raise SimulationError(
                f"{truth.where}: the fault '{kind}' has no key '{key}' (keys: {', '.join(keys)})"
            )
    at_message = "command" in truth or "nth" in truth
    for_s = positive(truth, "for") if "for" in truth else math.inf
    at_s = truth.quantity("at", "s", now_s)
    if at_s < 0:
        raise SimulationError(f"{truth.where}.at: bench time begins at 0 s, got {entry['at']!r}")
    # Once, unless a time or a number was given.
    once = 1.0 if lasting or "for" not in truth else math.inf
    trigger = Trigger(
        matcher(truth, protocol),
        at_s,
        for_s,
        truth.integer("nth", 1, 1),
        truth.integer("count", 1) if "count" in truth else once,
        opens=at_message and ("at" not in truth or lasting is not None),
    )
    if on_wire:
        return on_wire(trigger, rng, truth), at_message
    assert lasting is not None
    return lasting(trigger, truth), at_message


def matcher(truth: Truth, protocol: str) -> Matcher:
    """Return what the `command` of an entry means on a protocol; without one everything counts."""
    if "command" not in truth:
        return any_message
    if protocol not in CAN:
        text = truth.text("command").strip()
        if not text:
            raise SimulationError(f"{truth.where}.command: a text was expected, got nothing")
        return text_within(text)
    given = truth.raw("command")
    try:
        identifier = given if isinstance(given, int) else int(truth.text("command"), 16)
    except ValueError:
        identifier = -1
    if isinstance(given, bool) or not 0 <= identifier <= LARGEST_IDENTIFIER:
        raise SimulationError(
            f"{truth.where}.command: a CAN identifier such as 0x121 was expected, got {given!r}"
        )
    return frame_named(identifier)


def positive(truth: Truth, key: str) -> float:
    """Return a time above zero in s."""
    value = truth.quantity(key, "s")
    if value <= 0:
        raise SimulationError(f"{truth.where}.{key}: must be positive, got {truth.raw(key)!r}")
    return value
