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
low level, that an inverted one waits at the high level, that `*RST` is done within 0.5 s, and the
105 ns from trigger to output. Units answer as Agilent or Keysight Technologies (guide, p.172).

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

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from drivers.keysight.generator_33522b_messages import (
    CHANNELS,
    LARGEST_OPEN_V,
    LEAST_OPEN_VPP,
    TRIGGERS,
    WIDTHS_S,
    Messages,
    differs,
    joined,
    load_of,
    load_ohm,
)
from drivers.transport.line import shortened
from drivers.transport.retry import Repeatable
from drivers.transport.visa_line import ERROR_QUERY, ScpiDriver, VisaSettings
from station.errors import InstrumentError
from station.roles import Identity, Place, SafetyReading, quantity

LONGEST_DELAY_S = 1000.0


class Keysight33522B(ScpiDriver):
    """Two channels at coils: each holds a voltage, or waits for the trigger of a step.

    Limits: `voltage` V, of either sign.
    """

    class Settings(VisaSettings):
        """What the outputs are connected to, and what starts a step."""

        load: Annotated[str, AfterValidator(load_of)] = Field(
            description="`high-impedance`, or what the outputs see, as `50 ohm`; the wrong one "
            "doubles or halves every voltage"
        )
        trigger: Literal["external", "bus"] = Field("external", description="what starts a step")

    recognises: ClassVar[str] = r"^(Keysight|Agilent) Technologies,33522B,(?P<serial>[^,]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:ERR\?|OUTP[12](:LOAD|:POL)?\?|(SOUR|TRIG)[12]:[A-Z:]+\?",
        r"OUTP[12] OFF",
    )
    """Not what arms a burst: sent again after a trigger it would end the step."""

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        settings = self.Settings.of(place)
        self._load_ohm, self._trigger = load_ohm(settings.load), settings.trigger
        self._limit_V = self.limit("voltage")
        self._share = 1.0 if math.isinf(self._load_ohm) else self._load_ohm / (self._load_ohm + 50)
        self._messages = {one: Messages(one, TRIGGERS[self._trigger]) for one in CHANNELS}
        self._prepared = False
        self._held_V = dict.fromkeys(CHANNELS, 0.0)
        self._steady: set[int] = set()
        self._armed: set[int] = set()
        """Channels that are proven to hold a voltage, and those proven to wait for a trigger."""

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number, firmware."""
        identity = super().identify()
        self.met(f"answers as {identity.maker}")
        return identity

    def programme_limits(self) -> None:
        """Reset the instrument, outputs off, then write and read back terminations and limits.

        Raises InstrumentError where the bench allows more than the instrument can give.
        """
        largest_V = LARGEST_OPEN_V * self._share
        if self._limit_V > largest_V:
            raise self.error(
                f"limit the voltage to {self._limit_V:g} V",
                f"with this load the instrument ends at {largest_V:g} V",
                "lower limits.voltage in the bench file",
            )
        self._prepared = False
        self._forget()
        # What was refused before must not be taken for a refusal of what follows.
        self._line.query(f"*CLS;{ERROR_QUERY}")
        self._line.command("*RST")
        for messages in self._messages.values():
            self._line.command(messages.limits(self._load_ohm, self._limit_V))
            self._prove(messages.limited(self._load_ohm, self._limit_V))
        self._prepared = True

    def hold(self, channel: int, voltage_V: float) -> None:
        """Put a steady voltage on a channel, at once, output on, and read it back.

        Raises InstrumentError beyond the bench's limit; then the channel is as it was.
        """
        attempted = f"hold {voltage_V:g} V on channel {channel}"
        self._check(attempted, channel, voltage_V)
        self._prepare()
        messages = self._messages[channel]
        steady = channel in self._steady
        with self._off_where_it_fails(attempted, channel):
            if not steady:
                self._line.command(messages.steady())
            self._line.command(messages.offset(voltage_V))
            if not steady:
                self._line.command(messages.switch(on=True))
            self._prove(messages.held(self._load_ohm, voltage_V))
        self._held_V[channel] = voltage_V
        self._steady.add(channel)
        self.place.publish("output", "on")

    def prepare_step(
        self, channel: int, voltage_V: float, duration_s: float, delay_s: float = 0.0
    ) -> None:
        """Arm a step from what the channel holds by `voltage_V`, and back after `duration_s`.

        It begins `delay_s` after the trigger, up to 1000 s.

        A channel that holds nothing yet holds 0 V; a step of 0 V leaves it at that, unarmed. Its
        output is off for a moment while the function changes. Raises InstrumentError beyond the
        bench's limit; then the channel is as it was.
        """
        held_V = self._held_V[channel] if channel in CHANNELS else 0.0
        attempted = f"prepare a step by {voltage_V:g} V for {duration_s:g} s on channel {channel}"
        self._check(attempted, channel, held_V)
        self._check(attempted, channel, held_V + voltage_V)
        if not WIDTHS_S[0] <= duration_s <= WIDTHS_S[1]:
            what = f"its pulses last {WIDTHS_S[0]:g} s to {WIDTHS_S[1]:g} s"
            raise self.error(attempted, what, "correct the length of the record")
        if not 0.0 <= delay_s <= LONGEST_DELAY_S:
            what = f"it waits 0 s to {LONGEST_DELAY_S:g} s after a trigger"
            raise self.error(attempted, what, "correct the delay of the shutter")
        if voltage_V == 0.0:
            self.hold(channel, held_V)
            return
        least_V = LEAST_OPEN_VPP * self._share
        if abs(voltage_V) < least_V:
            what = f"its least amplitude is {least_V:g} V"
            raise self.error(attempted, what, "choose a larger field")
        self._prepare()
        messages = self._messages[channel]
        with self._off_where_it_fails(attempted, channel):
            self._line.command(messages.steady())
            for message in messages.step(held_V, voltage_V, duration_s, delay_s):
                self._line.command(message)
            self._line.command(messages.switch(on=True))
            wanted = messages.stepping(self._load_ohm, held_V, voltage_V, duration_s, delay_s)
            self._prove(wanted)
        self._armed.add(channel)
        self.place.publish("output", "on")

    def give_trigger(self) -> None:
        """Start all armed channels of this instrument, where the bench's `trigger` is `bus`."""
        self._line.command("*TRG")

    def disarm(self, channel: int) -> None:
        """Take an armed step back; the channel holds what it held."""
        self._check("disarm a step", channel, 0.0)
        if channel in self._armed:
            self.hold(channel, self._held_V[channel])

    def switch_off(self, channel: int) -> None:
        """Switch a channel's output off and read it back; what it held is forgotten."""
        self._check("switch a channel off", channel, 0.0)
        messages = self._messages[channel]
        self._forget(channel)
        self._line.command(messages.switch(on=False))
        self._prove({messages.output: "0"})
        self._outputs()

    def make_safe(self, deadline_s: float) -> None:
        """Switch both outputs off and read them back.

        Where that fails, a last attempt switches them off at once, and the error is raised.
        """
        off = joined(*(one.switch(on=False) for one in self._messages.values()))
        self._forget()
        try:
            self._line.patient.query(f"*CLS;{ERROR_QUERY}")
            self._line.patient.command(off)
            (outputs,) = self._line.proof.of(self._outputs)
            on = [channel for channel, is_on in outputs.items() if is_on]
            if on:
                what = f"channel {' and '.join(map(str, on))} reads back as on"
                raise self.error("switched both outputs off", what, "switch it off by hand")
        except InstrumentError:
            with suppress(InstrumentError):
                self._line.last_attempt(off)
            raise

    def read_safety(self) -> SafetyReading:
        """Read back both outputs."""
        (outputs,) = self._line.proof.of(self._outputs)
        words = [f"channel {channel} {'on' if on else 'off'}" for channel, on in outputs.items()]
        return SafetyReading(not any(outputs.values()), ", ".join(words))

    @quantity("output", states=("on", "off"))
    def _is_on(self) -> bool:
        return any(self._outputs().values())

    def _prepare(self) -> None:
        """Have the bench's limits and load in the instrument before anything is switched on."""
        if not self._prepared:
            self.programme_limits()

    def _forget(self, *channels: int) -> None:
        """Forget what channels hold, all of them unless some are named."""
        for channel in channels or CHANNELS:
            self._held_V[channel] = 0.0
            self._steady.discard(channel)
            self._armed.discard(channel)

    def _check(self, attempted: str, channel: int, voltage_V: float) -> None:
        if channel not in CHANNELS:
            raise self.error(attempted, "it has channels 1 and 2", "correct the channel")
        if not abs(voltage_V) <= self._limit_V:
            raise self.error(
                attempted,
                f"the output would be {voltage_V:g} V, the bench allows {self._limit_V:g} V",
                "lower the plan's fields, or correct limits.voltage in the bench file",
            )

    @contextmanager
    def _off_where_it_fails(self, attempted: str, channel: int) -> Iterator[None]:
        """Switch a channel off whose output may be anything: an error may have changed a level."""
        self._steady.discard(channel)
        self._armed.discard(channel)
        try:
            yield
        except InstrumentError as error:
            off = "and the channel was switched off"
            self._forget(channel)
            try:
                self._line.patient.query(f"*CLS;{ERROR_QUERY}")
                self._line.patient.command(self._messages[channel].switch(on=False))
                self._outputs()
            except InstrumentError:
                off = "and the channel could not be switched off"
            came_back, _, do_now = str(error).removeprefix(f"{self.place.name}: ").rpartition("; ")
            raise type(error)(self.place.name, attempted, f"{came_back}, {off}", do_now) from error

    def _prove(self, wanted: dict[str, str | float]) -> None:
        """Ask for every setting in one exchange; InstrumentError where one reads otherwise."""
        question = joined(*wanted)
        answer = self._line.query(question)
        answers = answer.split(";")
        if len(answers) != len(wanted):
            raise self._odd(question, answer)
        for (query, expected), has in zip(wanted.items(), answers, strict=True):
            if differs(expected, has):
                raise self.error(
                    f"asked {query}",
                    f"{shortened(has)!r} came back where {expected} belongs",
                    "check its output for an overload, that nobody works at its front panel, and "
                    "settings.load: a termination that is not what is connected doubles or "
                    "halves every voltage",
                )

    def _outputs(self) -> dict[int, bool]:
        """Return which outputs are on, and publish whether any is."""
        question = joined(*(one.output for one in self._messages.values()))
        answers = self._line.patient.query(question).split(";")
        if len(answers) != len(CHANNELS) or not set(answers) <= {"0", "1"}:
            raise self._odd(question, ";".join(answers))
        outputs = {channel: one == "1" for channel, one in zip(CHANNELS, answers, strict=True)}
        self.place.publish("output", "on" if any(outputs.values()) else "off")
        return outputs

    def _odd(self, question: str, answer: str) -> InstrumentError:
        return self.error(
            f"asked {shortened(question)}",
            f"{shortened(answer)!r} came back",
            "check its address in the bench file, its cable, and that nobody else talks to it",
        )
