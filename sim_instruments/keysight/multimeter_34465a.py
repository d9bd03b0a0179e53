"""Keysight 34465A digital multimeter, SCPI over TCP.

From the Truevolt guide and public client code: LF ends commands and replies, `+0,"No error"` ends
an error queue of 20, readings look like `+1.23456789E+00`, an overload reads ±9.9E+37 and sets an
event bit once for each INITiate, the condition register says whether it measures (16) or waits for
a trigger (32), FETCh? and READ? wait for the burst and leave it in the memory, R? and DATA:REMove?
take it out, new settings and INITiate forget it. NULL and CALC have a file of their own. Assumed:
error texts, and that settings changed in the middle of a burst end it. What the world connects is
measured; other functions read what an open input reads. Left out: temperature.
"""

from __future__ import annotations

from functools import partial
from typing import ClassVar

import numpy as np

from sim_instruments.faults.lasting import Frozen, Overload
from sim_instruments.generic.converter import Converter, Function
from sim_instruments.instrument import Setting
from sim_instruments.keysight.multimeter_34465a_math import Math
from sim_instruments.keysight.multimeter_34465a_settings import HEADERS, Sense
from sim_instruments.keysight.multimeter_34465a_trigger import TriggerSystem, trigger_commands
from sim_instruments.wire.requests import released
from sim_instruments.wire.scpi import (
    ScpiError,
    boolean,
    choice,
    single_parameter,
    whole_number,
    words,
)
from sim_instruments.wire.scpi_device import Listed, ScpiDevice, kept, taken
from sim_instruments.world.piecewise import Array

FIRMWARE = "A.03.01-03.15-03.01-00.52-04-02"
OPTIONS = "DIG,MEM"
MEMORY = 2_000_000
MEASURING, WAITING, CHANGED, ANY_ERROR = 16, 32, 256, 8192
MEMORY_OVERFLOW = 16384
NOT_A_NUMBER = 9.91e37
CONFIGURED = {
    "[:VOLTage][:DC]": "VOLT",
    "[:VOLTage]:AC": "VOLT:AC",
    "[:VOLTage][:DC]:RATio": "VOLT:RAT",
    ":CURRent[:DC]": "CURR",
    ":CURRent:AC": "CURR:AC",
    ":RESistance": "RES",
    ":FRESistance": "FRES",
    ":FREQuency": "FREQ",
    ":PERiod": "PER",
    ":CAPacitance": "CAP",
    ":CONTinuity": "CONT",
    ":DIODe": "DIOD",
}
IDENTITIES = {
    "DEF": "Keysight Technologies,34465A",
    "AT34410A": "Agilent Technologies,34410A",
    "AT34411A": "Agilent Technologies,34411A",
}
"""What `SYSTem:IDENtify` makes of maker and model (Truevolt guide, p.270); it outlasts `*RST`."""


class Keysight34465A(ScpiDevice):
    """The meter, in whatever simulated world has something for it to measure.

    Truth (`simulator` mapping): see `Converter`; `identity` may be given, what `SYSTem:IDENtify`
    was set to: DEF, AT34410A or AT34411A.
    """

    model = "Keysight 34465A"
    at_once = False

    lasting_faults: ClassVar = (Frozen.kind, Overload.kind)

    def __init__(self, setting: Setting) -> None:
        super().__init__("", '+0,"No error"')
        self._serial, self._beeps = setting.serial, True
        self._identify(setting.truth.text("identity", "DEF"))
        self._clock, self._lock = setting.clock, setting.world.lock
        self._converter = Converter(setting)
        self._trigger = TriggerSystem()
        self._readings: list[Array] = []
        self._changed_since, self._overflowed, self._overload_reported = True, False, False
        self._display, self._lit = '""', True
        self._sense = Sense(self._converter, self._settings_changed, self._clock.now)
        self._math = Math(self._sense.functions, lambda: self._sense.chosen)
        self._add_all()
        self.begin_to_serve(setting, self._lock)

    def operation_condition(self) -> int:
        """Return whether it measures or waits, got something new, or has an error to report."""
        bits = 0 if self._trigger.idle else MEASURING
        bits |= WAITING if self._trigger.waiting else 0
        bits |= CHANGED if self._changed_since else 0
        return bits | (ANY_ERROR if self.errors else 0)

    def questionable_condition(self) -> int:
        """Return whether readings were lost or beyond limits; overloads are events only."""
        return self._math.limits.failed | (MEMORY_OVERFLOW if self._overflowed else 0)

    def reset(self) -> None:
        """Go to DC volts, one reading for each READ?."""
        self._trigger.reset()
        self._sense.reset()
        self._math.reset()
        self._settings_changed()

    def before_each(self) -> None:
        """Take the readings that have become finished into the memory."""
        starts_s = self._trigger.finished(self._clock.now(), MEMORY)
        if not len(starts_s):
            return
        used = self._sense.chosen
        values = self._converter.read(used, starts_s)
        if (np.abs(values) >= NOT_A_NUMBER * 0.99).any() and not self._overload_reported:
            self.questionable.latch(used.overload_bit)
            self._overload_reported = True
        self._readings.append(self._math.of(values))
        if self._count() > MEMORY:
            self._readings = [np.concatenate(self._readings)[-MEMORY:]]
            self._overflowed = True

    def _settings_changed(self) -> None:
        self._trigger.stop()
        self._math.function_changed()
        self._readings, self._overflowed = [], False
        self._changed_since = True

    def _count(self) -> int:
        return sum(len(part) for part in self._readings)

    def _add_all(self) -> None:
        trigger = self._trigger
        self.add_commands(
            {
                "INITiate[:IMMediate]": self._initiate,
                "ABORt": trigger.stop,
                "*TRG": lambda: trigger.trigger(self._clock.now()),
                "FETCh?": self._fetch,
                "READ?": self._read,
                "*OPC?": self._operation_complete_when_idle,
                "*WAI": self._wait,
                "DATA:LAST?": self._last,
                "DATA:POINts?": lambda: f"{self._count():+d}",
                "SYSTem:LFRequency?": lambda: f"{self._converter.line_frequency_Hz:+.0f}",
                "SYSTem:PRESet": self.reset,
                "SYSTem:BEEPer[:IMMediate]": lambda: None,
                "SYSTem:BEEPer:STATe": kept(self, "_beeps", boolean),
                "SYSTem:IDENtify": taken(self, "_identity", self._identify),
                "SYSTem:LICense:CATalog?": lambda: '"' + OPTIONS.replace(",", '","') + '"',
                "*OPT?": lambda: OPTIONS,
                "ROUTe:TERMinals?": lambda: "FRON",
                "FORMat[:DATA]": Listed(self._set_format),
                "FORMat[:DATA]?": lambda: "ASC,9",
                "R": Listed(None, self._remove_block),
                "DATA:REMove": Listed(None, self._remove),
                "DISPlay[:STATe]": kept(self, "_lit", boolean),
                "DISPlay:TEXT[:DATA]": kept(self, "_display", str),
                "DISPlay:TEXT:CLEar": lambda: setattr(self, "_display", '""'),
            }
        )
        for header, name in CONFIGURED.items():
            function = self._sense.functions[name]
            configure = Listed(partial(self._configure, function))
            measure = Listed(None, partial(self._measure, function))
            self.add_commands({f"CONFigure{header}": configure, f"MEASure{header}": measure})
        self._sense.add_to(self)
        self._math.add_to(self)
        for name, header in HEADERS.items():
            self.add_commands(self._math.null_commands(name), f"{header}:", f"SENSe:{header}:")
        commands = trigger_commands(trigger, self._least_period_s)
        self.add_commands(commands, after=self._settings_changed)

    def _configure(self, function: Function, parameters: list[str]) -> None:
        self._trigger.reset()
        self._sense.configure(function, parameters)
        self._math.reset()

    def _measure(self, function: Function, parameters: list[str]) -> str:
        self._configure(function, parameters)
        return self._read()

    def _identify(self, text: str) -> None:
        self._identity = choice(text, words("DEFault", "AT34410A", "AT34411A"))
        self.identity = f"{IDENTITIES[self._identity]},{self._serial},{FIRMWARE}"

    def _set_format(self, parameters: list[str]) -> None:
        choice("".join(parameters[:1]), words("ASCii"))

    def _least_period_s(self) -> float:
        return self._trigger.least_period_s(self._converter.busy_s(self._sense.chosen))

    def _initiate(self) -> None:
        self._trigger.initiate(self._clock.now(), self._converter.busy_s(self._sense.chosen))
        self._readings, self._overflowed = [], False
        self._changed_since = self._overload_reported = False
        self._math.clear()

    def _wait(self) -> None:
        """Wait until it is idle; ScpiError -214 when that needs a trigger by this very line."""
        while not self._trigger.idle:
            if self._trigger.waiting:
                raise ScpiError(-214)
            with released(self._lock):  # the world goes on meanwhile, and others are served
                self._clock.sleep_until(self._trigger.end_s)
            self.before_each()

    def _operation_complete_when_idle(self) -> str:
        self._wait()
        return "1"

    def _fetch(self) -> str:
        self._wait()
        if not self._readings:
            raise ScpiError(-230)
        return readings_text(np.concatenate(self._readings))

    def _read(self) -> str:
        if self._trigger.source == "BUS":
            raise ScpiError(-214)
        self._initiate()
        return self._fetch()

    def _last(self) -> str:
        last = float(self._readings[-1][-1]) if self._readings else NOT_A_NUMBER
        return f"{last:+.8E} {self._sense.chosen.unit}"

    def _take(self, most: int) -> Array:
        kept = np.concatenate(self._readings) if self._readings else np.empty(0)
        self._readings = [kept[most:]] if len(kept) > most else []
        return kept[:most]

    def _remove(self, parameters: list[str]) -> str:
        count = whole_number(single_parameter(parameters), 1, MEMORY)
        if self._count() < count:
            raise ScpiError(-222)
        return readings_text(self._take(count))

    def _remove_block(self, parameters: list[str]) -> str:
        most = whole_number(single_parameter(parameters), 1, MEMORY) if parameters else MEMORY
        text = readings_text(self._take(most))
        length = str(len(text))
        return f"#{len(length)}{length}{text}"


def readings_text(values: Array) -> str:
    """Return readings as the meter writes them."""
    return ",".join(f"{value:+.8E}" for value in values.tolist())
