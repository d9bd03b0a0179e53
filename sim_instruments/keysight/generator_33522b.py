"""Keysight 33522B waveform generator, SCPI over TCP: two channels, each at a coil of the world.

From the 33500 series guide and public client code: LF ends commands and replies, `+0,"No error"`
ends an error queue of 20, a trigger from the connector that both channels share, `*TRG` for
channels whose source is BUS. A value beyond its limits is clipped, which changes it all the same,
and the error says so. Levels, termination and limits: see `GeneratorChannel`. APPLy sets function,
frequency, amplitude and offset and switches the output on; `APPL?` answers in quotes; sweep and
burst exclude one another, the last that is switched on stays. What a sweep, a phase, a gate or the
output of the Sync or the Ext Trig connector does (p.177, 264, 318) is not simulated. Its coils hang
on drivers of high impedance. Numbers are written as `+1.0000000000000E+00`, an open end as 9.9E+37.
Assumed: the error of an output whose protection has tripped, the byte order of blocks, and that
modulation, coupling and sums, which are not here, are refused as unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import ClassVar

from sim_instruments.faults.lasting import LastingFault, LoadReset, NoTrigger, OutputTripped
from sim_instruments.generic.coil_channel import GeneratorChannel
from sim_instruments.generic.coil_generator import SLOPES, CoilGenerator, Held
from sim_instruments.generic.waveform import Ratings, Wave
from sim_instruments.instrument import Setting
from sim_instruments.keysight.generator_33522b_wave import (
    ARB_EXISTS,
    NO_SUCH_ARB,
    ArbitraryWave,
)
from sim_instruments.wire.requests import without_blocks
from sim_instruments.wire.scpi import ScpiError, boolean, short_of, word
from sim_instruments.wire.scpi_device import KeptSettings, KeptTable, Listed, Pair, kept, taken

FIRMWARE = "4.00-1.19-2.00-52-00"
TRIPPED = -240
HIGHEST_HZ = 30e6
PERIODS_S = (1 / HIGHEST_HZ, 1e6)
FUNCTIONS = ("SINusoid", "SQUare", "TRIangle", "RAMP", "PULSe", "PRBS", "NOISe", "ARBitrary", "DC")
SPANS = {
    "PHASe": (-360.0, 360.0, 0.0),
    "FUNCtion:RAMP:SYMMetry": (0.0, 100.0, 100.0),
    "SWEep:TIME": (1e-3, 250e3, 1.0),
    "FREQuency:STARt": (1e-6, HIGHEST_HZ, 100.0),
    "FREQuency:STOP": (1e-6, HIGHEST_HZ, 1e3),
    "BURSt:INTernal:PERiod": (1e-6, 8e3, 10e-3),
    "BURSt:PHASe": (-360.0, 360.0, 0.0),
}
"""Least, largest and the value after `*RST` of numbers that do not change what a coil gets."""
TIMED = {"TIMer": (1e-6, 8e3, 1.0), "COUNt": (1.0, 1e6, 1.0)}
"""The same of what a trigger's own timer and a list of triggers would do."""
SOURCE_KEPT: KeptTable = {
    "SWEep:SPACing": (word("LINear", "LOGarithmic"), "LIN"),
    "FUNCtion:PULSe:HOLD": (word("WIDTh", "DCYCle"), "WIDT"),
    "FUNCtion:ARBitrary:FILTer": (word("NORMal", "STEP", "OFF"), "STEP"),
    "FUNCtion:ARBitrary:ADVance": (word("TRIGger", "SRATe"), "SRAT"),
    "BURSt:GATE:POLarity": (word("NORMal", "INVerted"), "NORM"),
}
OUTPUT_KEPT: KeptTable = {
    ":SYNC:MODE": (word("NORMal", "CARRier", "MARKer"), "NORM"),
    ":SYNC:POLarity": (word("NORMal", "INVerted"), "NORM"),
}
SYNC: KeptTable = {
    ":SYNC[:STATe]": (boolean, True),
    ":SYNC:SOURce": (word("CH1", "CH2"), "CH1"),
    ":TRIGger[:STATe]": (boolean, False),
    ":TRIGger:SLOPe": (SLOPES, "POS"),
    ":TRIGger:SOURce": (word("CH1", "CH2"), "CH1"),
}


class Keysight33522B(CoilGenerator):
    """The generator; its truth is that of `CoilGenerator`.

    May be given: `maker`, Keysight or Agilent Technologies; `empty_queue`, the words of an empty
    error queue.
    """

    model = "Keysight 33522B"
    longest_line = 1 << 24
    takes_blocks = True
    number_form = "+.13E"
    own_texts: ClassVar = {
        TRIPPED: "Hardware error;output overload",
        NO_SUCH_ARB: "Specified arb waveform does not exist",
        ARB_EXISTS: "Specified arb waveform already exists",
    }
    ratings = Ratings(10.0, 2e-3, 1e-3, (1.0, 10e3), PERIODS_S, 16e-9)
    highest_Hz = HIGHEST_HZ
    functions = FUNCTIONS
    wave_kind = ArbitraryWave
    lasting_faults: ClassVar = (NoTrigger.kind, OutputTripped.kind, LoadReset.kind)

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        maker = truth.text("maker", "Keysight Technologies")
        empty = truth.text("empty_queue", "No error")
        self._blocks: list[bytes] = []
        self._sync = KeptSettings(SYNC)
        self._kept = [self._sync]
        self._sweeps = {1: False, 2: False}
        setting.faults.when_changed(OutputTripped.kind, self._trip)
        identity = f"{maker},33522B,{setting.serial},{FIRMWARE}"
        super().__init__(setting, identity, f'+0,"{empty}"')
        self.add_commands({"SYSTem:BEEPer[:IMMediate]": lambda: None})
        self.begin_to_serve(setting)

    def _add_channel(self, number: int, channel: GeneratorChannel) -> None:
        wave = channel.wave
        assert isinstance(wave, ArbitraryWave)
        source_kept = KeptSettings({**numbers_of(wave), **SOURCE_KEPT})
        output_kept = KeptSettings(OUTPUT_KEPT)
        between = partial(clips, wave)
        trigger_kept = KeptSettings(
            {name: (between(*span), span[2]) for name, span in TIMED.items()}
        )
        self._kept += [source_kept, output_kept, trigger_kept]

        def edges(*names: str) -> Pair:
            return partial(_set_edges, wave, names), partial(getattr, wave, names[0])

        limits = {f"VOLTage:LIMit{header}": pair for header, pair in self._limits(channel).items()}
        source: Held = {
            **self._source(channel),
            **limits,
            **source_kept.commands(),
            "FUNCtion:PULSe:PERiod": taken(
                wave, "period_s", lambda text: wave.set_period(wave.number(text, *PERIODS_S, 1e-3))
            ),
            "FUNCtion:PULSe:TRANsition[:BOTH]": edges("leading_s", "trailing_s"),
            "FUNCtion:PULSe:TRANsition:LEADing": edges("leading_s"),
            "FUNCtion:PULSe:TRANsition:TRAiling": edges("trailing_s"),
            "FUNCtion:PULSe:DCYCle": taken(wave, "pulse_percent", wave.set_pulse_duty),
            "FUNCtion:SQUare:DCYCle": taken(wave, "duty_percent", wave.set_square_duty),
            "FUNCtion:ARBitrary": (wave.choose, lambda: f'"{wave.arb}"'),
            "FUNCtion:ARBitrary:SRATe": kept(wave, "rate_per_s", between(1e-6, 250e6, 40e3)),
            "SWEep:STATe": (
                partial(self._sweep, number, channel),
                lambda: self._sweeps[number] and not channel.burst,
            ),
            "DATA:VOLatile:CATalog": (None, wave.catalogue),
        }
        trigger: Held = {
            "SOURce": kept(channel, "source", word("IMMediate", "EXTernal", "TIMer", "BUS")),
            "SLOPe": kept(channel, "slope", SLOPES),
            "DELay": kept(channel, "delay_s", between(0.0, 1000.0, 0.0)),
            **trigger_kept.commands(),
        }
        output: Held = {**self._output(channel), **output_kept.commands()}
        if number == 1:
            output |= self._sync.commands()
        # The number of the first channel may be left out, and so may SOURce.
        numbers, sources = ([1, ""], [""]) if number == 1 else ([2], [])
        roots = [f"SOURce{n}:" for n in numbers] + sources
        self._add_held(channel, source, *roots)
        self._add_held(channel, trigger, *(f"TRIGger{n}:" for n in numbers))
        self._add_held(channel, output, *(f"OUTPut{n}" for n in numbers))
        acts = {
            "DATA:ARBitrary": Listed(partial(self._take_points, wave, counts=False)),
            "DATA:ARBitrary:DAC": Listed(partial(self._take_points, wave, counts=True)),
            "DATA:VOLatile:CLEar": Listed(lambda _: wave.clear()),
            "APPLy": Listed(None, lambda _: self._shown(channel)),
            **{f"APPLy:{name}": Listed(partial(self._apply, number, name)) for name in FUNCTIONS},
        }
        self._add_held(channel, acts, *roots)
        self.add_commands({"PHASe:SYNChronize": Listed(lambda _: None)}, *roots)

    def questionable_condition(self) -> int:
        """Return 1 while an output's protection is tripped."""
        return int(self._faults.now(OutputTripped.kind) is not None)

    def reset(self) -> None:
        """Go to sines of 100 mVpp into 50 ohm, both outputs off."""
        for settings in self._kept:
            settings.reset()
        self._sweeps = dict.fromkeys(self._sweeps, False)
        super().reset()

    def _line(self, line: bytes) -> bytes:
        # The parser splits at characters that a block may hold: in its place stands its number.
        text, self._blocks = without_blocks(line)
        return super()._line(text)

    def _take_points(self, wave: ArbitraryWave, parameters: list[str], *, counts: bool) -> None:
        block = None
        if len(parameters) == 2 and parameters[1].startswith("#") and self._blocks:
            block = self._blocks[int(parameters[1][1:])]
        wave.take(parameters, counts=counts, block=block)

    def _apply(self, number: int, function: str, parameters: list[str]) -> None:
        channel = self._channels[number]
        if len(parameters) > 3:
            raise ScpiError(-108)
        frequency, amplitude, offset = [*parameters, "DEF", "DEF", "DEF"][:3]
        default = ("DEF", "DEFAULT")
        channel.set_function(short_of(function))
        if frequency.upper() not in default:
            frequency_Hz = channel.wave.number(frequency, 1e-6, HIGHEST_HZ, 1e3)
            if function != "DC":
                channel.wave.set_period(1.0 / frequency_Hz)
        if function != "DC" and amplitude.upper() not in default:
            channel.set_amplitude(amplitude)
        channel.set_offset("0" if offset.upper() in default else offset)
        self._sweeps[number] = channel.burst = False
        channel.source, channel.on = "IMM", True

    def _shown(self, channel: GeneratorChannel) -> str:
        values = (channel.wave.frequency_Hz, channel.amplitude_V, channel.offset_V)
        return f'"{channel.wave.function} {",".join(map(self.written, values))}"'

    def _sweep(self, number: int, channel: GeneratorChannel, text: str) -> None:
        self._sweeps[number] = boolean(text)
        if self._sweeps[number]:
            channel.burst = False

    def _complain(self, code: int, more: str) -> None:
        self.refuse(code, more)

    def _switch(self, channel: GeneratorChannel, on: bool) -> None:
        if on and self._faults.now(OutputTripped.kind) is not None:
            raise ScpiError(TRIPPED)
        channel.on = on

    def _trip(self, time_s: float, fault: LastingFault | None) -> None:
        if fault is not None:
            for channel in self._channels.values():
                channel.on = False
                channel.apply(time_s)
            self.errors.push(TRIPPED)


def clips(wave: Wave, lowest: float, highest: float, default: float) -> Callable[[str], float]:
    """Return what reads a number and clips it to what lies between two."""
    return lambda text: wave.number(text, lowest, highest, default)


def numbers_of(wave: Wave) -> KeptTable:
    """Return the numbers of a channel that do not change what a coil gets."""
    return {header: (clips(wave, *span), span[2]) for header, span in SPANS.items()}


def _set_edges(wave: ArbitraryWave, names: tuple[str, ...], text: str) -> None:
    wave.set_edges(*names, text=text)
