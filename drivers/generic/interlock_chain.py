"""The hard-wired interlock chain: by a reader with a line of its own, or by other instruments.

The chain is wired by the laboratory: emergency stops, doors and limit switches in series, which
cut the power by themselves. A reader looks at each contact and answers; it can open and close
nothing. It speaks lines of text over TCP, our own small protocol; requests and answers end with LF:

| request | answer |
|---|---|
| `*IDN?` | maker, `interlock chain reader`, serial number, firmware, with commas between |
| `CHAIN?` | `CLOSED`, or `OPEN` when any contact is open |
| `CHAIN:LIST?` | the names of the open contacts with commas between, `NONE` when none is |
| `SYST:ERR?` | `0,"No error"`, or the oldest error: number, text |

A request that it does not know is not answered and leaves `-113` there. The answer is the state at
that moment; nothing is latched. A microcontroller with a network socket and a few inputs is enough
to build one. No maker sells it: it was tried against the simulated one only.

A motion controller has an interlock of its own, a chamber's controller an input for the door,
alarms and limits; most of them take one client. So the shared chain has no line: `shares` in the
bench file names the instruments, and each is asked through its own driver, between any two
exchanges.

| instrument | its contacts |
|---|---|
| ACUTROL3000 | `interlock`: what the manuals call a hardware abort, in the state of any axis |
| Ideal Aerosmith | `motor 1`: of an axis that was homed, off by a stop, the panel or a trip |
| Watlow F4T | `door`: the input of `settings.door`; each alarm that is on, limit that tripped |
| Watlow F4 | `door`: the input of `settings.door`; each alarm that is on, its sensor's error |
"""

from __future__ import annotations

from contextlib import suppress
from typing import ClassVar

from pydantic import Field

from drivers.transport.exchanges import Repeatable, shortened
from drivers.transport.text_line import ScpiDriver, VisaSettings
from station.errors import InstrumentError
from station.roles import Driver, Identity, Place, Shares, quantity
from station.roles.interlock_chain import SeesContacts
from station.roles.patience import patience

STATES = {"CLOSED": "closed", "OPEN": "open"}


class InterlockChainLine(ScpiDriver):
    """The interlock chain as a reader with the protocol of this file sees it.

    Commands and their sources:
        *IDN?, CHAIN?, CHAIN:LIST?, SYST:ERR? - a reader of contacts - the protocol in the docstring
            of its module - confirmed
    """

    class Settings(VisaSettings):
        """What the reader does not list while they are closed, and its line."""

        contacts: tuple[str, ...] = Field(
            (), description="the reader's names of contacts that a commissioning has opened by hand"
        )

    recognises: ClassVar[str] = r"^[^,]*,interlock chain reader,(?P<serial>[^,]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(r"\*IDN\?|CHAIN\?|CHAIN:LIST\?")

    def is_closed(self) -> bool:
        """Whether the chain is closed, so that the bench may be energised."""
        return self._state() == "closed"

    def open_contacts(self) -> tuple[str, ...]:
        """Return the names of the contacts that are open."""
        answer = self._line.query("CHAIN:LIST?").strip()
        names = tuple(name.strip() for name in answer.split(",") if name.strip())
        return () if names == ("NONE",) else names

    def explain(self, quantity: str) -> str:
        """Say which contacts are open, for the sentence about a trip; nothing when none is."""
        with suppress(InstrumentError):
            contacts = self.open_contacts()
            return f"open: {', '.join(contacts)}" if contacts else ""
        return ""

    @quantity("chain")
    @patience()
    def _state(self) -> str:
        answer = self._line.query("CHAIN?").strip()
        state = STATES.get(answer)
        if state is None:
            raise self.error(
                "asked for the state of the chain",
                f"{shortened(answer)!r} came back where CLOSED or OPEN belongs",
                "check the reader of the chain and its cable; until then the chain counts as open",
            )
        return state


class SharedInterlockChain(Driver):
    """Contacts of several instruments in series: open where one of them has one open.

    Needs `shares: [turntable, thermal_chamber]`, or one of them, beside `driver` in the bench file.

    Commands and their sources:
        nothing of its own - the drivers of its `shares` ask for their contacts - the rows of
            acutrol-3000, ideal-aerosmith, watlow-f4t and watlow-f4 - not confirmed
    """

    shares: ClassVar[Shares] = Shares(
        SeesContacts,
        "sees no contact of the chain",
        "write shares: [turntable], shares: [thermal_chamber], or both",
        needed=True,
    )

    def __init__(self, place: Place) -> None:
        self.place = place
        self._open: tuple[str, ...] = ()
        self.shares.need(place)

    def identify(self) -> Identity:
        """Return whose contacts these are; there is no line to ask."""
        return Identity("", f"contacts of {' and '.join(self.place.shared)}", "", "")

    @quantity("chain", states=("closed", "open"))
    def is_closed(self) -> bool:
        """Whether every contact is closed, so that the bench may be energised."""
        return not self.open_contacts()

    def open_contacts(self) -> tuple[str, ...]:
        """Ask every instrument and return the contacts that are open, each with its instrument."""
        self._open = tuple(
            f"{name} {contact}"
            for name, instrument in self.place.shared.items()
            for contact in instrument.open_contacts()
        )
        self.place.publish("chain", "open" if self._open else "closed")
        return self._open

    def explain(self, quantity: str) -> str:
        """Say which contacts were open when they were last asked."""
        return f"open: {', '.join(self._open)}" if self._open else ""

    def close(self) -> None:
        """Do nothing: the lines are those of other instruments."""
