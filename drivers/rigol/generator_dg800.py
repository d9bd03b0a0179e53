"""Rigol DG812, DG822 or DG832 waveform generator (SCPI, lines end with LF): voltages and steps.

As on other generators at coils a steady voltage is the function DC with an offset, and a step one
cycle of a pulse in a burst; a step downwards is a pulse that is inverted. Each channel has its own
trigger input, `Sync/Ext Mod/Trig/FSK` at the rear: the shutter's trigger goes to both. Settings of
the output are reset before a run, and both outputs are off at its end.

The guide is the DG800 Programming Guide, of which some pages were at hand. Not confirmed: that
several commands and queries share a message, that `FUNC?` answers `DC` and `PULS`, the least
amplitude, that an inverted pulse waits at its high level, that voltage limits are taken while the
output is off, which commands they refuse, and how long `*RST` takes.

Commands and their sources:
    *IDN? - who answers - an answer of a DG822 and of a DG952 in public client code - confirmed
    *CLS, *RST, SYST:ERR? - a known state, the error queue - QCoDeS driver, public notes that quote
        the guide - confirmed
    OUTP1, OUTP1:POL - the output, as ON or OFF - QCoDeS driver, public client code - confirmed
    OUTP1:LOAD - 1 ohm to 10 kohm or INF, an open end as 9.9E+37 - public notes that quote the
        guide; QCoDeS driver as OUTP:IMP - confirmed
    OUTP1:VOLL, OUTP1:VOLL:HIGH, OUTP1:VOLL:LOW - the instrument's own limits - QCoDeS driver -
        not confirmed
    SOUR1:FUNC, SOUR1:VOLT, SOUR1:VOLT:UNIT, SOUR1:VOLT:OFFS - a steady voltage and a pulse -
        public client code of the DG800 - confirmed
    SOUR1:VOLT:HIGH, SOUR1:VOLT:LOW - the levels of a pulse - public client code of Rigol
        generators - not confirmed
    SOUR1:FUNC:PULS:PER, SOUR1:FUNC:PULS:WIDT - the length of a step - guide p.2-79 for the
        subsystem, public client code - confirmed
    SOUR1:BURS:STAT, SOUR1:BURS:MODE, SOUR1:BURS:NCYC - a single step - guide p.2-59, QCoDeS
        driver - confirmed
    SOUR1:BURS:TRIG:SOUR, SOUR1:BURS:TRIG:SLOP, SOUR1:BURS:TDEL - what starts a step, up to 100 s
        before it - QCoDeS driver, public client code - confirmed
    SOUR1:BURS:IDLE - BOTTOM: a pulse waits at its low level - QCoDeS driver - not confirmed
"""

from __future__ import annotations

from typing import ClassVar

from drivers.generic.coil_generator import CoilGenerator
from drivers.generic.coil_generator_messages import ChannelMessages, Wanted
from drivers.transport.exchanges import Repeatable


class RigolDg800(CoilGenerator):
    """Two channels at coils: each holds a voltage, or waits for the trigger of a step.

    Limits: `voltage` V, of either sign.
    """

    recognises: ClassVar[str] = r"^(?i:Rigol Technologies),DG8[123]2,(?P<serial>[^,]+)"
    """Units answer in capitals, too."""
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:ERR\?|OUTP[12](:LOAD|:POL|:VOLL[A-Z:]*)?\?|SOUR[12]:[A-Z:]+\?",
        r"OUTP[12] OFF",
    )
    """Not what arms a burst: sent again after a trigger it would end the step."""
    longest_delay_s: ClassVar[float] = 100.0

    def _messages_of(self, channel: int) -> ChannelMessages:
        return Messages(channel)


class Messages(ChannelMessages):
    """The messages of one channel."""

    on, off = "ON", "OFF"

    def __init__(self, channel: int) -> None:
        super().__init__(channel)
        self.limit = self.limit_switch = f"{self._out}:VOLL"

    def triggered(self, delay_s: float, cycles: int) -> tuple[str, ...]:
        """Return what has a burst of so many pulses begin after each trigger."""
        burst = f"{self._sour}:BURS"
        return (
            f"{burst}:MODE TRIG",
            f"{burst}:NCYC {cycles}",
            f"{burst}:TRIG:SOUR EXT",
            f"{burst}:TRIG:SLOP POS",
            f"{burst}:TDEL {delay_s:.9g}",
            f"{burst}:IDLE BOTTOM",
            f"{burst}:STAT ON",
        )

    def waits(self, delay_s: float) -> Wanted:
        """Return what has to be read of that."""
        return {f"{self._sour}:BURS:TRIG:SOUR?": "EXT", f"{self._sour}:BURS:TDEL?": delay_s}
