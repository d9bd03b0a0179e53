"""Keithley DMM6500 digital multimeter, SCPI over TCP.

From public notes that quote the manual DMM6500-901-01 Rev. A with its pages, and from what clients
record of units: names of functions that are answered without quotes, `0,"No error;0;0 0"` for an
empty error queue and entries with a severity and a time, readings as `-4.999995E-01`, an overload
as 9.9E+37, integration times from 0.0005 cycles to 12 or at 60 Hz 15, a buffer of 100,000 readings
that keeps the newest and that reading does not empty, `TRIG:STAT?` with two states and the number
of a block, a command set that changes at the next start only. Assumed: 20 % over-range up to 100 V,
a reading with auto-zero takes twice as long, settings are refused while it measures (-221), a
second INIT too (-213), as INIT without a loaded loop (-221), the depth of the error queue, the
numbers of blocks. Only DC volts are connected; other functions read zero or an open input.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Any, ClassVar

import numpy as np

from sim_instruments.faults.lasting import Frozen, Overload
from sim_instruments.generic.converter import Converter, Function
from sim_instruments.instrument import Setting
from sim_instruments.keithley.multimeter_dmm6500_loop import SimpleLoop
from sim_instruments.wire.requests import released
from sim_instruments.wire.scpi import (
    ErrorQueue,
    ScpiError,
    boolean,
    choice,
    numeric,
    single_parameter,
    unquoted,
    whole_number,
    word,
    words,
)
from sim_instruments.wire.scpi_device import Listed, Pair, ScpiDevice
from sim_instruments.world.piecewise import Array

LANGUAGES = ("SCPI", "TSP", "SCPI2000", "SCPI34401")
BUFFER, CAPACITY = "defbuffer1", 100_000
HEADERS = {
    "VOLT:DC": "VOLTage[:DC]",
    "VOLT:AC": "VOLTage:AC",
    "CURR:DC": "CURRent[:DC]",
    "RES": "RESistance",
    "FRES": "FRESistance",
}
NAMES = {"VOLTAGE": "VOLT", "CURRENT": "CURR", "RESISTANCE": "RES", "FRESISTANCE": "FRES"}
MIN_CYCLES = 0.0005


class EventLog(ErrorQueue):
    """Its errors, each with the severity and the time."""

    overflow = 0

    def __init__(self, depth: int, now_s: Callable[[], float]) -> None:
        super().__init__(depth, '0,"No error;0;0 0"')
        self._now_s = now_s

    def entry(self, text: str, code: int) -> str:
        """Return an error as it is answered."""
        at = datetime.fromtimestamp(self._now_s(), UTC).strftime("%Y/%m/%d %H:%M:%S.%f")[:-3]
        return super().entry(f"{text};1;{at}", code)


@dataclass
class Measured(Function):
    """A function with what this meter has besides: its input, and what may be put on readings."""

    high_input: str = "MOHM10"
    filtered: bool = False
    nulled: bool = False
    scaled: bool = False


def functions() -> dict[str, Measured]:
    """Return the functions as after `*RST`, by the name that `SENS:FUNC?` gives."""
    volts = (0.1, 1.0, 10.0, 100.0, 1000.0)
    amperes = (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 3.0)
    ohms = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
    return {
        # The converter knows its functions by the short names of SCPI.
        "VOLT:DC": Measured("VOLT", "VDC", volts, 1, range=1000.0, cycles=1.0),
        "VOLT:AC": Measured("VOLT:AC", "VAC", (0.1, 1.0, 10.0, 100.0, 750.0), 1, range=750.0),
        "CURR:DC": Measured("CURR", "ADC", amperes, 2, range=3.0, cycles=1.0),
        "RES": Measured("RES", "OHM", ohms, 512, range=1e8, cycles=1.0),
        "FRES": Measured("FRES", "OHM", ohms, 512, range=1e8, cycles=1.0),
    }


class KeithleyDmm6500(ScpiDevice):
    """The meter, in whatever simulated world has something for it to measure.

    Truth (`simulator` mapping): see `Converter`; `command_set` may be given: SCPI, TSP, SCPI2000
    or SCPI34401.
    """

    model = "Keithley DMM6500"
    at_once = False
    number_form = ".7G"

    lasting_faults: ClassVar = (Frozen.kind, Overload.kind)

    def __init__(self, setting: Setting) -> None:
        super().__init__(f"KEITHLEY INSTRUMENTS,MODEL DMM6500,{setting.serial},1.7.12b")
        self._clock, self._lock = setting.clock, setting.world.lock
        self.errors = EventLog(self.error_queue_depth, self._clock.now)
        self._language = setting.truth.word("command_set", LANGUAGES, "SCPI")
        self._converter = Converter(setting)
        self._loop = SimpleLoop()
        self._functions = functions()
        self._chosen = "VOLT:DC"
        self._values = np.empty(0)
        self._add_all()
        self.begin_to_serve(setting, self._lock)

    def execute(self, message: str) -> str | None:
        """Carry out one message; another command set than SCPI knows common commands alone."""
        if self._language != "SCPI" and not message.startswith("*"):
            return None
        return super().execute(message)

    def reset(self) -> None:
        """Go to DC volts on its highest range with autoranging, the buffer empty."""
        self._loop.stop()
        self._functions, self._chosen = functions(), "VOLT:DC"
        self._values = np.empty(0)

    def before_each(self) -> None:
        """Take the readings that have become finished into the buffer."""
        starts_s = self._loop.finished(self._clock.now(), CAPACITY)
        if len(starts_s):
            new = self._converter.read(self._functions[self._chosen], starts_s)
            self._values = np.concatenate([self._values, new])[-CAPACITY:]

    def _add_all(self) -> None:
        loop = self._loop
        self.add_commands(
            {
                # Another command set takes effect at the next start.
                "*LANG": (word(*LANGUAGES), lambda: self._language),
                "SYSTem:LFRequency?": lambda: f"{self._converter.line_frequency_Hz:.0f}",
                "ROUTe:TERMinals?": lambda: "FRON",
                "FORMat[:DATA]": (word("ASCii"), lambda: "ASC"),
                "TRIGger:STATe?": lambda: loop.state,
                "INITiate[:IMMediate]": self._initiate,
                "ABORt": loop.stop,
                "READ?": self._read,
                "FETCh?": lambda: self._part(len(self._values), len(self._values)),
                "*OPC?": lambda: self._when_idle("1"),
                "*WAI": lambda: self._when_idle(""),
                "TRIGger:LOAD": Listed(loop.load),
                "TRACe:CLEar": Listed(self._clear_buffer),
                "TRACe:ACTual": Listed(None, lambda p: str(len(self._values)) * buffered(p)),
                "TRACe:POINts": Listed(None, lambda p: str(CAPACITY) * buffered(p)),
                "TRACe:DATA": Listed(None, self._data),
            }
        )
        self.add_commands({"FUNCtion": (self._choose, lambda: self._chosen)}, "", "SENSe:")
        for name, header in HEADERS.items():
            self.add_commands(self._function(name), f"{header}:", f"SENSe:{header}:")
            scaled = {"MATH:STATe": self._held(name, "scaled", boolean)}
            self.add_commands(scaled, f"CALCulate:{header}:")

    def _function(self, name: str) -> dict[str, Pair]:
        return {
            "RANGe[:UPPer]": (
                partial(self._set_range, name),
                lambda: self._functions[name].range,
            ),
            "RANGe:AUTO": self._held(name, "autorange", boolean),
            "NPLCycles": self._held(name, "cycles", self._cycles),
            "AZERo[:STATe]": self._held(name, "zero_on", boolean),
            "INPutimpedance": self._held(name, "high_input", word("AUTO", "MOHM10")),
            "AVERage[:STATe]": self._held(name, "filtered", boolean),
            "RELative:STATe": self._held(name, "nulled", boolean),
        }

    def _held(self, name: str, what: str, read: Callable[[str], object]) -> Pair:
        return (
            lambda text: self._set(name, what, read(text)),
            lambda: getattr(self._functions[name], what),
        )

    def _set(self, name: str, what: str, value: Any) -> None:
        if self._loop.runs:
            raise ScpiError(-221)
        setattr(self._functions[name], what, value)

    def _set_range(self, name: str, text: str) -> None:
        ranges = self._functions[name].ranges
        wanted = numeric(text, ranges[0], ranges[-1], ranges[-1]) if text[:1] != "-" else -1.0
        if wanted < 0.0:
            raise ScpiError(-222)
        self._set(name, "range", next(full_scale for full_scale in ranges if wanted <= full_scale))
        self._set(name, "autorange", False)

    def _cycles(self, text: str) -> float:
        most = 15.0 if self._converter.line_frequency_Hz == 60.0 else 12.0
        return numeric(text, MIN_CYCLES, most, 1.0)

    def _choose(self, text: str) -> None:
        words = unquoted(text).upper().split(":")
        name = ":".join([NAMES.get(words[0], words[0]), *words[1:]])
        name = {"VOLT": "VOLT:DC", "CURR": "CURR:DC"}.get(name, name)
        if name not in self._functions:
            raise ScpiError(-224)
        if self._loop.runs:
            raise ScpiError(-221)
        self._chosen = name

    def _initiate(self) -> None:
        busy_s = self._converter.busy_s(self._functions[self._chosen])
        self._loop.initiate(self._clock.now(), busy_s)

    def _clear_buffer(self, parameters: list[str]) -> None:
        if buffered(parameters):
            self._values = np.empty(0)

    def _data(self, parameters: list[str]) -> str:
        if len(parameters) < 2:
            raise ScpiError(-109)
        buffered(parameters[2:3])
        for element in parameters[3:]:
            choice(element, words("READing"))
        first, last = (whole_number(text, 1, CAPACITY) for text in parameters[:2])
        return self._part(first, last)

    def _part(self, first: int, last: int) -> str:
        if not 1 <= first <= last <= len(self._values):
            raise ScpiError(-222)
        return readings_text(self._values[first - 1 : last])

    def _read(self) -> str:
        self._loop.load(['"SimpleLoop"', "1"])
        self._initiate()
        self._when_idle("")
        return readings_text(self._values[-1:])

    def _when_idle(self, reply: str) -> str:
        while self._loop.runs:
            with released(self._lock):  # the world goes on meanwhile, and others are served
                self._clock.sleep_until(self._loop.end_s)
            self.before_each()
        return reply


def buffered(parameters: list[str]) -> bool:
    """Check that the buffer that is named, if any, is the only one there is; -224 otherwise."""
    if parameters and unquoted(single_parameter(parameters)).lower() != BUFFER:
        raise ScpiError(-224)
    return True


def readings_text(values: Array) -> str:
    """Return readings as the meter writes them."""
    return ",".join(f"{value:.6E}" for value in values.tolist())
