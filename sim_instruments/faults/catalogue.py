"""Which faults there are: by protocol on the wire, by simulated instrument otherwise."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from sim_instruments.faults.lasting import EVERYWHERE, Chatter
from sim_instruments.faults.wire import LINES, MODBUS, WIRE_FAULTS


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
    found = [one for one in entry_points(group="station.simulators") if one.name == driver]
    return possible_faults(protocol, found[0].load()) if found else []
