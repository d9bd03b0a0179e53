"""Kepco BOP 72-14MG of the 1 kW family, with a waveform generator in its LIST system.

From a third party's programming guide: a segment `LIST:CURR:APPL SINE,f,peak-to-peak[,offset]`
between 0.01 Hz and 1.8 Hz takes 3840 of 3933 points, so that no second one fits; `CURR:MODE FIX`
stays at the point where the list is, `CURR:MODE HALT` goes on to the end of the cycle; in current
mode `VOLT:PROT` is a clamp; nothing at the output before `SYST:REM ON` on a serial line. What no
source at hand says, and is assumed: that this refusal is -203; that it holds on every line; that a
sine starts at zero; `LIST:CURR:APPL:SWE` and the other waveforms are left out, refused with -224.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from sim_instruments.instrument import Setting
from sim_instruments.kepco.bop import KepcoBop
from sim_instruments.kepco.output import Output
from sim_instruments.kepco.output_list import ListMemory
from sim_instruments.wire.scpi import Handler, ScpiError, boolean, number, whole_number, word
from sim_instruments.wire.scpi_device import KeptSettings, KeptTable, Listed, Value, kept

RATED = {"CURR": 14.0, "VOLT": 72.0}
MAX_POINTS, SINE_POINTS = 3933, 3840
LOWEST_HZ, HIGHEST_HZ = 0.01, 1.8
OUTPUT_KEPT: KeptTable = {
    "OUTPut:MODE": (word("ACTIVE", "RESISTIVE", "BATTERY"), "ACTIVE"),
    "OUTPut:CONTrol": (word("HIGH", "LOW", "STAN", "OFF"), "STAN"),
}


NUMBER = re.compile(r"[+-]?(\d*)\.?(\d*)")
LARGEST_NUMBER = 6500.9999
TRAILING = re.compile(r"\.?0+E(?=-?\d)")


def fits(parameter: str) -> bool:
    """Return whether a number, if it is one, has at most 4 digits before and 8 after the point.

    Manual of the 1 kW family, p.B-2: beyond these, and above 6500.9999, it is refused with -120.
    """
    match = NUMBER.fullmatch(parameter)
    if match is None or not (match[1] or match[2]):
        return True
    short = len(match[1]) <= 4 and len(match[2]) <= 8
    return short and abs(float(parameter)) <= LARGEST_NUMBER


class ClampedOutput(Output):
    """An output whose voltage protection holds the voltage within itself, in current mode."""

    rated: ClassVar[Mapping[str, float]] = RATED
    trips: ClassVar[tuple[str, ...]] = ("CURR",)

    def _compliance_A(self) -> float:
        clamp_V = min(self.protections["VOLT", "POS"], self.protections["VOLT", "NEG"])
        return float(min(clamp_V, self._sagging_V)) / self.coil.resistance_ohm


class GeneratedList(ListMemory):
    """A list memory that the instrument fills itself."""

    def add_sine(self, frequency_Hz: float, amplitude: float, offset: float) -> None:
        """Append a period of a sine; -223 when it does not fit."""
        if len(self.points["CURR"]) + SINE_POINTS > MAX_POINTS:
            raise ScpiError(-223)
        angle = 2.0 * np.pi * np.arange(SINE_POINTS) / SINE_POINTS
        self.points["CURR"] += (offset + amplitude * np.sin(angle)).tolist()
        self.dwells += [1.0 / (frequency_Hz * SINE_POINTS)] * SINE_POINTS


class KepcoBop1kW(KepcoBop):
    """One supply, driving one coil of the simulated world; its truth is that of `KepcoBop`."""

    model = "Kepco BOP 72-14MG"
    command_s: ClassVar[float] = 0.0
    identities: ClassVar[Mapping[str, str]] = {
        "plain": "KEPCO,BOP 72-14MG,{serial},2.24",
        "firmware-2": "KEPCO,BOP1KW 72-14 ,{serial}, 2.01",
        "calibration-date": "KEPCO,BOP 72-14MG,05-11-2021,{serial},4.05",
    }
    output_stage = ClampedOutput

    def __init__(self, setting: Setting) -> None:
        self._remote = False
        super().__init__(setting)

    def _add_source(self) -> None:
        super()._add_source()
        self.add_commands(KeptSettings(OUTPUT_KEPT).commands())

    def _list_commands(self) -> dict[str, Value]:
        memory = self._list = GeneratedList()
        return {
            "CLEar": memory.clear,
            "COUNt": kept(memory, "count", partial(whole_number, minimum=0, maximum=255)),
            "CURRent:APPLy": Listed(partial(self._add_waveform, memory)),
        }

    def _leave_list(self, now_s: float) -> None:
        self._output.stay(now_s)

    def _lookup(self, message: str) -> list[tuple[Handler | ScpiError, list[str]]]:
        return [
            (handler if all(map(fits, parameters)) else ScpiError(-120), parameters)
            for handler, parameters in super()._lookup(message)
        ]

    def execute(self, message: str) -> str | None:
        """Carry out one message; numbers are answered without zeros at their end."""
        reply = super().execute(message)
        return reply and TRAILING.sub("E", reply)

    def _set_remote(self, text: str) -> None:
        self._remote = boolean(text)

    def _set_output(self, parameters: list[str]) -> None:
        if not self._remote:
            raise ScpiError(-203)
        super()._set_output(parameters)

    def _set_mode(self, kind: str, parameters: list[str]) -> None:
        if [text.upper() for text in parameters] == ["HALT"]:
            if self._mode[kind] == "LIST":
                self._ends_s = self._output.halt(self._clock.now())
            return
        super()._set_mode(kind, parameters)

    def _add_waveform(self, memory: GeneratedList, parameters: list[str]) -> None:
        if len(parameters) not in (3, 4):
            raise ScpiError(-109 if len(parameters) < 3 else -108)
        if parameters[0].upper() != "SINE":
            raise ScpiError(-224)
        frequency_Hz, peak_to_peak, offset = map(number, (*parameters[1:], "0")[:3])
        if not LOWEST_HZ <= frequency_Hz <= HIGHEST_HZ or peak_to_peak < 0:
            raise ScpiError(-222)
        for level in (offset + peak_to_peak / 2, offset - peak_to_peak / 2):
            self._output.check_level("CURR", level)
        memory.add_sine(frequency_Hz, peak_to_peak / 2, offset)
