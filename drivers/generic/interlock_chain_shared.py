"""The interlock chain as other instruments of the bench see it, over the lines that they have.

A motion controller has an interlock of its own, a chamber's controller an input for the door,
alarms and limits; most of them take one client. So this driver has no line: `shares` in the bench
file names the instruments, and each is asked through its own driver, between any two exchanges.

| instrument | its contacts |
|---|---|
| ACUTROL3000 | `interlock`: what the manuals call a hardware abort, in the state of any axis |
| Watlow F4T | `door`: the input of `settings.door`; each alarm that is on, limit that tripped |
| Watlow F4 | `door`: the input of `settings.door`; each alarm that is on, an error of its sensor |
"""

from __future__ import annotations

from typing import ClassVar

from station.errors import InstrumentError
from station.roles import Driver, Identity, Place
from station.roles.station import SeesContacts


class SharedInterlockChain(Driver):
    """Contacts of several instruments in series: open where one of them has one open.

    Needs `shares: [turntable, thermal_chamber]`, or one of them, beside `driver` in the bench file.
    """

    def __init__(self, place: Place) -> None:
        self.place = place
        self._open: tuple[str, ...] = ()
        blind = [name for name, one in place.shared.items() if not isinstance(one, SeesContacts)]
        if blind or not place.shared:
            what = f"{', '.join(blind)} sees none" if blind else "it gives no shares"
            raise InstrumentError(
                place.name,
                "read in the bench file whose contacts make the chain",
                what,
                "write shares: [turntable], shares: [thermal_chamber], or both",
            )

    def identify(self) -> Identity:
        """Return whose contacts these are; there is no line to ask."""
        return Identity("", f"contacts of {' and '.join(self.place.shared)}", "", "")

    def is_closed(self) -> bool:
        """Whether every contact is closed, so that the bench may be energised."""
        return not self.open_contacts()

    def open_contacts(self) -> tuple[str, ...]:
        """Ask every instrument and return the contacts that are open, each with its instrument."""
        self._open = tuple(
            f"{name} {contact}"
            for name, one in self.place.shared.items()
            for contact in one.open_contacts()
        )
        self.place.publish("chain", "open" if self._open else "closed")
        return self._open

    quantities: ClassVar = {"chain": lambda self: "closed" if self.is_closed() else "open"}

    def explain(self, quantity: str) -> str:
        """Say which contacts were open when they were last asked."""
        return f"open: {', '.join(self._open)}" if self._open else ""

    def close(self) -> None:
        """Do nothing: the lines are those of other instruments."""
