"""Rigol DG822 waveform generator, SCPI over TCP: two channels, each at a coil of the world.

From pages of the DG800 Programming Guide and from public client code: outputs and switches that are
answered as ON or OFF, `0,"No error"`, numbers with seven digits as `1.000000E-01`, an open end as
9.9E+37, a channel's number that may be left out for the first (2-43), a trigger input for each
channel, N-cycle bursts whose trigger is INT, EXT or MAN, with a delay up to 100 s, `BURS:TRIG` and
`*TRG` for MAN, an idle level of a burst, limits of the output, blocks of points between 0 and 3FFF
that become the output with END (2-136). `APPL?` is answered in quotes with five parts, APPLy takes
a phase too; it does not switch the output on, which is assumed, as its defaults are (DG1000Z: 1
kHz, 5 Vpp, 0 V, 0 deg).

What is only kept has a file of its own. Assumed: what an output may give (`Ratings`); 100 mVpp
after `*RST`; that limits, levels and terminations depend on each other as in `GeneratorChannel`,
with error -221 or -222; the depth of the error queue; that both trigger inputs have the world's
trigger; that idle levels other than BOTTOM, endless bursts, and triggers from inside, do not reach
the coil. Left out: modulation, arbitrary waveforms by name, what a sweep does.
"""

from __future__ import annotations

from functools import partial
from typing import ClassVar

import numpy as np

from sim_instruments.faults.lasting import LoadReset, NoTrigger
from sim_instruments.generic.coil_channel import GeneratorChannel
from sim_instruments.generic.coil_generator import SLOPES, CoilGenerator, Held
from sim_instruments.generic.waveform import Ratings, Wave
from sim_instruments.instrument import Setting
from sim_instruments.rigol.generator_dg800_settings import (
    OUTPUT,
    PHASE,
    SOURCE,
    Counter,
    FrequencyCoupling,
    Harmonics,
    Sweep,
)
from sim_instruments.wire.requests import without_blocks
from sim_instruments.wire.scpi import (
    ScpiError,
    choice,
    numeric,
    short_of,
    within,
    word,
    words,
)
from sim_instruments.wire.scpi_device import KeptSettings, Listed, Value, kept, taken
from sim_instruments.world.piecewise import Array

SOURCES = {"EXT": "EXT", "EXTERNAL": "EXT", "MAN": "BUS", "MANUAL": "BUS"}
SOURCES |= {"INT": "IMM", "INTERNAL": "IMM"}
SOURCE_NAMES = {"EXT": "EXT", "BUS": "MAN", "IMM": "INT"}
"""By what `GeneratorChannel` calls them."""
FUNCTIONS = ("DC", "PULSe", "SINusoid", "SQUare", "RAMP", "NOISe", "USER", "HARMonic")
APPLIED_AS = {"PULS": "PULSE", "NOIS": "NOISE"}
"""What `APPL?` calls a function, where that is another word."""
MAX_DELAY_S = 100.0
PERIODS_S = (1e-7, 1e6)
BURST_PERIODS_S = (2.0166e-6, 500.0)
POINTS, FULL_SCALE = (8, 16384), 0x3FFF


class UserWave(Wave):
    """The function of one channel, which may consist of points that were sent."""

    def reset(self) -> None:
        """Go to a sine of 1 kHz; forget the points."""
        super().reset()
        self._points: list[bytes] = []
        self._values: Array = np.zeros(0)

    def levels(self) -> list[tuple[float, float]]:
        """Return one cycle as times from its start in s and the levels, -1 to 1, from then on."""
        if self.function != "USER" or not len(self._values):
            return super().levels()
        step_s = self.period_s / len(self._values)
        return [(k * step_s, float(value)) for k, value in enumerate(self._values)]

    def take(self, block: bytes, *, last: bool) -> None:
        """Take a block of points between 0 and 3FFF; the last one makes them the output."""
        values = np.frombuffer(b"".join([*self._points, block]), "<u2")
        if len(block) % 2 or len(values) > POINTS[1] or (values > FULL_SCALE).any():
            self._points = []
            raise ScpiError(-161)
        if not last:
            self._points.append(block)
            return
        self._points = []
        if len(values) < POINTS[0]:
            raise ScpiError(-161)
        self._values, self.function = values / FULL_SCALE * 2.0 - 1.0, "USER"

    @property
    def pulse_percent(self) -> float:
        """The width of the pulse as a part of the period, in %."""
        return 100.0 * self.width_s / self.period_s

    def set_pulse_duty(self, text: str) -> None:
        """Set the width of the pulse as a part of the period, in %."""
        self.set_width(str(numeric(text, 0.001, 99.999, 50.0) / 100.0 * self.period_s))


class RigolDg800(CoilGenerator):
    """The generator; its truth is that of `CoilGenerator`.

    May be given: `maker`, as `*IDN?` answers it.
    """

    model = "Rigol DG822"
    longest_line = 1 << 17
    takes_blocks = True
    number_form = ".6E"
    ratings = Ratings(10.0, 2e-3, 1e-3, (1.0, 10e3), (1 / 30e6, 1e6), 16e-9)
    highest_Hz = 25e6
    functions = FUNCTIONS
    wave_kind = UserWave
    off_is_not_triggered = True
    lasting_faults: ClassVar = (NoTrigger.kind, LoadReset.kind)

    def __init__(self, setting: Setting) -> None:
        maker = setting.truth.text("maker", "Rigol Technologies")
        self._blocks: list[bytes] = []
        self._resets: list[KeptSettings | Sweep | Harmonics | Counter | FrequencyCoupling] = []
        self._sources: dict[int, KeptSettings] = {}
        self._burst_periods_s = {1: 10e-3, 2: 10e-3}
        self._coupling = FrequencyCoupling(self._follow)
        counter = Counter()
        self._resets += [self._coupling, counter]
        super().__init__(setting, f"{maker},DG822,{setting.serial},00.02.06.00.01")
        self.add_commands(counter.commands(), "COUNter:")
        self.add_commands({"COUNter": counter.commands()["[:STATe]"]})
        coupled = self._coupling.commands("DEViation")
        self.add_commands(coupled, *(f"COUPling{n}:FREQuency" for n in ("", "1", "2")))
        self.begin_to_serve(setting)

    def reset(self) -> None:
        """Go to sines, both outputs off."""
        for part in self._resets:
            part.reset()
        self._burst_periods_s = {1: 10e-3, 2: 10e-3}
        super().reset()

    def written(self, value: str | float) -> str:
        """Return a value as the instrument answers it: a switch as ON or OFF."""
        return ("ON" if value else "OFF") if isinstance(value, bool) else super().written(value)

    def _line(self, line: bytes) -> bytes:
        # The parser splits at characters that a block may hold: in its place stands its number.
        text, self._blocks = without_blocks(line)
        return super()._line(text)

    def _add_channel(self, number: int, channel: GeneratorChannel) -> None:
        wave = channel.wave
        assert isinstance(wave, UserWave)
        held, output_held = KeptSettings(SOURCE), KeptSettings(OUTPUT)
        sweep, harmonics = Sweep(), Harmonics(lambda: channel.largest_V, self.written)
        self._resets += [held, output_held, sweep, harmonics]
        self._sources[number] = held
        # The number of the first channel may be left out, and so may SOURce.
        sources = ("SOURce1:", "SOURce:", "") if number == 1 else ("SOURce2:",)
        outputs = ("OUTPut1", "OUTPut") if number == 1 else ("OUTPut2",)
        self._add_held(channel, self._waves(number, channel, wave), *sources)
        self._add_held(channel, held.commands(), *sources)
        self._add_held(channel, {**sweep.commands(), **harmonics.commands()}, *sources)
        coupled = self._coupling.commands("OFFSet")
        self.add_commands(coupled, *(f"{root}FREQuency:COUPle" for root in sources))
        self._add_held(channel, self._acts(number, channel, wave), *sources)
        limits = self._limits(channel)
        limits[""] = limits[":STATe"]
        output = self._output(channel)
        load = Listed(
            lambda given: channel.set_load(self.only(given)),
            lambda given: self.written(
                numeric(given[0], *self.ratings.loads_ohm, 50.0) if given else channel.load_ohm
            ),
        )
        table: dict[str, Value] = {**output, **output_held.commands()}
        table |= {":LOAD": load, ":IMPedance": load}
        self._add_held(channel, table, *outputs)
        self._add_held(channel, limits, *(f"{root}:VOLLimit" for root in outputs))

    def _waves(self, number: int, channel: GeneratorChannel, wave: UserWave) -> Held:
        """Return function, frequency, levels, pulse and burst of a channel."""
        source = self._source(channel)
        take_Hz, give_Hz = source["FREQuency"]
        assert take_Hz is not None

        def set_frequency(text: str) -> None:
            take_Hz(text)
            self._coupling.changed(number, wave.frequency_Hz)

        def set_period(text: str) -> None:
            wave.set_period(numeric(text, *PERIODS_S, 1e-3))
            self._coupling.changed(number, wave.frequency_Hz)

        duty = taken(wave, "pulse_percent", wave.set_pulse_duty)
        source |= {
            "FUNCtion:SHAPe": source["FUNCtion"],
            "FREQuency": (set_frequency, give_Hz),
            "FREQuency:FIXed": (set_frequency, give_Hz),
            "PERiod[:FIXed]": (set_period, lambda: wave.period_s),
            "FUNCtion:PULSe:PERiod": (set_period, lambda: wave.period_s),
            "FUNCtion:SQUare:PERiod": (set_period, lambda: wave.period_s),
            "FUNCtion:SQUare:DCYCle": kept(wave, "duty_percent", within(0.01, 99.99, 50.0)),
            "FUNCtion:PULSe:DCYCle": duty,
            "PULSe:DCYCle": duty,
            "PULSe:WIDTh": source["FUNCtion:PULSe:WIDTh"],
            "BURSt": source["BURSt:STATe"],
            "BURSt:MODE": kept(channel, "mode", word("TRIGgered", "INFinity", "GATed")),
            "BURSt:NCYCles": (source["BURSt:NCYCles"][0], lambda: int(channel.cycles)),
            "BURSt:INTernal:PERiod": (
                lambda text: self._burst_periods_s.update(
                    {number: numeric(text, *BURST_PERIODS_S, 10e-3)}
                ),
                # One that is too short for the cycles becomes longer.
                lambda: max(self._burst_periods_s[number], wave.period_s * channel.cycles + 2e-6),
            ),
            "BURSt:TRIGger:SOURce": (
                lambda text: setattr(channel, "source", choice(text, SOURCES)),
                lambda: SOURCE_NAMES[channel.source],
            ),
            "BURSt:TRIGger:SLOPe": kept(channel, "slope", SLOPES),
            "BURSt:TDELay": kept(channel, "delay_s", within(0.0, MAX_DELAY_S, 0.0)),
        }
        return source

    def _acts(self, number: int, channel: GeneratorChannel, wave: UserWave) -> dict[str, Value]:
        return {
            "BURSt:TRIGger[:IMMediate]": partial(self._trigger, channel),
            "PHASe:INITiate": lambda: None,
            "PHASe:SYNChronize": lambda: None,
            "DATA:DAC16": Listed(partial(self._take_points, wave)),
            "TRACe:DATA:DAC16": Listed(partial(self._take_points, wave)),
            "APPLy": Listed(None, lambda _: self._shown(number, channel)),
            **{f"APPLy:{name}": Listed(partial(self._apply, number, name)) for name in FUNCTIONS},
        }

    def _take_points(self, wave: UserWave, parameters: list[str]) -> None:
        if len(parameters) < 3:
            raise ScpiError(-109)
        choice(parameters[0], words("VOLATILE"))
        last = choice(parameters[1], words("CON", "END")) == "END"
        if not (parameters[2].startswith("#") and self._blocks):
            raise ScpiError(-161)
        wave.take(self._blocks[int(parameters[2][1:])], last=last)

    def _apply(self, number: int, name: str, parameters: list[str]) -> None:
        channel, function = self._channels[number], short_of(name)
        given = ["DEF", *parameters] if function == "NOIS" else list(parameters)
        if len(given) > (3 if function in ("DC", "NOIS") else 4):
            raise ScpiError(-108)
        defaults = ("1e3", "5", "0", "0")
        given += ["DEF"] * (4 - len(given))
        frequency, amplitude, offset, phase = (
            default if text.upper() in ("DEF", "DEFAULT") else text
            for text, default in zip(given, defaults, strict=True)
        )
        frequency_Hz = numeric(frequency, 1e-6, self.highest_Hz, 1e3)
        phase_deg = numeric(phase, 0.0, 360.0, 0.0)
        channel.set_function(function)
        if function not in ("DC", "NOIS"):
            channel.wave.set_period(1.0 / frequency_Hz)
            self._sources[number].values[PHASE] = phase_deg
            self._coupling.changed(number, channel.wave.frequency_Hz)
        if function == "SQU":
            channel.wave.duty_percent = 50.0
        channel.burst = False
        if function != "DC":
            channel.set_offset("0")
            channel.set_amplitude(amplitude)
        channel.set_offset(offset)

    def _shown(self, number: int, channel: GeneratorChannel) -> str:
        function = channel.wave.function
        phase_deg = self._sources[number].values[PHASE]
        values = (channel.wave.frequency_Hz, channel.amplitude_V, channel.offset_V, phase_deg)
        shown = [APPLIED_AS.get(function, function), *map(self.written, values)]
        return f'"{",".join(shown)}"'

    def _follow(self, number: int, frequency_Hz: float) -> None:
        channel = self._channels[number]
        channel.wave.set_period(1.0 / frequency_Hz)
        channel.apply(self._clock.now())

    def _complain(self, code: int, more: str) -> None:
        self.refuse(code)
