"""A contact that a person opens by hand, while the bench is verified off, to see that it is read.

The test excuses one open contact, and only as long as everything that can harm reads back as safe.
Any other contact, a quantity that cannot be read, or an instrument that is not off ends the run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from station.roles.interlock_chain import SeesContacts

if TYPE_CHECKING:
    from station.safety.interlocks.reading import Interlock


@dataclass(frozen=True)
class ContactTest:
    """One contact under test.

    opens: the instruments that see it, each to the name that it gives the contact;
    not_off: reads all that can harm and returns what is not verified off, empty where all is.
    """

    opens: Mapping[str, str]
    not_off: Callable[[], str]

    def refuses(self, interlock: Interlock, instruments: Mapping[str, object]) -> str:
        """Return why an interlock that is true is no part of the test; empty where it is.

        Raises InstrumentError where an instrument does not answer.
        """
        for name in sorted(interlock.instruments):
            instrument = instruments.get(name)
            if not isinstance(instrument, SeesContacts):
                return f"{name} does not name its contacts"
            others = [
                contact for contact in instrument.open_contacts() if contact != self.opens.get(name)
            ]
            if others:
                return f"not under test: {', '.join(others)}"
        not_off = self.not_off()
        return f"not off during the test: {not_off}" if not_off else ""
