"""A reader of a hard-wired interlock chain: emergency stop and door in series, asked by lines.

`*IDN?`, `CHAIN?` (CLOSED or OPEN), `CHAIN:LIST?` (the open contacts, or NONE) and the error queue
of SCPI. A contact opens by a person's hand, or by the fault `chain-open`, at a time, at a message,
or while the bench is served. The contact `bridged` reads closed whatever its switch does.
"""

from __future__ import annotations

from typing import ClassVar

from sim_instruments.faults.lasting import CONTACTS, ChainOpen
from sim_instruments.instrument import Setting
from sim_instruments.wire.scpi_device import ScpiDevice
from sim_instruments.world.contacts import HandContacts

FIRMWARE = "1.0"


class InterlockChain(ScpiDevice):
    """The chain of the simulated laboratory: closed unless a fault opens a contact."""

    model = "interlock chain reader"

    lasting_faults: ClassVar = (ChainOpen.kind,)

    def __init__(self, setting: Setting) -> None:
        super().__init__(f"house-made,interlock chain reader,{setting.serial},{FIRMWARE}")
        self._clock = setting.clock
        self._faults = setting.faults
        self._by_hand = setting.world.find(HandContacts) or HandContacts()
        self._bridged = setting.truth.text("bridged", "")
        self.add_commands(
            {
                "CHAIN?": lambda: "OPEN" if self._open() else "CLOSED",
                "CHAIN:LIST?": lambda: ",".join(self._open()) or "NONE",
            }
        )
        self.begin_to_serve(setting)

    def _open(self) -> list[str]:
        now_s = self._clock.now()
        opened = {
            fault.contact
            for fault in self._faults.all
            if isinstance(fault, ChainOpen) and fault.lasts(now_s)
        }
        opened |= self._by_hand.open
        return [name for name in CONTACTS if name in opened and name != self._bridged]
