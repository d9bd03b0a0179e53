"""The hard-wired interlock chain, and whatever sees its contacts."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from station.roles.base import Instrument
from station.roles.role import CONTACT, Role


@runtime_checkable
class SeesContacts(Protocol):
    """An instrument of another role whose controller sees contacts of the interlock chain."""

    def open_contacts(self) -> tuple[str, ...]:
        """Return the names of the contacts that are open, none where all are closed."""
        ...


@runtime_checkable
class InterlockChain(Instrument, Protocol):
    """The hard-wired chain of emergency stops, doors and limit switches, as it can be read."""

    def is_closed(self) -> bool:
        """Whether the chain is closed, so that the bench may be energised."""
        ...


INTERLOCK_CHAIN = Role("interlock_chain", InterlockChain, quantities={"chain": CONTACT})
