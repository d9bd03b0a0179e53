"""Keysight DAQ970A data acquisition system with multiplexers, SCPI over TCP.

From the programming guide of the DAQ970A/DAQ973A: lists of channels `(@101:103,201)` whose ends
must be there, four wires at a channel of bank 1 and the one 10 higher (8 on a DAQM902A), a channel
of bank 2 refused, integration times from 0.02 to 200 cycles, CONFigure that sets the scan list and
switches the channel numbers of readings off, readings with units, time, channel and alarm, `ROUT:
SCAN?` as a block in the order of the channels, `DATA:LAST?` that is an error where there is
nothing, 100,000 readings of which the newest stay, bits 16 (scanning), 32 (waits), 256, 8192, an
INITiate that forgets, an ABORt that does not, READ? as a deadlock with the trigger BUS. From
clients and the answers of a unit: the modules' names, `Keysight Technologies,0,0,0` for an empty
slot, 80 channels a second on relays, 450 on a DAQM900A. From the 34970A, whose language it is:
errors 111 to 113 and 305, questionable events 512, 1024 and 4096. Assumed: settings are refused
while it scans (-221), a channel's time and twice the integration time for four wires, the form of
`CONF?`, of the time, and which error a channel of bank 2 is. Only thermometers are connected: volts
read zero.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from sim_instruments.faults.lasting import Frozen, Overload
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.wire import scpi
from sim_instruments.wire.requests import released
from sim_instruments.wire.scpi import (
    ScpiError,
    boolean,
    choice,
    numeric,
    single_parameter,
    whole_number,
    word,
    words,
)
from sim_instruments.wire.scpi_device import Listed, ScpiDevice, kept
from sim_instruments.world.base import CHAMBER, DEVICE, Temperature
from sim_instruments.world.platinum import platinum_degC, platinum_ohm

FIRMWARE = "A.02.04-00.16-11.29-00.02-02-01"
NO_SLOT, NO_CHANNEL, NOTHING_TO_SCAN, NOT_ABLE = 111, 112, 113, 305
MEMORY = 100_000
SCANNING, WAITING, CHANGED, ANY_ERROR = 16, 32, 256, 8192
OHMS_BEYOND, DEGREES_BEYOND, MEMORY_OVERFLOW = 512, 1024, 4096
OVERLOAD_READING = 9.9e37
OVER_RANGE = 1.2
CYCLES = (0.02, 0.2, 1.0, 2.0, 10.0, 20.0, 100.0, 200.0)
OHM_RANGES = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
VOLT_RANGES = (0.1, 1.0, 10.0, 100.0, 300.0)
ALPHAS = {"85": 85.0, "91": 91.0}
UNITS = {"VOLT": "VDC", "RES": "OHM", "FRES": "OHM"}
LIST = re.compile(r"\(@([\d,:\s]*)\)")


@runtime_checkable
class WarmWorld(Protocol):
    """A world with temperatures, see `World`."""

    temperatures: dict[str, Temperature]
    gradients_K: dict[str, float]


class Module(NamedTuple):
    """A multiplexer: its channels, how far off the second of a pair is, channels a second."""

    channels: int
    pair: int
    per_s: float


MODULES = {
    "DAQM900A": Module(20, 10, 450.0),
    "DAQM901A": Module(20, 10, 80.0),
    "DAQM902A": Module(16, 8, 250.0),
    "DAQM908A": Module(40, 0, 80.0),
}


@dataclass
class Channel:
    """What a channel measures; as after `*RST`: volts, the range automatic, one cycle."""

    function: str = "VOLT"
    range: float = VOLT_RANGES[-1]
    autorange: bool = True
    cycles: float = 1.0
    transducer: str = "FRTD"
    r0_ohm: float = 100.0
    alpha: str = "85"
    unit: str = "C"
    delay_s: float | None = None
    gain: float = 1.0
    offset: float = 0.0
    scaled: bool = False

    @property
    def four_wires(self) -> bool:
        """Whether it takes a second channel."""
        return self.function == "FRES" or (self.function == "TEMP" and self.transducer == "FRTD")

    @property
    def ranges(self) -> tuple[float, ...]:
        """The ranges of its function."""
        return VOLT_RANGES if self.function == "VOLT" else OHM_RANGES


class Wired(NamedTuple):
    """A platinum thermometer at a channel: where it is, and how far along."""

    at: str
    along: float
    r0_ohm: float


class Reading(NamedTuple):
    """One reading of the memory."""

    value: float
    unit: str
    time_s: float
    channel: int


class Scan:
    """Sweeps through a list of channels that take their times one after another."""

    def __init__(self) -> None:
        self.channels: tuple[int, ...] = ()
        self.sweeps_left = 0.0
        self.stop()

    def stop(self) -> None:
        """Scan no more."""
        self.taken = self.planned = 0
        self.sweeps_left = 0.0

    def begin(self, now_s: float, times_s: list[float], sweeps: float, period_s: float) -> None:
        """Begin so many sweeps, whatever there was before."""
        self.begin_s = now_s
        self.ends_s = np.cumsum(times_s)
        self.period_s = max(period_s, float(self.ends_s[-1]))
        self.taken, self.planned = 0, int(min(sweeps, MEMORY * 1000)) * len(times_s)

    @property
    def runs(self) -> bool:
        """Whether there are readings to come."""
        return self.taken < self.planned

    @property
    def end_s(self) -> float:
        """When the last reading is finished."""
        sweeps = self.planned // len(self.ends_s)
        return float(self.begin_s + (sweeps - 1) * self.period_s + self.ends_s[-1])

    def finished(self, now_s: float) -> Iterator[tuple[int, float]]:
        """Yield the position in the list and the end of each reading that has become finished."""
        while self.runs:
            sweep, at = divmod(self.taken, len(self.ends_s))
            end_s = float(self.begin_s + sweep * self.period_s + self.ends_s[at])
            if end_s > now_s + 1e-9:
                return
            self.taken += 1
            yield at, end_s


class KeysightDaq970A(ScpiDevice):
    """The instrument, in whatever simulated world has temperatures.

    Truth (`simulator` mapping): `modules`, the multiplexer in each used slot from 1 to 3;
    `line_frequency`; `noise` (rms at one power-line cycle, of the range); `gain_error` and `offset`
    in ohm of its converter; `channels`, by number: the thermometer there, `at` what it is
    (`device`, `chamber`), how far `along` that (from 0 at its near end to 100 % at its far end,
    see `gradient` of the world) and its `r0` at 0 degC. A channel that is not listed is open.
    """

    model = "Keysight DAQ970A"
    at_once = False
    lasting_faults: ClassVar = (Frozen.kind, Overload.kind)
    own_texts: ClassVar[Mapping[int, str]] = {
        NO_SLOT: "Channel list: slot number out of range",
        NO_CHANNEL: "Channel list: channel number out of range",
        NOTHING_TO_SCAN: "Channel list: empty scan list",
        NOT_ABLE: "Not able to perform requested operation",
    }

    def __init__(self, setting: Setting) -> None:
        identity = f"Keysight Technologies,DAQ970A,{setting.serial},{FIRMWARE}"
        super().__init__(identity, '+0,"No error"')
        self._clock, self._lock, self._rng = setting.clock, setting.world.lock, setting.rng
        self._faults, truth = setting.faults, setting.truth
        self._world = setting.world.find(WarmWorld)
        self._modules = _modules(truth.section("modules"))
        self._wired = _wired(truth.section("channels"))
        self._line_Hz = truth.quantity("line_frequency", "Hz")
        if self._line_Hz not in (50.0, 60.0):
            raise SimulationError(f"{truth.where}.line_frequency: must be 50 Hz or 60 Hz")
        self._noise = truth.quantity("noise", "1")
        self._gain = 1.0 + truth.quantity("gain_error", "1")
        self._offset_ohm = truth.quantity("offset", "ohm")
        self._beeps = True
        self._scan = Scan()
        self.reset()
        self._add_all()
        self.begin_to_serve(setting, self._lock)

    def operation_condition(self) -> int:
        """Return whether it scans or waits for a trigger, and whether there is an error."""
        waits = not self._scan.runs and self._scan.sweeps_left > 0
        bits = (SCANNING if self._scan.runs else 0) | (WAITING if waits else 0)
        return bits | (ANY_ERROR if self.errors else 0)

    def questionable_condition(self) -> int:
        """Return whether readings were lost; overloads are events only."""
        return MEMORY_OVERFLOW if self._overflowed else 0

    def reset(self) -> None:
        """Go to the state after `*RST`: no scan list, volts on every channel."""
        self._scan.stop()
        self._scan.channels = ()
        numbers = (
            100 * slot + n
            for slot, name in self._modules.items()
            for n in range(1, MODULES[name].channels + 1)
        )
        self._channels = {number: Channel() for number in numbers}
        self._memory: deque[Reading] = deque(maxlen=MEMORY)
        self._last: dict[int, list[Reading]] = {}
        self._overflowed = False
        self._source, self._sweeps, self._timer_s = "IMM", 1.0, 10.0
        self._shows_channel = self._shows_unit = self._shows_time = self._shows_alarm = False
        self._absolute = "REL"
        self._frozen: dict[int, float] = {}

    def before_each(self) -> None:
        """Take the readings that have become finished into the memory."""
        for at, end_s in self._scan.finished(self._clock.now()):
            number = self._scan.channels[at]
            reading = self._read(number, end_s)
            self._overflowed |= len(self._memory) == MEMORY
            self._memory.append(reading)
            self._last.setdefault(number, []).append(reading)

    def _read(self, number: int, end_s: float) -> Reading:
        channel = self._channels[number]
        value = self._measured(channel, number, end_s)
        if self._faults.during(Frozen.kind, np.array([end_s]))[0]:
            value = self._frozen.get(number, value)
        self._frozen[number] = value
        if abs(value) < OVERLOAD_READING and channel.scaled:
            value = channel.gain * value + channel.offset
        unit = channel.unit if channel.function == "TEMP" else UNITS[channel.function]
        return Reading(value, unit, end_s, number)

    def _measured(self, channel: Channel, number: int, end_s: float) -> float:
        """Return what its converter makes of a channel: ohm, degrees in its unit, or volts."""
        if channel.function == "VOLT":
            return 0.0
        ohms = self._input_ohm(number, end_s - self._converts_s(channel))
        holding = [r for r in channel.ranges if ohms <= OVER_RANGE * r]
        range_ = channel.range
        if channel.autorange or channel.function == "TEMP":
            range_ = holding[0] if holding else channel.ranges[-1]
        noise = self._noise * range_ / math.sqrt(channel.cycles)
        ohms = self._gain * ohms + self._offset_ohm + noise * float(self._rng.standard_normal())
        beyond = ohms > OVER_RANGE * range_ or not math.isfinite(ohms)
        if beyond or self._faults.during(Overload.kind, np.array([end_s]))[0]:
            temperature = channel.function == "TEMP"
            self.questionable.latch(DEGREES_BEYOND if temperature else OHMS_BEYOND)
            return OVERLOAD_READING
        if channel.function != "TEMP":
            return ohms
        degC = float(platinum_degC(channel.r0_ohm, np.array([ohms]))[0])
        return {"C": degC, "F": 1.8 * degC + 32.0, "K": degC + 273.15}[channel.unit]

    def _input_ohm(self, number: int, begin_s: float) -> float:
        """Return the resistance at a channel; infinite where it is open."""
        wired = self._wired.get(number)
        if wired is None or self._world is None or wired.at not in self._world.temperatures:
            return math.inf
        at_s = np.array([begin_s + 0.5 / self._line_Hz])
        degC = self._world.temperatures[wired.at](at_s)
        degC = degC + wired.along * self._world.gradients_K[wired.at]
        return float(platinum_ohm(wired.r0_ohm, degC)[0])

    def _converts_s(self, channel: Channel) -> float:
        return (2.0 if channel.four_wires else 1.0) * channel.cycles / self._line_Hz

    def _takes_s(self, number: int) -> float:
        """Return how long a channel takes in a scan."""
        channel = self._channels[number]
        switching_s = 1.0 / MODULES[self._modules[number // 100]].per_s
        return switching_s + (channel.delay_s or 0.0) + self._converts_s(channel)

    # What is sent to it.

    def _add_all(self) -> None:
        self.add_commands(
            {
                "INITiate[:IMMediate]": self._initiate,
                "ABORt": self._scan.stop,
                "*TRG": self._trigger,
                "FETCh?": self._fetch,
                "READ?": self._read_all,
                "*OPC?": self._when_idle,
                "*WAI": self._wait,
                "R": Listed(None, self._remove_block),
                "DATA:REMove": Listed(None, self._remove),
                "DATA:POINts": Listed(None, lambda _: f"{len(self._memory):+d}"),
                "DATA:LAST": Listed(None, self._last_of),
                "SYSTem:LFRequency?": lambda: f"{self._line_Hz:+.0f}",
                "SYSTem:CTYPe": Listed(None, self._module),
                "SYSTem:PRESet": self.reset,
                "SYSTem:BEEPer[:IMMediate]": lambda: None,
                "SYSTem:BEEPer:STATe": kept(self, "_beeps", boolean),
                "ROUTe:SCAN:SIZE?": lambda: f"{len(self._scan.channels):+d}",
                "FORMat:READing:ALARm": kept(self, "_shows_alarm", boolean),
                "FORMat:READing:CHANnel": kept(self, "_shows_channel", boolean),
                "FORMat:READing:TIME": kept(self, "_shows_time", boolean),
                "FORMat:READing:TIME:TYPE": kept(self, "_absolute", word("ABSolute", "RELative")),
                "FORMat:READing:UNIT": kept(self, "_shows_unit", boolean),
            }
        )
        sources = word("IMMediate", "BUS", "EXTernal", "INTernal", "TIMer")
        self.add_commands(
            {
                "ROUTe:SCAN": Listed(self._set_scan, lambda _: self._scan_block()),
                "TRIGger:SOURce": kept(self, "_source", sources),
                "TRIGger:COUNt": (
                    lambda text: setattr(self, "_sweeps", _sweeps(text)),
                    lambda: min(self._sweeps, 9.9e37),
                ),
                "TRIGger:TIMer": kept(self, "_timer_s", lambda text: numeric(text, 0, 359999, 10)),
            },
            before=self._refuse_while_scanning,
        )
        self._add_channels()

    def _add_channels(self) -> None:
        """Add what takes a list of channels."""
        rows: dict[str, tuple[Callable[[Channel, str], None], Callable[[Channel], str]]] = {
            "ROUTe:CHANnel:DELay": (
                lambda channel, text: setattr(channel, "delay_s", numeric(text, 0, 60, 0)),
                lambda channel: f"{channel.delay_s or 0.0:+.8E}",
            ),
            "ROUTe:CHANnel:DELay:AUTO": (
                lambda channel, text: setattr(channel, "delay_s", None if boolean(text) else 0.0),
                lambda channel: str(int(channel.delay_s is None)),
            ),
            "CALCulate:SCALe:STATe": (_switch("scaled"), lambda channel: str(int(channel.scaled))),
            "CALCulate:SCALe:GAIN": (_real("gain"), lambda channel: f"{channel.gain:+.8E}"),
            "CALCulate:SCALe:OFFSet": (_real("offset"), lambda channel: f"{channel.offset:+.8E}"),
            "UNIT:TEMPerature": (
                lambda channel, text: setattr(channel, "unit", choice(text, words("C", "F", "K"))),
                lambda channel: channel.unit,
            ),
        }
        for function in ("VOLTage[:DC]", "RESistance", "FRESistance", "TEMPerature"):
            rows[f"[SENSe:]{function}:NPLCycles"] = (_set_cycles, _cycles)
        for function in ("VOLTage[:DC]", "RESistance", "FRESistance"):
            rows[f"[SENSe:]{function}:RANGe"] = (_set_range, lambda c: f"{c.range:+.8E}")
            rows[f"[SENSe:]{function}:RANGe:AUTO"] = (
                _switch("autorange"),
                lambda channel: str(int(channel.autorange)),
            )
        for wires in ("FRTD", "RTD"):
            root = f"[SENSe:]TEMPerature:TRANsducer:{wires}"
            rows[f"{root}:RESistance[:REFerence]"] = (
                lambda channel, text: setattr(channel, "r0_ohm", numeric(text, 49, 2100, 100)),
                lambda channel: f"{channel.r0_ohm:+.8E}",
            )
            rows[f"{root}:TYPE"] = (_set_alpha, lambda channel: f"+{channel.alpha}")
        for pattern, (take, give) in rows.items():
            header = pattern.replace("[SENSe:]", "")
            setting = Listed(partial(self._set_each, take), partial(self._give_each, give))
            roots = ("", "SENSe:") if pattern != header else ("",)
            self.add_commands({header: setting}, *roots, before=self._refuse_while_scanning)
        self.add_commands({"CONFigure": Listed(None, partial(self._give_each, _configured))})
        for header, function in {
            "[:VOLTage][:DC]": "VOLT",
            ":RESistance": "RES",
            ":FRESistance": "FRES",
            ":TEMPerature": "TEMP",
            ":TEMPerature:FRTD": "FRTD",
            ":TEMPerature:RTD": "RTD",
        }.items():
            configure = partial(self._configure, function)
            self.add_commands(
                {f"CONFigure{header}": Listed(configure)}, before=self._refuse_while_scanning
            )
            measure = partial(self._measure, function)
            self.add_commands({f"MEASure{header}": Listed(None, measure)})

    def _refuse_while_scanning(self) -> None:
        if self._scan.runs or self._scan.sweeps_left:
            raise ScpiError(-221)

    def _split(self, given: list[str]) -> tuple[list[str], list[int] | None]:
        """Return the parameters before a list of channels, and the list; None without one."""
        text = ",".join(given)
        listed = LIST.search(text)
        if listed is None:
            if "(" in text:
                raise ScpiError(-102)
            return given, None
        before = text[: listed.start()].rstrip(", ")
        return (before.split(",") if before else []), self._numbers(listed[1])

    def _numbers(self, text: str) -> list[int]:
        """Return the channels of a list, in its order; of a range those that are there."""
        numbers: list[int] = []
        for part in filter(None, (part.strip() for part in text.split(","))):
            ends = [int(end) for end in part.split(":")]
            for end in ends:
                if end // 100 not in self._modules:
                    raise ScpiError(NO_SLOT)
                if end not in self._channels:
                    raise ScpiError(NO_CHANNEL)
            first, last = min(ends), max(ends)
            numbers += [n for n in range(first, last + 1) if n in self._channels]
        return numbers

    def _of(self, numbers: list[int] | None) -> list[int]:
        """Return the channels of a command: those of the scan list where it names none."""
        return list(self._scan.channels) if numbers is None else numbers

    def _set_each(self, take: Callable[[Channel, str], None], given: list[str]) -> None:
        before, numbers = self._split(given)
        text = single_parameter(before)
        for number in self._of(numbers):
            take(self._channels[number], text)

    def _give_each(self, give: Callable[[Channel], str], given: list[str]) -> str:
        _, numbers = self._split(given)
        return ",".join(give(self._channels[number]) for number in self._of(numbers))

    def _configure(self, function: str, given: list[str]) -> None:
        before, numbers = self._split(given)
        if numbers is None:
            raise ScpiError(-109)
        channel = _channel_of(function, [text.strip() for text in before])
        self._require_pairs(channel, numbers)
        for number in numbers:
            self._channels[number] = replace(channel)
        self._scan.channels = tuple(sorted(set(numbers)))
        self._shows_channel = False
        self._forget()

    def _require_pairs(self, channel: Channel, numbers: list[int]) -> None:
        for number in numbers:
            module = MODULES[self._modules[number // 100]]
            if channel.four_wires and number % 100 > module.pair:
                raise ScpiError(NOT_ABLE)

    def _measure(self, function: str, given: list[str]) -> str:
        self._configure(function, given)
        return self._read_all()

    def _set_scan(self, given: list[str]) -> None:
        _, numbers = self._split(given)
        if numbers is None:
            raise ScpiError(-109)
        for number in numbers:
            self._require_pairs(self._channels[number], [number])
        self._scan.channels = tuple(sorted(set(numbers)))
        self._forget()

    def _scan_block(self) -> str:
        text = f"(@{','.join(map(str, self._scan.channels))})"
        length = str(len(text))
        return f"#{len(length)}{length}{text}"

    def _module(self, given: list[str]) -> str:
        """Return the module of a slot, asked for as 1 or as 100."""
        slot = whole_number(single_parameter(given), 1, 399)
        slot = slot // 100 if slot >= 100 else slot
        if not 1 <= slot <= 3:
            raise ScpiError(-222)
        if slot not in self._modules:
            return "Keysight Technologies,0,0,0"
        return f"Keysight Technologies,{self._modules[slot]},MY5802224{slot},01.02"

    def _forget(self) -> None:
        self._memory.clear()
        self._last.clear()
        self._overflowed = False

    def _initiate(self) -> None:
        if self._scan.runs or self._scan.sweeps_left:
            raise ScpiError(-213)
        if not self._scan.channels:
            raise ScpiError(NOTHING_TO_SCAN)
        self._forget()
        self._begin_s = self._clock.now()
        if self._source in ("IMM", "TIM"):
            self._sweep(self._sweeps)
        else:
            self._scan.sweeps_left = self._sweeps

    def _sweep(self, sweeps: float) -> None:
        times_s = [self._takes_s(number) for number in self._scan.channels]
        period_s = self._timer_s if self._source == "TIM" else 0.0
        self._scan.begin(self._clock.now(), times_s, sweeps, period_s)

    def _trigger(self) -> None:
        if self._source != "BUS" or self._scan.runs or not self._scan.sweeps_left:
            raise ScpiError(-211)
        left = self._scan.sweeps_left - 1
        self._sweep(1)
        self._scan.sweeps_left = left

    def _wait(self) -> None:
        """Wait until it is idle; ScpiError -214 when that needs a trigger by this very line."""
        while self._scan.runs or self._scan.sweeps_left:
            if not self._scan.runs:
                raise ScpiError(-214)
            with released(self._lock):  # the world goes on meanwhile, and others are served
                self._clock.sleep_until(self._scan.end_s)
            self.before_each()

    def _when_idle(self) -> str:
        self._wait()
        return "1"

    def _fetch(self) -> str:
        self._wait()
        if not self._memory:
            raise ScpiError(-230)
        return self._text(list(self._memory))

    def _read_all(self) -> str:
        if self._source == "BUS":
            raise ScpiError(-214)
        self._initiate()
        return self._fetch()

    def _last_of(self, given: list[str]) -> str:
        before, numbers = self._split(given)
        if numbers is None or len(numbers) != 1:
            raise ScpiError(-109)
        count = whole_number(single_parameter(before), 1, 1000) if before else 1
        readings = self._last.get(numbers[0], [])
        if len(readings) < count:
            raise ScpiError(-230)
        return self._text(readings[-count:])

    def _remove(self, given: list[str]) -> str:
        count = whole_number(single_parameter(given), 1, MEMORY)
        if len(self._memory) < count:
            raise ScpiError(-222)
        return self._text([self._memory.popleft() for _ in range(count)])

    def _remove_block(self, given: list[str]) -> str:
        most = whole_number(single_parameter(given), 1, MEMORY) if given else MEMORY
        count = min(most, len(self._memory))
        text = self._text([self._memory.popleft() for _ in range(count)])
        length = str(len(text))
        return f"#{len(length)}{length}{text}"

    def _text(self, readings: list[Reading]) -> str:
        return ",".join(field for reading in readings for field in self._fields(reading))

    def _fields(self, reading: Reading) -> Iterator[str]:
        yield f"{reading.value:+.8E}" + (f" {reading.unit}" if self._shows_unit else "")
        if self._shows_time:
            yield f"{reading.time_s - self._begin_s:012.3f}"
        if self._shows_channel:
            yield str(reading.channel)
        if self._shows_alarm:
            yield "0"


def _modules(truth: Truth) -> dict[int, str]:
    """Return the multiplexer of each used slot."""
    keys = {slot: _key(truth, slot) for slot in range(1, 4)}
    return {slot: truth.word(key, tuple(MODULES)) for slot, key in keys.items() if key in truth}


def _key(truth: Truth, number: int) -> Any:
    """Return a number as the key that a file has: a number in YAML, a text in JSON."""
    return number if number in truth else str(number)


def _wired(truth: Truth) -> dict[int, Wired]:
    """Return the thermometers by their channels."""
    thermometers = {}
    for number in range(100, 400):
        key = _key(truth, number)
        if key in truth:
            own = truth.section(key)
            at = own.word("at", (DEVICE, CHAMBER))
            along, r0_ohm = own.quantity("along", "1", 0.0), own.positive("r0", "ohm")
            thermometers[number] = Wired(at, along, r0_ohm)
    return thermometers


def _channel_of(function: str, given: list[str]) -> Channel:
    """Return a channel as CONFigure with these parameters leaves it."""
    if function in ("FRTD", "RTD"):  # the form with the resistance at 0 degC
        r0_ohm = numeric(given[0] if given else "DEF", 49, 2100, 100)
        return Channel("TEMP", OHM_RANGES[1], True, 1.0, function, r0_ohm)
    if function == "TEMP":
        transducer = choice(given[0] if given else "FRTD", words("FRTD", "RTD"))
        channel = Channel("TEMP", OHM_RANGES[1], True, 1.0, transducer)
        if len(given) > 1 and given[1].upper() != "DEF":
            _set_alpha(channel, given[1])
        return channel
    channel = Channel(function)
    channel.range = channel.ranges[-1]
    if given and given[0].upper() not in ("AUTO", "DEF"):
        _set_range(channel, given[0])
    if len(given) > 1 and given[1].upper() != "DEF":
        channel.cycles = _cycles_of(scpi.number(given[1]) / channel.range)
    if len(given) > 2:
        raise ScpiError(-108)
    return channel


def _cycles_of(resolution: float) -> float:
    """Return the integration time of a resolution, of the range: 3 ppm at one cycle and finer."""
    return next((c for c in CYCLES if _resolution(c) <= resolution * 1.0001), CYCLES[-1])


def _resolution(cycles: float) -> float:
    return 3e-7 / math.sqrt(cycles) * (100.0 if cycles < 1.0 else 1.0)


def _configured(channel: Channel) -> str:
    """Return a channel as `CONF?` answers it."""
    if channel.function == "TEMP":
        return f'"TEMP {channel.transducer},{channel.alpha}"'
    resolution = channel.range * _resolution(channel.cycles)
    return f'"{channel.function} {channel.range:+.6E},{resolution:+.6E}"'


def _set_range(channel: Channel, text: str) -> None:
    wanted = numeric(text, 0.0, OVER_RANGE * channel.ranges[-1], channel.ranges[-1])
    fitting = [r for r in channel.ranges if wanted <= OVER_RANGE * r]
    channel.range, channel.autorange = min(fitting), False


def _set_cycles(channel: Channel, text: str) -> None:
    wanted = numeric(text, CYCLES[0], CYCLES[-1], 1.0)
    channel.cycles = next(cycles for cycles in CYCLES if wanted <= cycles * 1.0001)


def _cycles(channel: Channel) -> str:
    return f"{channel.cycles:+.8E}"


def _set_alpha(channel: Channel, text: str) -> None:
    value = scpi.number(text)
    if f"{value:g}" not in ALPHAS:
        raise ScpiError(-224)
    channel.alpha = f"{value:g}"


def _switch(name: str) -> Callable[[Channel, str], None]:
    return lambda channel, text: setattr(channel, name, boolean(text))


def _real(name: str) -> Callable[[Channel, str], None]:
    return lambda channel, text: setattr(channel, name, scpi.number(text))


def _sweeps(text: str) -> float:
    if text.upper() in ("INF", "INFINITY"):
        return math.inf
    return float(whole_number(str(numeric(text, 1, MEMORY, 1)), 1, MEMORY))
