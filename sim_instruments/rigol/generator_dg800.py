"""Rigol DG822 waveform generator, SCPI over TCP: two channels, each at a coil of the world.

From pages of the DG800 Programming Guide and from public client code: outputs and switches that are
answered as ON or OFF, `0,"No error"`, numbers with seven digits as `1.000000E-01`, an open end as
9.9E+37, a trigger input for each channel, N-cycle bursts whose trigger is INT, EXT or MAN, with a
delay up to 100 s, `BURS:TRIG` and `*TRG` for MAN, an idle level of a burst, limits of the output.
Assumed: what an output may give (`Ratings`); that limits, levels and terminations depend on each
other as in `GeneratorChannel`, with error -221 or -222; the depth of the error queue; that both
trigger inputs have the world's trigger; that idle levels other than BOTTOM, and triggers from
inside, do not reach the coil.
"""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from sim_instruments.faults.lasting import LoadReset, NoTrigger
from sim_instruments.generic.coil_channel import GeneratorChannel
from sim_instruments.generic.coil_generator import SLOPES, CoilGenerator, Held
from sim_instruments.generic.waveform import Ratings
from sim_instruments.instrument import Setting
from sim_instruments.wire.scpi import choice, numeric, within, word
from sim_instruments.wire.scpi_device import KeptSettings, kept, taken

SOURCES = {"EXT": "EXT", "EXTERNAL": "EXT", "MAN": "BUS", "MANUAL": "BUS"}
SOURCES |= {"INT": "IMM", "INTERNAL": "IMM"}
SOURCE_NAMES = {"EXT": "EXT", "BUS": "MAN", "IMM": "INT"}
"""By what `GeneratorChannel` calls them."""
IDLE = {"BURSt:IDLE": (word("FPT", "TOP", "CENTER", "BOTTOM"), "FPT")}
MAX_DELAY_S = 100.0


class RigolDg800(CoilGenerator):
    """The generator; its truth is that of `CoilGenerator`.

    May be given: `maker`, as `*IDN?` answers it.
    """

    model = "Rigol DG822"
    number_form = ".6E"
    ratings = Ratings(10.0, 2e-3, 1e-3, (1.0, 10e3), (1 / 30e6, 1e6), 16e-9)
    highest_Hz = 25e6
    functions = ("DC", "PULSe", "SINusoid", "SQUare", "RAMP", "NOISe")
    off_is_not_triggered = True
    lasting_faults: ClassVar = (NoTrigger.kind, LoadReset.kind)

    def __init__(self, setting: Setting) -> None:
        maker = setting.truth.text("maker", "Rigol Technologies")
        self._idles: list[KeptSettings] = []
        super().__init__(setting, f"{maker},DG822,{setting.serial},00.02.06.00.01")
        self.begin_to_serve(setting)

    def reset(self) -> None:
        """Go to sines, both outputs off."""
        for idle in self._idles:
            idle.reset()
        super().reset()

    def written(self, value: str | float) -> str:
        """Return a value as the instrument answers it: a switch as ON or OFF."""
        return ("ON" if value else "OFF") if isinstance(value, bool) else super().written(value)

    def _add_channel(self, number: int, channel: GeneratorChannel) -> None:
        wave, idle = channel.wave, KeptSettings(IDLE)
        self._idles.append(idle)
        source, limits = self._source(channel), self._limits(channel)
        limits[""] = limits[":STATe"]
        source |= idle.commands() | {
            "FUNCtion:SHAPe": source["FUNCtion"],
            "FREQuency:FIXed": source["FREQuency"],
            "BURSt": source["BURSt:STATe"],
            "FUNCtion:PULSe:PERiod": taken(
                wave, "period_s", lambda text: wave.set_period(numeric(text, 1e-7, 1e6, 1e-3))
            ),
            "BURSt:NCYCles": (source["BURSt:NCYCles"][0], lambda: int(channel.cycles)),
            "BURSt:TRIGger:SOURce": (
                lambda text: setattr(channel, "source", choice(text, SOURCES)),
                lambda: SOURCE_NAMES[channel.source],
            ),
            "BURSt:TRIGger:SLOPe": kept(channel, "slope", SLOPES),
            "BURSt:TDELay": kept(channel, "delay_s", within(0.0, MAX_DELAY_S, 0.0)),
        }
        output: Held = self._output(channel)
        output[":IMPedance"] = output[":LOAD"]
        self._add_held(channel, source, f"SOURce{number}:")
        self._add_held(channel, output, f"OUTPut{number}")
        self._add_held(channel, limits, f"OUTPut{number}:VOLLimit")
        start = {"BURSt:TRIGger[:IMMediate]": partial(self._trigger, channel)}
        self.add_commands(start, f"SOURce{number}:")

    def _complain(self, code: int, more: str) -> None:
        self.refuse(code)
