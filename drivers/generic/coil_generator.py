"""What two-output generators at coils share: steady voltages, and steps that wait for a trigger.

A maker's class has the messages of a channel. Limits stand in the instrument before anything is
switched on, every level is checked before it is sent and read back after, and a channel whose level
the instrument has changed is switched off.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, ClassVar

from pydantic import AfterValidator, Field

from drivers.generic.coil_generator_messages import (
    ChannelMessages,
    differs,
    joined,
    load_of,
    load_ohm,
)
from drivers.transport.exchanges import shortened
from drivers.transport.text_line import ScpiDriver, VisaSettings
from station.errors import InstrumentError
from station.roles import Place, SafetyReading, quantity
from station.roles.patience import patience

CHANNELS = (1, 2)
STATES = {"0": False, "OFF": False, "1": True, "ON": True}


class CoilSettings(VisaSettings):
    """What the outputs are connected to."""

    load: Annotated[str, AfterValidator(load_of)] = Field(
        description="`high-impedance`, or what the outputs see, as `50 ohm`; the wrong one "
        "doubles or halves every voltage"
    )


class CoilGenerator(ScpiDriver):
    """Two channels at coils: each holds a voltage, or waits for the trigger of a step."""

    Settings: ClassVar[type[CoilSettings]] = CoilSettings
    largest_open_V: ClassVar[float] = 10.0
    least_open_Vpp: ClassVar[float] = 2e-3
    widths_s: ClassVar[tuple[float, float]] = (1e-6, 5e5)
    """Instruments can do shorter ones, which no coil follows."""
    longest_delay_s: ClassVar[float]
    most_cycles: ClassVar[int] = 1000
    """Of a burst. Instruments can do more, which no record holds."""
    deadlines: ClassVar[Mapping[str, float]] = {r"\*RST": 2.0}
    """Not documented for any of the models: taken as 2 s."""
    when_odd = "check its address in the bench file, its cable, and that nobody else talks to it"

    @abstractmethod
    def _messages_of(self, channel: int) -> ChannelMessages:
        """Return the messages of a channel."""

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        settings = self.Settings.of(place)
        self._load_ohm = load_ohm(settings.load)
        self._limit_V = self.limit("voltage")
        self._share = 1.0 if math.isinf(self._load_ohm) else self._load_ohm / (self._load_ohm + 50)
        self._messages = {channel: self._messages_of(channel) for channel in CHANNELS}
        self._prepared = False
        self._held_V = dict.fromkeys(CHANNELS, 0.0)
        self._steady: set[int] = set()
        self._armed: set[int] = set()
        """Channels that are proven to hold a voltage, and those proven to wait for a trigger."""

    def programme_limits(self) -> None:
        """Reset the instrument, outputs off, then write and read back terminations and limits.

        Raises InstrumentError where the bench allows more than the instrument can give.
        """
        largest_V = self.largest_open_V * self._share
        self.check_rating("voltage", largest_V, "V", whose="with this load the instrument")
        self._prepared = False
        self._forget()
        self._line.forget_errors()
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
        self,
        channel: int,
        voltage_V: float,
        duration_s: float,
        delay_s: float = 0.0,
        cycles: int = 1,
    ) -> None:
        """Arm a step from what the channel holds by `voltage_V`, and back after `duration_s`.

        It begins `delay_s` after the trigger; of several `cycles` each lasts twice `duration_s`.

        A channel that holds nothing yet holds 0 V; a step of 0 V leaves it at that, unarmed. Its
        output is off for a moment while the function changes. Raises InstrumentError beyond the
        bench's limit; then the channel is as it was.
        """
        held_V = self._held_V[channel] if channel in CHANNELS else 0.0
        attempted = f"prepare a step by {voltage_V:g} V for {duration_s:g} s on channel {channel}"
        self._check(attempted, channel, held_V)
        self._check(attempted, channel, held_V + voltage_V)
        if not self.widths_s[0] <= duration_s <= self.widths_s[1]:
            what = f"its pulses last {self.widths_s[0]:g} s to {self.widths_s[1]:g} s"
            raise self.error(attempted, what, "correct the length of the record")
        if not 0.0 <= delay_s <= self.longest_delay_s:
            what = f"it waits 0 s to {self.longest_delay_s:g} s after a trigger"
            raise self.error(attempted, what, "correct the delay of the shutter")
        if not 1 <= cycles <= self.most_cycles:
            what = f"its bursts have 1 to {self.most_cycles} cycles"
            raise self.error(attempted, what, "correct the cycles of the tone")
        if voltage_V == 0.0:
            self.hold(channel, held_V)
            return
        least_V = self.least_open_Vpp * self._share
        if abs(voltage_V) < least_V:
            what = f"its least amplitude is {least_V:g} V"
            raise self.error(attempted, what, "choose a larger field")
        self._prepare()
        messages = self._messages[channel]
        with self._off_where_it_fails(attempted, channel):
            self._line.command(messages.steady())
            for message in messages.step(held_V, voltage_V, duration_s, delay_s, cycles):
                self._line.command(message)
            self._line.command(messages.switch(on=True))
            levels_V = (held_V, held_V + voltage_V)
            self._prove(messages.stepping(self._load_ohm, levels_V, duration_s, delay_s, cycles))
        self._armed.add(channel)
        self.place.publish("output", "on")

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
        self._prove({messages.output: messages.off})
        self._outputs()

    def make_safe(self, deadline_s: float) -> None:
        """Switch both outputs off and read them back."""
        self._forget()
        self._line.forget_errors()
        self._line.command(self._off())
        (outputs,) = self._line.proof.of(self._outputs)
        on = [channel for channel, is_on in outputs.items() if is_on]
        if on:
            what = f"channel {' and '.join(map(str, on))} reads back as on"
            raise self.error("switched both outputs off", what, "switch it off by hand")

    def last_attempt(self) -> None:
        """Switch both outputs off at once, and wait for no answer."""
        self._line.last_attempt(self._off())

    def read_safety(self) -> SafetyReading:
        """Read back both outputs."""
        (outputs,) = self._line.proof.of(self._outputs)
        words = [f"channel {channel} {'on' if on else 'off'}" for channel, on in outputs.items()]
        return SafetyReading(not any(outputs.values()), ", ".join(words))

    @quantity("output", states=("on", "off"))
    def _is_on(self) -> bool:
        return any(self._outputs().values())

    def _off(self) -> str:
        return joined(*(messages.switch(on=False) for messages in self._messages.values()))

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
                with patience():
                    self._line.forget_errors()
                    self._line.command(self._messages[channel].switch(on=False))
                self._outputs()
            except InstrumentError:
                off = "and the channel could not be switched off"
            came_back, _, do_now = str(error).removeprefix(f"{self.place.name}: ").rpartition("; ")
            raise type(error)(self.place.name, attempted, f"{came_back}, {off}", do_now) from error

    def _prove(self, wanted: dict[str, str | float]) -> None:
        """Ask for every setting in one exchange; InstrumentError where one reads otherwise."""
        answers = self._line.answers(dict.fromkeys(wanted, str))
        for (query, expected), has in zip(wanted.items(), answers, strict=True):
            if differs(expected, has):
                raise self.error(
                    f"asked {query}",
                    f"{shortened(has)!r} came back where {expected} belongs",
                    "check its output for an overload, that nobody works at its front panel, and "
                    "settings.load: a termination that is not what is connected doubles or "
                    "halves every voltage",
                )

    @patience()
    def _outputs(self) -> dict[int, bool]:
        """Return which outputs are on, and publish whether any is."""
        questions = [messages.output for messages in self._messages.values()]
        states = self._line.answers(dict.fromkeys(questions, STATES.__getitem__))
        outputs = dict(zip(CHANNELS, states, strict=True))
        self.place.publish("output", "on" if any(outputs.values()) else "off")
        return outputs
