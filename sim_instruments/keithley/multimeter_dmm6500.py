"""Keithley DMM6500 digital multimeter, SCPI over TCP.

From public notes that quote the manual DMM6500-901-01 Rev. A with its pages, and from what clients
record of units: names of functions that are answered without quotes, `0,"No error;0;0 0"` for an
empty error queue and entries with a severity and a time, readings as `-4.999995E-01`, an overload
as 9.9E+37, integration times from 0.0005 cycles to 12 or at 60 Hz 15, a command set that changes at
the next start only, a date as `Thu Sep 21 09:06:41 2023`, frequencies of nothing as 0. READ?, MEAS?
and TRAC:TRIG take `SENS:COUN` readings into a buffer and answer the newest; MEAS:<function>?
chooses the function before; `SENS:FUNC?` answers NONE while it digitizes, and the other way round.
Functions, buffers and the trigger model have files of their own. Timers (2461 manual of the same
family, 6-236 to 6-242) and what a scan would do are kept only: no scanner card is in the slot, and
what its commands answer without a card is not known: they are unknown here. Left out: readings in
binary, limits, configuration lists, blocks of the trigger model.

Assumed: 20 % over-range up to 100 V, a reading with auto-zero takes twice as long, settings are
refused while it measures (-221), a second INIT too (-213), as INIT without a loaded loop (-221),
the depth of the error queue, the numbers of blocks, the bounds of scans. What the world connects is
measured; other functions read what an open input reads.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any, ClassVar

import numpy as np

from sim_instruments.faults.lasting import Frozen, Overload
from sim_instruments.generic.burst import BETWEEN_READINGS_S
from sim_instruments.generic.converter import OVERLOAD_READING, Converter
from sim_instruments.instrument import Setting
from sim_instruments.keithley.multimeter_dmm6500_buffers import CAPACITY, FULL, TEXTS, Buffers
from sim_instruments.keithley.multimeter_dmm6500_functions import (
    HAS,
    FunctionCommands,
    Readings,
    functions,
    named,
)
from sim_instruments.keithley.multimeter_dmm6500_loop import SimpleLoop
from sim_instruments.wire.requests import released
from sim_instruments.wire.scpi import (
    ErrorQueue,
    ScpiError,
    boolean,
    choice,
    number,
    numeric,
    unquoted,
    whole_number,
    word,
    words,
)
from sim_instruments.wire.scpi_device import (
    KeptSettings,
    KeptTable,
    Listed,
    ScpiDevice,
    Value,
)

LANGUAGES = ("SCPI", "TSP", "SCPI2000", "SCPI34401")
BEGAN = datetime(2026, 1, 1, tzinfo=UTC)
"""What its clock shows when its world begins."""
EMPTY_LOG = '0,"No error;0;0 0"'
DIGITIZES = ("DIG:VOLT", "DIG:CURR")
MAX_COUNT, MAX_DIGITIZED = 1_000_000, 55_000_000
SCREENS = (
    *("HOME", "HOME_LARGe_reading", "READing_table", "GRAPh", "HISTogram", "PROCessing"),
    *("SWIPE_FUNCtions", "SWIPE_GRAPh", "SWIPE_SECondary", "SWIPE_SETTings", "SWIPE_STATistics"),
    *("SWIPE_USER", "SWIPE_CHANnel", "SWIPE_NONSwitch", "SWIPE_SCAN"),
    *("CHANNEL_CONTrol", "CHANNEL_SETTings", "CHANNEL_SCAN"),
)
LIGHTS = ("ON100", "ON75", "ON50", "ON25", "OFF", "BLACkout")
EVENTS = ("ERRor", "WARNing", "INFormational", "ALL")
STIMULI = (
    *("NONE", "DISPlay", "COMMand", "EXTernal"),
    *(f"{event}{n}" for event in ("NOTify", "TIMer") for n in range(1, 5)),
)
LONGEST_TEXT = {1: 20, 2: 32}


def endless_or(most: float) -> Callable[[str], float]:
    """Return what reads a count, or INF for one without end."""
    endless = ("INF", "INFINITY")
    return lambda text: OVERLOAD_READING if text.upper() in endless else numeric(text, 1, most, 1)


TIMER: KeptTable = {
    "DELay": (lambda text: numeric(text, 8e-6, 100e3, 10e-6), 10e-6),
    "COUNt": (lambda text: whole_number(text, 0, 1_048_575), 1),
    "STARt:STIMulus": (word(*STIMULI), "NONE"),
    "STATe": (boolean, False),
}
KEPT: KeptTable = {
    "FORMat[:DATA]": (word("ASCii"), "ASC"),
    "ROUTe:SCAN:COUNt:SCAN": (endless_or(1e8), 1.0),
    "ROUTe:SCAN:INTerval": (lambda text: numeric(text, 0.0, 100e3, 0.0), 0.0),
    **{
        f"TRIGger:TIMer{n}:{header}": setting
        for n in range(1, 5)
        for header, setting in TIMER.items()
    },
}


class EventLog(ErrorQueue):
    """Its errors, each with the severity and the time."""

    overflow = 0

    def __init__(self, depth: int, date: Callable[[], datetime]) -> None:
        super().__init__(depth, EMPTY_LOG, TEXTS)
        self._date = date

    def entry(self, text: str, code: int) -> str:
        """Return an error as it is answered."""
        at = self._date().strftime("%Y/%m/%d %H:%M:%S.%f")[:-3]
        return f'{code},"{text};1;{at}"'


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
        self._shift = timedelta(0)
        self.errors = EventLog(self.error_queue_depth, lambda: self._date(self._clock.now()))
        self._language = setting.truth.word("command_set", LANGUAGES, "SCPI")
        self._converter = Converter(setting)
        self._readings = Readings(self._converter)
        self._buffers = Buffers(self._date)
        self._loop = SimpleLoop(self._buffers.named)
        self._kept = KeptSettings(KEPT)
        self._functions = functions()
        self._chosen = "VOLT:DC"
        self._counts = {"SENS": 1, "DIG": 1}
        self._texts, self._light = {1: "", 2: ""}, "ON50"
        self._add_all()
        self.begin_to_serve(setting, self._lock)

    def execute(self, message: str) -> str | None:
        """Carry out one message; another command set than SCPI knows common commands alone."""
        if self._language != "SCPI" and not message.startswith("*"):
            return None
        return super().execute(message)

    def reset(self) -> None:
        """Go to DC volts on its highest range with autoranging, the buffers empty."""
        self._loop.reset()
        self._kept.reset()
        self._buffers.reset()
        self._functions, self._chosen = functions(), "VOLT:DC"
        self._counts = {"SENS": 1, "DIG": 1}

    def before_each(self) -> None:
        """Take the readings that have become finished into their buffer."""
        starts_s = self._loop.finished(self._clock.now(), CAPACITY)
        if not len(starts_s):
            return
        used = self._functions[self._chosen]
        new = self._readings.of(used, starts_s)
        if not self._buffers.named(self._loop.buffer).add(new, starts_s):
            self.refuse(FULL)

    # Commands.

    def _add_all(self) -> None:
        loop, buffers = self._loop, self._buffers
        self.add_commands(
            {
                # Another command set takes effect at the next start.
                "*LANG": (word(*LANGUAGES), lambda: self._language),
                "*OPC?": lambda: self._when_idle("1"),
                "*WAI": lambda: self._when_idle(""),
                "ROUTe:TERMinals?": lambda: "FRON",
                "TRIGger:STATe?": lambda: loop.state,
                "TRIGger:LOAD": Listed(loop.load),
                "INITiate[:IMMediate]": self._initiate,
                "ABORt": loop.stop,
                **self._kept.commands(),
            }
        )
        self.add_commands(self._system(), "SYSTem:")
        self.add_commands({**self._display(), **buffers.display()}, "DISPlay:")
        self.add_commands(
            {**buffers.commands(), "TRIGger": Listed(lambda given: self._fill(given[:1]))},
            "TRACe:",
        )
        self.add_commands(self._measuring())
        self.add_commands(
            {
                "FUNCtion[:ON]": (self._choose, lambda: self._shown(digitizes=False)),
                "COUNt": self._count("SENS", MAX_COUNT),
                "AZERo:ONCE": self._zero_once,
                "DIGitize:FUNCtion[:ON]": (
                    self._choose_digitized,
                    lambda: self._shown(digitizes=True),
                ),
                "DIGitize:COUNt": self._count("DIG", MAX_DIGITIZED),
            },
            *("", "SENSe:", "SENSe1:"),
        )
        tables = FunctionCommands(
            lambda: self._functions, self._converter.line_frequency_Hz, self._set
        )
        for name, (header, _, _) in HAS.items():
            roots = (f"{root}{header}:" for root in ("", "SENSe:", "SENSe1:"))
            acquire = {"RELative:ACQuire": partial(self._acquire_offset, name)}
            self.add_commands({**tables.sense(name), **acquire}, *roots)
            calculates = (f"CALCulate{n}:{header}:MATH:" for n in ("", "1"))
            self.add_commands(tables.math(name), *calculates)
            self.add_commands(tables.display(name), f"DISPlay:{header}:")

    def _system(self) -> dict[str, Value]:
        return {
            "LFRequency?": lambda: f"{self._converter.line_frequency_Hz:.0f}",
            "VERSion?": lambda: "1996.0",
            "TIME": Listed(self._set_time, self._time),
            "BEEPer[:IMMediate]": Listed(self._beep),
            "CLEar": self.errors.clear,
            "EVENtlog:NEXT": Listed(
                None, lambda given: self.errors.pop() if self._has_errors(given) else EMPTY_LOG
            ),
            "EVENtlog:COUNt": Listed(
                None, lambda given: str(len(self.errors) if self._has_errors(given) else 0)
            ),
        }

    def _display(self) -> dict[str, Value]:
        return {
            "SCReen": (word(*SCREENS), None),
            "LIGHt:STATe": (self._set_light, lambda: self._light),
            "CLEar": self._clear_texts,
            "USER1:TEXT[:DATA]": (partial(self._set_text, 1), None),
            "USER2:TEXT[:DATA]": (partial(self._set_text, 2), None),
        }

    def _measuring(self) -> dict[str, Value]:
        table: dict[str, Value] = {
            "READ": Listed(None, self._read),
            "READ:DIGitize": Listed(None, self._read),
            "FETCh": Listed(None, self._buffers.newest),
            "MEASure": Listed(None, self._read),
            "MEASure:DIGitize": Listed(None, self._read),
        }
        for name, (header, _, _) in HAS.items():
            table[f"MEASure:{header}"] = Listed(None, partial(self._measure, name))
        return table

    # Its clock, its display.

    def _date(self, now_s: float) -> datetime:
        return BEGAN + timedelta(seconds=now_s) + self._shift

    def _time(self, parameters: list[str]) -> str:
        date = self._date(self._clock.now())
        if not parameters:
            return str(int(date.timestamp()))
        whole_number(parameters[0], 1, 1)
        return f"{date:%a %b} {date.day:2d} {date:%H:%M:%S %Y}"

    def _set_time(self, parameters: list[str]) -> None:
        given, now = [round(number(text)) for text in parameters], self._date(self._clock.now())
        try:
            if len(given) == 1:
                wanted = datetime.fromtimestamp(given[0], UTC)
            elif len(given) == 3:
                hour, minute, second = given
                wanted = now.replace(hour=hour, minute=minute, second=second, microsecond=0)
            elif len(given) == 6:
                year, month, day, hour, minute, second = given
                wanted = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
            else:
                raise ScpiError(-108 if len(given) > 6 else -109)
        except ValueError:
            raise ScpiError(-222) from None
        self._shift += wanted - now

    def _beep(self, parameters: list[str]) -> None:
        if len(parameters) < 2:
            raise ScpiError(-109)
        numeric(parameters[0], 20.0, 8000.0, 20.0)
        numeric(parameters[1], 0.001, 100.0, 0.001)

    @staticmethod
    def _has_errors(parameters: list[str]) -> bool:
        """Whether a kind of events has errors among them; there are no others here."""
        return not parameters or choice(parameters[0], words(*EVENTS)) in ("ERR", "ALL")

    def _set_light(self, text: str) -> None:
        self._light = choice(text, words(*LIGHTS))

    def _clear_texts(self) -> None:
        self._texts = {1: "", 2: ""}

    def _set_text(self, line: int, text: str) -> None:
        self._texts[line] = unquoted(text)[: LONGEST_TEXT[line]]

    # Functions and readings.

    def _set(self, name: str, what: str, value: Any) -> None:
        if self._loop.runs:
            raise ScpiError(-221)
        function = self._functions[name]
        setattr(function, what, value)
        function.stack.clear()

    def _count(self, which: str, most: int) -> Value:
        def take(text: str) -> None:
            self._counts[which] = round(numeric(text, 1, most, 1))

        return take, lambda: self._counts[which]

    def _shown(self, *, digitizes: bool) -> str:
        if digitizes != (self._chosen in DIGITIZES):
            return "NONE"
        return self._chosen.removeprefix("DIG:")

    def _choose(self, text: str) -> None:
        self._take_function(named(text), allowed=True)

    def _choose_digitized(self, text: str) -> None:
        wanted = f'"DIG:{unquoted(text)}"'
        self._take_function(named(wanted), allowed=False)

    def _take_function(self, name: str, *, allowed: bool) -> None:
        if allowed == (name in DIGITIZES):
            raise ScpiError(-224)
        if self._loop.runs:
            raise ScpiError(-221)
        self._chosen = name

    def _timing(self) -> tuple[float, float, float]:
        """Return the time, how long a reading takes, and what goes by after it."""
        used = self._functions[self._chosen]
        pause_s = self._readings.pause_s(used, BETWEEN_READINGS_S)
        return self._clock.now(), self._readings.busy_s(used), pause_s

    def _initiate(self) -> None:
        self._loop.initiate(*self._timing())

    def _fill(self, buffer: list[str]) -> None:
        count = self._counts["DIG" if self._chosen in DIGITIZES else "SENS"]
        self._loop.measure(count, buffer, *self._timing())

    def _read(self, parameters: list[str]) -> str:
        self._fill(parameters[:1])
        self._when_idle("")
        return self._buffers.newest(parameters)

    def _measure(self, name: str, parameters: list[str]) -> str:
        self._take_function(name, allowed=name not in DIGITIZES)
        return self._read(parameters)

    def _zero_once(self) -> None:
        self._functions[self._chosen].zeroed_at_s = self._clock.now()

    def _acquire_offset(self, name: str) -> None:
        if self._loop.runs or name != self._chosen:
            raise ScpiError(-221)
        function, begin_s = self._functions[name], self._clock.now()
        self._sleep_until(begin_s + self._converter.busy_s(function))
        value = float(self._readings.unchanged(function, np.array([begin_s]))[0])
        if abs(value) >= 0.99 * OVERLOAD_READING:
            raise ScpiError(-222)
        function.null = value

    def _when_idle(self, reply: str) -> str:
        while self._loop.runs:
            self._sleep_until(self._loop.end_s)
            self.before_each()
        return reply

    def _sleep_until(self, end_s: float) -> None:
        with released(self._lock):  # the world goes on meanwhile, and others are served
            self._clock.sleep_until(end_s)
