"""Keysight 33522B waveform generator (SCPI over TCP, lines end with LF): steady voltages and steps.

A steady voltage is the function DC with an offset. DC has no burst, so a step is one cycle of a
pulse: its low level is what the channel held, its high one what it is to be, the width is the
duration; for a step downwards the output is inverted, which mirrors the pulse about its offset. The
burst waits for the rising edge at the connector Ext Trig, which both channels share, or for `*TRG`.
Functions are changed with the output off, for nothing that is neither the one nor the other is to
reach the coil. Any level is read back; one that the instrument has changed is switched off.

Sources: 33500 series guide for the series resistance of 50 ohm and its termination setting, which
cannot be changed while voltage limits are on, for pulse widths, for triggered bursts and their
sources, and for levels that are clipped with an error; public client code for the headers,
`+0,"No error"`, and 9.9E+37 for an open end; guides of older models of the family for the limit of
|offset| + Vpp/2. Not confirmed in a primary source: port 5025, that a burst of pulses waits at the
low level, that an inverted one waits at the high level, how long `*RST` takes, and the 105 ns from
trigger to output. Units answer as Agilent or Keysight Technologies (guide, p.172).

Commands and their sources:
    *IDN?, *CLS, *RST, SYST:ERR? - who answers, a known state, the error queue of 20, judged by its
        number - 33500 series guide p.165 and 172 - confirmed
    OUTP, OUTP:LOAD, OUTP:POL - the output - 33500 series guide p.84 - confirmed
    SOUR:FUNC, SOUR:VOLT, SOUR:VOLT:OFFS - a steady voltage and a pulse - 33500 series guide p.84 -
        confirmed
    SOUR:VOLT:LIM:HIGH, SOUR:VOLT:LIM:LOW, SOUR:VOLT:LIM:STAT - the instrument's own limits - 33500
        series guide - confirmed
    SOUR:FUNC:PULS:PER, SOUR:FUNC:PULS:WIDT - the length of a step - public client code - confirmed
    SOUR:BURS:STAT, SOUR:BURS:MODE, SOUR:BURS:NCYC - a single step - public client code - confirmed
    TRIG:SOUR, TRIG:SLOP, TRIG:DEL, *TRG - what starts a step - public client code - confirmed
"""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from drivers.generic.coil_generator import CoilGenerator, CoilSettings
from drivers.generic.coil_generator_messages import ChannelMessages, Wanted
from drivers.transport.exchanges import Repeatable
from station.roles import Identity

TRIGGERS = {"external": "EXT", "bus": "BUS"}


class Keysight33522B(CoilGenerator):
    """Two channels at coils: each holds a voltage, or waits for the trigger of a step.

    Limits: `voltage` V, of either sign.
    """

    class Settings(CoilSettings):
        """What the outputs are connected to, and what starts a step."""

        trigger: Literal["external", "bus"] = Field("external", description="what starts a step")

    recognises: ClassVar[str] = r"^(Keysight|Agilent) Technologies,33522B,(?P<serial>[^,]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:ERR\?|OUTP[12](:LOAD|:POL)?\?|(SOUR|TRIG)[12]:[A-Z:]+\?",
        r"OUTP[12] OFF",
    )
    """Not what arms a burst: sent again after a trigger it would end the step."""
    longest_delay_s: ClassVar[float] = 1000.0

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number, firmware."""
        identity = super().identify()
        self.met(f"answers as {identity.maker}")
        return identity

    def give_trigger(self) -> None:
        """Start all armed channels of this instrument, where the bench's `trigger` is `bus`."""
        self._line.command("*TRG")

    def _messages_of(self, channel: int) -> Messages:
        return Messages(channel, TRIGGERS[self.Settings.of(self.place).trigger])


class Messages(ChannelMessages):
    """The messages of one channel."""

    before_width = ("HOLD WIDT",)

    def __init__(self, channel: int, trigger: str) -> None:
        super().__init__(channel)
        self.limit = f"{self._sour}:VOLT:LIM"
        self.limit_switch = f"{self.limit}:STAT"
        self._trig, self._trigger = f"TRIG{channel}", trigger

    def triggered(self, delay_s: float, cycles: int) -> tuple[str, ...]:
        """Return what has a burst of so many pulses begin after each trigger."""
        burst = f"{self._sour}:BURS"
        return (
            f"{self._trig}:SOUR {self._trigger}",
            f"{self._trig}:SLOP POS",
            f"{self._trig}:DEL {delay_s:.9g}",
            f"{burst}:MODE TRIG",
            f"{burst}:NCYC {cycles}",
            f"{burst}:STAT ON",
        )

    def waits(self, delay_s: float) -> Wanted:
        """Return what has to be read of that."""
        return {f"{self._trig}:SOUR?": self._trigger, f"{self._trig}:DEL?": delay_s}
