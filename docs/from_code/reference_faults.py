"""The faults of the simulated bench, from the classes that make them."""

from __future__ import annotations

from tables import code, first_sentence, table

from sim_instruments.faults.catalogue import applicable_faults
from sim_instruments.faults.lasting import EVERYWHERE, LASTING_FAULTS
from sim_instruments.faults.wire import WIRE_FAULTS
from station import registry

PROTOCOL = "none"
"""A wire without faults of its own: what is left are the states of an instrument."""


def faults() -> str:
    """Return every kind of fault: on which protocols or instruments, and what it does."""
    rows = [
        (
            code(kind),
            ", ".join(sorted(fault.protocols)),
            options(fault),
            first_sentence(fault.__doc__),
        )
        for kind, fault in WIRE_FAULTS.items()
    ]
    having: dict[str, list[str]] = {}
    for driver in registry.own_names(registry.SIMULATORS):
        if driver != registry.SIMULATED_BENCH:
            for kind in applicable_faults(PROTOCOL, driver):
                having.setdefault(kind, []).append(code(driver))
    rows += [
        (
            code(kind),
            "every instrument" if kind in EVERYWHERE else ", ".join(having.get(kind, ())),
            options(fault),
            first_sentence(fault.__doc__),
        )
        for kind, fault in LASTING_FAULTS.items()
    ]
    return table(("fault", "protocols, or instruments by driver", "options", "what it does"), rows)


def options(fault: type) -> str:
    """Return the keys that an entry of this kind may have beside when it strikes."""
    return ", ".join(code(name) for name in getattr(fault, "options", ()))
