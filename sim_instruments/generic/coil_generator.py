"""A function generator with SCPI whose two channels each drive a coil of the world."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Protocol, runtime_checkable

from sim_instruments.faults.lasting import LastingFault, LoadReset, NoTrigger
from sim_instruments.generic.coil_channel import OPEN, GeneratorChannel
from sim_instruments.generic.waveform import Ratings, Wave
from sim_instruments.instrument import Setting
from sim_instruments.wire.scpi import NO_ERROR, ScpiError, boolean, choice, word, words
from sim_instruments.wire.scpi_device import Pair, ScpiDevice, Value, kept, taken
from sim_instruments.world.base import TriggerLine
from sim_instruments.world.serf_coils import VoltageHistory

COILS = ("x", "y", "z", "gradient", "none")
Held = dict[str, Pair]


@runtime_checkable
class CoilWorld(Protocol):
    """A world with coils that a voltage drives."""

    def drive(self, coil: str, history: VoltageHistory) -> None:
        """Have a coil driven by a voltage, now and in all time."""


class CoilGenerator(ScpiDevice):
    """The generator, in whatever simulated world has coils to drive and a `trigger`.

    Truth (`simulator` mapping): by channel, 1 and 2, `coils` (x, y, z, gradient or none),
    `gain_error` and `offset` (V, at an open end, while the output is on); `trigger_latency`, from
    the edge to the output.
    """

    ratings: ClassVar[Ratings]
    highest_Hz: ClassVar[float]
    functions: ClassVar[tuple[str, ...]]
    wave_kind: ClassVar[type[Wave]] = Wave
    off_is_not_triggered: ClassVar[bool] = False
    """Whether a trigger over the line needs a channel that is on."""

    def __init__(self, setting: Setting, identity: str, no_error: str = NO_ERROR) -> None:
        super().__init__(identity, no_error)
        truth = setting.truth
        self._clock, self._faults = setting.clock, setting.faults
        self._latency_s = truth.quantity("trigger_latency", "s")
        coils, gains, offsets = (truth.section(key) for key in ("coils", "gain_error", "offset"))
        driven, wire = setting.world.find(CoilWorld), setting.world.find(TriggerLine)
        self._channels: dict[int, GeneratorChannel] = {}
        for number in (1, 2):
            # JSON has no numbers for keys.
            key: Any = number if number in coils else str(number)
            coil, history = coils.word(key, COILS), VoltageHistory()
            wave = self.wave_kind(self.ratings, self._complain)
            channel = self._channels[number] = GeneratorChannel(
                history, gains.quantity(key, "1"), offsets.quantity(key, "V"), wave
            )
            if driven is not None and coil != "none":
                driven.drive(coil, history)
            self._add_channel(number, channel)
        if wire is not None:
            wire.listen(partial(self._edge, slope="POS"), partial(self._edge, slope="NEG"))
        self.add_commands({"*TRG": self._trigger})
        self._faults.when_changed(LoadReset.kind, self._reset_loads)

    @abstractmethod
    def _add_channel(self, number: int, channel: GeneratorChannel) -> None:
        """Add the commands of a channel."""

    @abstractmethod
    def _complain(self, code: int, more: str) -> None:
        """Say that something was changed that was not asked for."""

    def energised(self) -> bool:
        """Return whether an output is on."""
        return any(channel.on for channel in self._channels.values())

    def reset(self) -> None:
        """Go to sines of 100 mVpp into 50 ohm, both outputs off."""
        for channel in self._channels.values():
            channel.reset()
            channel.apply(self._clock.now())

    def _source(self, channel: GeneratorChannel) -> Held:
        """Return the settings below SOURce that every model has alike."""
        wave = channel.wave
        function, mode = word(*self.functions), word("TRIGgered", "GATed")
        return {
            "FUNCtion": taken(wave, "function", lambda text: channel.set_function(function(text))),
            "FREQuency": taken(
                wave, "frequency_Hz", partial(wave.set_frequency, highest_Hz=self.highest_Hz)
            ),
            "VOLTage": taken(channel, "amplitude_V", channel.set_amplitude),
            "VOLTage:OFFSet": taken(channel, "offset_V", channel.set_offset),
            "VOLTage:HIGH": taken(channel, "high_V", channel.set_high),
            "VOLTage:LOW": taken(channel, "low_V", channel.set_low),
            "VOLTage:UNIT": (word("VPP"), lambda: "VPP"),
            "FUNCtion:PULSe:WIDTh": taken(wave, "width_s", wave.set_width),
            "BURSt:MODE": kept(channel, "mode", mode),
            "BURSt:NCYCles": kept(channel, "cycles", partial(cycles, wave)),
            "BURSt:STATe": taken(channel, "burst", lambda text: channel.set_burst(boolean(text))),
        }

    def _limits(self, channel: GeneratorChannel) -> Held:
        """Return the limits of the voltage."""
        return {
            ":HIGH": kept(channel, "high_limit_V", channel.limit_V),
            ":LOW": kept(channel, "low_limit_V", channel.limit_V),
            ":STATe": taken(channel, "limited", lambda text: channel.set_limited(boolean(text))),
        }

    def _output(self, channel: GeneratorChannel) -> Held:
        """Return the settings below OUTPut that every model has alike."""
        return {
            "[:STATe]": taken(channel, "on", lambda text: self._switch(channel, boolean(text))),
            ":LOAD": taken(channel, "load_ohm", channel.set_load),
            ":POLarity": (
                lambda text: setattr(channel, "inverted", choice(text, POLARITIES) == "INV"),
                lambda: "INV" if channel.inverted else "NORM",
            ),
        }

    def _switch(self, channel: GeneratorChannel, on: bool) -> None:
        channel.on = on

    def _add_held(self, channel: GeneratorChannel, table: Mapping[str, Value], *roots: str) -> None:
        """Add commands of a channel; after each its coil has what the settings say."""
        self.add_commands(table, *roots, after=lambda: channel.apply(self._clock.now()))

    def _trigger(self, *channels: GeneratorChannel) -> None:
        """Take a trigger over the line, for all channels where none is given."""
        waiting = [
            channel
            for channel in channels or self._channels.values()
            if channel.waits and channel.source == "BUS"
            if channel.on or not self.off_is_not_triggered
        ]
        if not waiting:
            raise ScpiError(-211)
        for channel in waiting:
            channel.trigger(self._clock.now(), self._latency_s)

    def _edge(self, time_s: float, slope: str) -> None:
        if self._faults.now(NoTrigger.kind) is not None:
            return
        for channel in self._channels.values():
            if channel.source == "EXT" and channel.slope == slope:
                channel.trigger(time_s, self._latency_s)

    def _reset_loads(self, time_s: float, fault: LastingFault | None) -> None:
        if fault is not None:
            for channel in self._channels.values():
                channel.limited = False
                channel.set_load("DEF")


POLARITIES = words("NORMal", "INVerted")
SLOPES = word("POSitive", "NEGative")


def cycles(wave: Wave, text: str) -> float:
    """Return the number of cycles of a burst."""
    endless = text.upper() in ("INF", "INFINITY")
    return OPEN if endless else float(round(wave.number(text, 1, 1e8, 1)))
