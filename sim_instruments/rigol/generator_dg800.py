"""Rigol DG822 waveform generator, SCPI over TCP: two channels, each at a coil of the world.

From pages of the DG800 Programming Guide and from public client code: outputs and switches that are
answered as ON or OFF, `0,"No error"`, numbers with seven digits as `1.000000E-01`, an open end as
9.9E+37, a trigger input for each channel, N-cycle bursts whose trigger is INT, EXT or MAN, with a
delay up to 100 s, `BURS:TRIG` and `*TRG` for MAN, an idle level of a burst, limits of the output.
Assumed: that limits, levels and terminations depend on each other as on a 33522B (`Channel`), with
error -221 or -222; the depth of the error queue; that both trigger inputs have the world's trigger;
that idle levels other than BOTTOM, and triggers from inside, do not reach the coil.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

from sim_instruments.faults.lasting import LastingFault, LoadReset, NoTrigger
from sim_instruments.instrument import Setting
from sim_instruments.keysight.generator_33522b import (
    MODES,
    POLARITIES,
    SLOPES,
    CoilWorld,
    coil_name,
    cycles,
    load,
    only_vpp,
)
from sim_instruments.keysight.generator_33522b_channel import GeneratorChannel
from sim_instruments.wire.scpi import ScpiError, boolean, choice, numeric
from sim_instruments.wire.scpi_device import ScpiDevice
from sim_instruments.world.base import TriggerLine
from sim_instruments.world.serf_coils import VoltageHistory

FUNCTIONS = {"DC": "DC", "PULS": "PULS", "PULSE": "PULS", "SIN": "SIN", "SINUSOID": "SIN"}
FUNCTIONS |= {"SQU": "SQU", "SQUARE": "SQU", "RAMP": "RAMP", "NOIS": "NOIS", "NOISE": "NOIS"}
SOURCES = {"EXT": "EXT", "EXTERNAL": "EXT", "MAN": "BUS", "MANUAL": "BUS"}
SOURCES |= {"INT": "IMM", "INTERNAL": "IMM"}
SOURCE_NAMES = {"EXT": "EXT", "BUS": "MAN", "IMM": "INT"}
"""By what `GeneratorChannel` calls them."""
IDLES = {"FPT": "FPT", "TOP": "TOP", "CENTER": "CENTER", "BOTTOM": "BOTTOM"}
MAX_DELAY_S = 100.0
Held = dict[str, tuple[Callable[[str], None], Callable[[], str | float | bool]]]


class RigolDg800(ScpiDevice):
    """The generator, in whatever simulated world has coils to drive and a `trigger`.

    Truth (`simulator` mapping): by channel, 1 and 2, `coils` (x, y, z, gradient or none),
    `gain_error` and `offset` (V, at an open end, while the output is on); `trigger_latency`. May be
    given: `maker`, as `*IDN?` answers it.
    """

    model = "Rigol DG822"
    lasting_faults: ClassVar = (NoTrigger.kind, LoadReset.kind)

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        maker = truth.text("maker", "Rigol Technologies")
        super().__init__(f"{maker},DG822,{setting.serial},00.02.06.00.01")
        self._clock, self._faults = setting.clock, setting.faults
        self._latency_s = truth.quantity("trigger_latency", "s")
        coils, gains, offsets = (truth.section(key) for key in ("coils", "gain_error", "offset"))
        driven, wire = setting.world.find(CoilWorld), setting.world.find(TriggerLine)
        self._channels: dict[int, GeneratorChannel] = {}
        self._idle = dict.fromkeys((1, 2), "FPT")
        for number in (1, 2):
            # JSON has no numbers for keys.
            key: Any = number if number in coils else str(number)
            coil, history = coil_name(coils, key), VoltageHistory()
            self._channels[number] = GeneratorChannel(
                history, gains.quantity(key, "1"), offsets.quantity(key, "V"), self._complain
            )
            if driven is not None and coil != "none":
                driven.drive(coil, history)
            self._add_channel(number, self._channels[number])
        if wire is not None:
            wire.listen(partial(self._edge, slope="POS"), partial(self._edge, slope="NEG"))
        self.tree.add("*TRG", self._do(self._manual))
        self._faults.when_changed(LoadReset.kind, self._reset_loads)
        self.begin_to_serve(setting)

    def energised(self) -> bool:
        """Return whether an output is on."""
        return any(channel.on for channel in self._channels.values())

    def reset(self) -> None:
        """Go to sines, both outputs off."""
        self._idle = dict.fromkeys((1, 2), "FPT")
        for channel in self._channels.values():
            channel.reset()
            channel.apply(self._clock.now())

    def _add_channel(self, number: int, channel: GeneratorChannel) -> None:
        """Add the commands of a channel; after each its coil has what the settings say."""
        wave = channel.wave

        def put(what: str, names: dict[str, str]) -> Callable[[str], None]:
            return lambda text: setattr(channel, what, choice(text, names))

        source: Held = {
            "FUNCtion[:SHAPe]": (
                lambda text: channel.set_function(choice(text, FUNCTIONS)),
                lambda: wave.function,
            ),
            "VOLTage": (channel.set_amplitude, lambda: channel.amplitude_V),
            "VOLTage:OFFSet": (channel.set_offset, lambda: channel.offset_V),
            "VOLTage:HIGH": (channel.set_high, lambda: channel.high_V),
            "VOLTage:LOW": (channel.set_low, lambda: channel.low_V),
            "VOLTage:UNIT": (only_vpp, lambda: "VPP"),
            "FREQuency[:FIXed]": (
                lambda text: wave.set_period(1.0 / numeric(text, 1e-6, 25e6, 1e3)),
                lambda: 1.0 / wave.period_s,
            ),
            "FUNCtion:PULSe:PERiod": (
                lambda text: wave.set_period(numeric(text, 1e-7, 1e6, 1e-3)),
                lambda: wave.period_s,
            ),
            "FUNCtion:PULSe:WIDTh": (wave.set_width, lambda: wave.width_s),
            "BURSt[:STATe]": (
                lambda text: channel.set_burst(boolean(text)),
                lambda: channel.burst,
            ),
            "BURSt:MODE": (put("mode", MODES), lambda: channel.mode),
            "BURSt:NCYCles": (
                lambda text: setattr(channel, "cycles", cycles(text)),
                lambda: str(int(channel.cycles)),
            ),
            "BURSt:TRIGger:SOURce": (
                put("source", SOURCES),
                lambda: SOURCE_NAMES[channel.source],
            ),
            "BURSt:TRIGger:SLOPe": (put("slope", SLOPES), lambda: channel.slope),
            "BURSt:TDELay": (
                lambda text: setattr(channel, "delay_s", numeric(text, 0.0, MAX_DELAY_S, 0.0)),
                lambda: channel.delay_s,
            ),
            "BURSt:IDLE": (partial(self._set_idle, number), lambda: self._idle[number]),
        }
        output: Held = {
            "[:STATe]": (
                lambda text: setattr(channel, "on", boolean(text)),
                lambda: channel.on,
            ),
            ":POLarity": (
                lambda text: setattr(channel, "inverted", choice(text, POLARITIES) == "INV"),
                lambda: "INV" if channel.inverted else "NORM",
            ),
            ":VOLLimit[:STATe]": (
                lambda text: channel.set_limited(boolean(text)),
                lambda: channel.limited,
            ),
            ":VOLLimit:HIGH": (
                partial(channel.set_limit, high=True),
                lambda: channel.high_limit_V,
            ),
            ":VOLLimit:LOW": (
                partial(channel.set_limit, high=False),
                lambda: channel.low_limit_V,
            ),
        }
        for name in (":LOAD", ":IMPedance"):
            output[name] = (
                lambda text: channel.set_load(load(text)),
                lambda: channel.load_ohm,
            )

        def applied(act: Callable[[str], None], text: str) -> None:
            act(text)
            channel.apply(self._clock.now())

        for root, held in ((f"SOURce{number}:", source), (f"OUTPut{number}", output)):
            for header, (take, give) in held.items():
                self.add_settings({header: (partial(applied, take), partial(shown, give))}, root)
        self.tree.add(
            f"SOURce{number}:BURSt:TRIGger[:IMMediate]", self._do(partial(self._manual, channel))
        )

    def _set_idle(self, number: int, text: str) -> None:
        self._idle[number] = choice(text, IDLES)

    def _complain(self, code: int, more: str) -> None:
        self.refuse(code)

    def _manual(self, *channels: GeneratorChannel) -> None:
        waiting = [
            channel
            for channel in channels or self._channels.values()
            if channel.waits and channel.source == "BUS" and channel.on
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
                channel.set_load(50.0)


def shown(give: Callable[[], str | float | bool]) -> str:
    """Return a value as the instrument writes it."""
    value = give()
    if isinstance(value, bool):
        return "ON" if value else "OFF"
    return value if isinstance(value, str) else f"{value:.6E}"
