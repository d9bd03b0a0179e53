"""Red Pitaya STEMlab 125-14: its SCPI server, its oscilloscope, and one trigger output.

From the maker's server and gateware: LF-ended lines (a real one wants CR LF), answers end with
CR LF, `*IDN?` reports no serial number, a command that is unknown or refused is not answered and
leaves an error in the queue, the trigger status is TD whenever no source is armed, an unconnected
pin reads 1, a pin that is no output cannot be set, values come as `{0.123456,…}`, or with
`ACQ:DATA:FORMAT BIN` as a block of floats (raw: of whole numbers of 16 bits), the most significant
byte first, which the maker's examples read. Systems before
2.00-30 know no `ACQ:DEC:F`, before 2.00-15 no `ACQ:TRIG:FILL?`, and before 2.00 `DATA:STA:N?` in
the place of `DATA:START:N?`. DIO0_N drives the bench's trigger and DIO0_P listens to it. Input 1
is at the world's detector, input 2 is open. The sampling begins anew with each arming and is not in
step with the trigger; the pointer kept at the trigger is that of the value being taken then, on
systems before 2.05 that of the last one before it; each stored value is the mean of the values
since the one before, here the input in the middle of that time. By one client alone, SYST:TIME and
SYST:DATE are numbers with commas; this calendar changes nothing that is measured. Assumed: 20 us
for each value that is read out.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from sim_instruments.faults.lasting import NoTrigger, Overload
from sim_instruments.instrument import Setting
from sim_instruments.redpitaya.stemlab_capture import CONVERTER_HZ, SLOTS, Capture, Numbers
from sim_instruments.truth import SimulationError
from sim_instruments.wire.requests import released
from sim_instruments.wire.scpi import ScpiError, choice, none, number, whole_number, word, words
from sim_instruments.wire.scpi_device import KeptSettings, Listed, ScpiDevice, Value, kept, taken
from sim_instruments.world.base import TriggerLine
from sim_instruments.world.piecewise import Array

HALF = SLOTS // 2
CLASSIC = (1, 8, 64, 1024, 8192, 65536)
POWERS = tuple(2**power for power in range(17))
LARGEST_DECIMATION = 65536
FULL_SCALE_V = {"LV": 1.0, "HV": 20.0}
LARGEST_CODE = 8191
OUTPUT, LOOP = "DIO0_N", "DIO0_P"
PINS = words(*(f"DIO{number}_{side}" for side in "PN" for number in range(8)))
SLOPES = {f"CH{channel}_{way}E": (channel, way) for channel in "12" for way in "PN"}
SOURCES = words("DISABLED", "NOW", "EXT_PE", "EXT_NE", *SLOPES)
GAIN = word(*FULL_SCALE_V), "LV"
KEPT = {
    "ACQ:AVG": (word("ON", "OFF"), "ON"),
    "ACQ:DATA:UNITS": (word("VOLTS", "RAW"), "VOLTS"),
    "ACQ:DATA:FORMAT": (word("ASCII", "BIN"), "ASCII"),
    "ACQ:SOUR1:GAIN": GAIN,
    "ACQ:SOUR2:GAIN": GAIN,
}
TRANSFER_S = 20e-6
BYTES = "latin-1"
BEGINS = datetime(2026, 1, 1, tzinfo=UTC)
"""What its calendar shows at time zero: it has no battery and no network here."""


@runtime_checkable
class DetectorWorld(Protocol):
    """A world with a detector at the first input."""

    def detector_V(self, times_s: Array) -> Array:
        """Return the detector's voltage at each time, same shape."""


class RedPitaya(ScpiDevice):
    """The board, in whatever simulated world has a detector (`detector_V`) and a `trigger`.

    Truth (`simulator` mapping): `os_version` (2.05-37), `jumper` (where those of the inputs are
    set, LV or HV; the gain that is commanded does not move them), `noise` (rms of one stored
    value), `gain_error`, `offset`, `clock_error` (of the sample clock: positive is slow).
    """

    model = "Red Pitaya STEMlab 125-14"
    at_once = False
    number_form = ".6g"
    reply_end = b"\r\n"
    lasting_faults: ClassVar = (Overload.kind, NoTrigger.kind)

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        super().__init__("REDPITAYA,INSTR2024,0,01-02")
        self.only = only
        self._clock, self._lock = setting.clock, setting.world.lock
        self._faults, self._rng = setting.faults, setting.rng
        self._version = version_of(truth.text("os_version"), f"{truth.where}.os_version")
        self._jumper = truth.word("jumper", FULL_SCALE_V)
        self._noise_V = truth.quantity("noise", "V")
        self._gain = 1.0 + truth.quantity("gain_error", "1")
        self._offset_V = truth.quantity("offset", "V")
        self._clock_Hz = CONVERTER_HZ / (1.0 + truth.quantity("clock_error", "1"))
        self._detector = setting.world.find(DetectorWorld)
        self._wire = setting.world.find(TriggerLine) or TriggerLine()
        self._wire.listen(
            lambda time_s: self._edge(time_s, "EXT_PE"), lambda time_s: self._edge(time_s, "EXT_NE")
        )
        self._begins = BEGINS
        self._kept = KeptSettings(KEPT)
        self._outputs: dict[str, bool] = {}
        """The pins that are outputs, and whether each is high."""
        self._reset_acquisition()
        self._add_all()
        self.begin_to_serve(setting, self._lock)

    def energised(self) -> bool:
        """Return whether its trigger output is high."""
        return self._outputs.get(OUTPUT, False)

    def _reset_acquisition(self) -> None:
        self._kept.reset()
        self._decimation, self._delay = 1, HALF
        self._source, self._level_V = "DISABLED", 0.0
        self._noise = np.zeros(SLOTS)
        self._capture = Capture(self._clock.now(), 1.0, 0, HALF, stopped_s=self._clock.now())

    def _local(self) -> datetime:
        """Return what its calendar shows."""
        return self._begins + timedelta(seconds=self._clock.now())

    def _calendar(self, form: str, parameters: list[str]) -> str:
        none(parameters)
        return self._local().strftime(form)

    def _set_time(self, parameters: list[str]) -> None:
        hour, minute, second = parts_of(parameters)
        self._set_calendar(hour=hour, minute=minute, second=second, microsecond=0)

    def _set_date(self, parameters: list[str]) -> None:
        year, month, day = parts_of(parameters)
        self._set_calendar(year=year, month=month, day=day)

    def _set_calendar(self, **parts: int) -> None:
        shown = self._local()
        try:
            self._begins += shown.replace(**parts) - shown  # type: ignore[arg-type]
        except ValueError:
            raise ScpiError(-222) from None

    def _add_all(self) -> None:
        self.add_commands(self._kept.commands())
        table: dict[str, Value] = {
            "ACQ:RST": self._reset_acquisition,
            "ACQ:START": self._arm,
            "ACQ:STOP": self._stop,
            "ACQ:DEC": taken(self, "_decimation", self._set_decimation),
            "ACQ:TRIG": (self._set_source, None),
            "ACQ:TRIG:STAT?": lambda: "TD" if self._source == "DISABLED" else "WAIT",
            "ACQ:TRIG:LEV": kept(self, "_level_V", number),
            "ACQ:TRIG:DLY": (self._set_delay, lambda: self._delay - HALF),
            "ACQ:TRIG:DLY:NS": (self._set_delay_ns, lambda: f"{self._delay_ns():.0f}"),
            "SYST:VERSion?": lambda: "1999.0",
            "SYST:TIME": Listed(self._set_time, partial(self._calendar, "%H,%M,%S")),
            "SYST:DATE": Listed(self._set_date, partial(self._calendar, "%Y,%m,%d")),
            "SYST:BRD:ID?": lambda: "0",
            "SYST:BRD:Name?": lambda: "STEMlab 125-14 v1.0",
            "ACQ:WPOS?": self._pointer,
            "ACQ:TPOS?": self._pointer_at_trigger,
            "ACQ:BUF:SIZE?": lambda: SLOTS,
            "DIG:PIN": Listed(self._set_pin, self._pin),
            "DIG:PIN:DIR": Listed(self._set_direction, self._direction),
        }
        if self._version >= (2, 0, 30):
            table["ACQ:DEC:Factor"] = taken(self, "_decimation", self._set_factor)
        if self._version >= (2, 0, 15):
            table["ACQ:TRIG:FILL?"] = lambda: self._capture.is_full(self._clock.now())
        self.add_commands(table)
        both = ["START", "STA"] if self._version >= (2, 5, 0) else ["START"]
        starts = both if self._version >= (2, 0, 0) else ["STA"]
        for channel in ("1", "2"):
            data: dict[str, Value] = {
                ":OLD:N": Listed(None, partial(self._oldest, channel)),
                ":LAT:N": Listed(None, partial(self._latest, channel)),
                "?": partial(self._oldest, channel, [str(SLOTS)]),
            }
            for start in starts:
                data[f":{start}:N"] = Listed(None, partial(self._data, channel))
                data[f":{start}:END"] = Listed(None, partial(self._data, channel, to_end=True))
            self.add_commands(data, f"ACQ:SOUR{channel}:DATA")

    def _line(self, line: bytes) -> bytes:
        reply = self.execute(line.decode("ascii", "replace").strip())
        return b"" if reply is None else reply.encode(BYTES) + self.reply_end

    # The capture.

    def _arm(self) -> None:
        first = (self._capture.slot(self._capture.last_at(self._clock.now())) + 1) % SLOTS
        interval_s = self._decimation / self._clock_Hz
        # In step with nothing: the arming takes effect some clocks after the command.
        began_s = self._clock.now() + interval_s * self._rng.random()
        self._capture = Capture(began_s, interval_s, first, self._delay)
        self._noise = self._noise_V * self._rng.standard_normal(SLOTS)

    def before_each(self) -> None:
        """See whether an input has come to the level that is waited for."""
        if self._source not in SLOPES or self._capture.triggered_at is not None:
            return
        channel, way = SLOPES[self._source]
        last = self._capture.last_at(self._clock.now())
        numbers = np.arange(max(last - SLOTS, 0), last + 1)
        if numbers.size < 2:
            return
        above = self._read(channel, numbers) >= self._level_V
        crossed = above[1:] & ~above[:-1] if way == "P" else ~above[1:] & above[:-1]
        if crossed.any():
            self._capture.triggered_at = int(numbers[1 + int(np.argmax(crossed))])
            self._source = "DISABLED"

    def _set_delay_ns(self, text: str) -> None:
        self._set_delay(str(round(number(text) / self._interval_ns())))

    def _delay_ns(self) -> float:
        return (self._delay - HALF) * self._interval_ns()

    def _interval_ns(self) -> float:
        return 1e9 * self._decimation / CONVERTER_HZ

    def _stop(self) -> None:
        self._capture.stopped_s = min(self._capture.stopped_s, self._clock.now())

    def _edge(self, time_s: float, kind: str) -> None:
        if self._faults.now(NoTrigger.kind) is None and self._source == kind:
            self._trigger(time_s)

    def _trigger(self, time_s: float) -> None:
        self._capture.trigger(time_s)
        self._source = "DISABLED"

    def _set_source(self, text: str) -> None:
        self._source = choice(text, SOURCES)
        if self._source == "NOW":
            self._trigger(self._clock.now())

    def _set_decimation(self, text: str) -> None:
        value = whole_number(text, 1, LARGEST_DECIMATION)
        if value not in (CLASSIC if self._version < (1, 4, 0) else POWERS):
            raise ScpiError(-224)
        self._decimation = value

    def _set_factor(self, text: str) -> None:
        value = whole_number(text, 1, LARGEST_DECIMATION)
        if value < 16 and value not in POWERS:
            raise ScpiError(-224)
        self._decimation = value

    def _set_delay(self, text: str) -> None:
        self._delay = max(whole_number(text, -(2**31), 2**31 - 1) + HALF, 0)

    # What is reported of it.

    def _pointer(self) -> int:
        return self._capture.slot(self._capture.last_at(self._clock.now()))

    def _pointer_at_trigger(self) -> int:
        number = self._capture.triggered_at
        if number is None:
            return 0
        return self._capture.slot(number if self._version >= (2, 5, 0) else number - 1)

    def _data(self, channel: str, given: list[str], *, to_end: bool = False) -> str:
        """Answer values from a place in the ring on: so many, or up to another place."""
        first, second = exactly(2, given)
        start, count = whole_number(first, 0, SLOTS), whole_number(second, to_end ^ 1, SLOTS)
        return self._values(channel, start, (count - start) % SLOTS + 1 if to_end else count)

    def _oldest(self, channel: str, given: list[str]) -> str:
        return self._values(channel, self._pointer() + 1, whole_number(only(given), 1, SLOTS))

    def _latest(self, channel: str, given: list[str]) -> str:
        count = whole_number(only(given), 1, SLOTS)
        return self._values(channel, self._pointer() + 1 - count, count)

    def _values(self, channel: str, start: int, count: int) -> str:
        numbers = self._capture.numbers(start % SLOTS, count, self._clock.now())
        with released(self._lock):  # the world goes on meanwhile, and others are served
            self._clock.sleep(TRANSFER_S * count)
        volts = self._read(channel, numbers)
        binary = self._kept.values["ACQ:DATA:FORMAT"] == "BIN"
        if self._kept.values["ACQ:DATA:UNITS"] == "RAW":
            codes = np.round(volts / self._full_scale_V(channel) * (LARGEST_CODE + 1))
            if binary:
                return block_of(codes.astype(">i2"))
            return "{" + ",".join(f"{code:.0f}" for code in codes) + "}"
        if binary:
            return block_of(volts.astype(">f4"))
        return "{" + ",".join(f"{value:.6f}" for value in volts) + "}"

    def _full_scale_V(self, channel: str) -> float:
        return FULL_SCALE_V[str(self._kept.values[f"ACQ:SOUR{channel}:GAIN"])]

    def _read(self, channel: str, numbers: Numbers) -> Array:
        """Return what the board makes of the values with these numbers, in V."""
        volts = np.zeros(numbers.size)
        taken = numbers >= 0
        if taken.any():
            times_s = self._capture.middles_s(numbers[taken])
            volts[taken] = self._input_V(channel, times_s, numbers[taken])
        return volts

    def _input_V(self, channel: str, times_s: Array, numbers: Numbers) -> Array:
        order = np.argsort(times_s, kind="stable")
        volts = np.zeros(times_s.size)
        if channel == "1" and self._detector is not None:
            volts[order] = self._detector.detector_V(times_s[order])
        volts = volts * self._gain + self._offset_V + self._noise[numbers % SLOTS]
        codes = np.round(volts / FULL_SCALE_V[self._jumper] * (LARGEST_CODE + 1))
        codes[self._faults.during(Overload.kind, times_s)] = LARGEST_CODE
        codes = np.clip(codes, -LARGEST_CODE - 1, LARGEST_CODE)
        return np.asarray(codes / (LARGEST_CODE + 1) * self._full_scale_V(channel))

    # The pins.

    def _set_direction(self, given: list[str]) -> None:
        way, name = exactly(2, given)
        way, name = choice(way, words("IN", "OUT")), choice(name, PINS)
        if way == "IN":
            self._outputs.pop(name, None)
        else:
            self._outputs.setdefault(name, False)
        self._drive()

    def _direction(self, given: list[str]) -> str:
        return "OUT" if pin(given) in self._outputs else "IN"

    def _set_pin(self, given: list[str]) -> None:
        name, level = exactly(2, given)
        name, high = choice(name, PINS), whole_number(level, 0, 1) == 1
        if name not in self._outputs:
            raise ScpiError(-221)
        self._outputs[name] = high
        self._drive()

    def _drive(self) -> None:
        """Put the level of the trigger output on the wire, which is low where nothing drives it."""
        if self._outputs.get(OUTPUT, False):
            self._wire.rise(self._clock.now())
        else:
            self._wire.fall(self._clock.now())

    def _pin(self, given: list[str]) -> str:
        name = pin(given)
        if name in self._outputs:
            return str(int(self._outputs[name]))
        seated = name == LOOP and OUTPUT in self._outputs
        if seated and self._faults.now(NoTrigger.kind) is None:
            return str(int(self._wire.high))
        return "1"


def block_of(values: npt.NDArray[Any]) -> str:
    """Return a block of bytes, each of which is one character here."""
    data = values.tobytes()
    size = str(len(data))
    return f"#{len(size)}{size}" + data.decode(BYTES)


def exactly(count: int, given: list[str]) -> list[str]:
    """Return parameters, so many; ScpiError -109 otherwise, also with more."""
    if len(given) != count:
        raise ScpiError(-109)
    return given


def only(parameters: list[str]) -> str:
    """Return the only parameter."""
    return exactly(1, parameters)[0]


def pin(given: list[str]) -> str:
    """Return the pin that is meant."""
    return choice(only(given), PINS)


def version_of(text: str, where: str) -> tuple[int, int, int]:
    """Return a version such as 2.05-37 as numbers; SimulationError where it is none."""
    parts = text.replace("-", ".").split(".")
    if not 1 <= len(parts) <= 3 or not all(part.isdecimal() for part in parts):
        raise SimulationError(f"{where}: a version such as 2.05-37 was expected, got {text!r}")
    numbers = [int(part) for part in (*parts, "0", "0")]
    return numbers[0], numbers[1], numbers[2]


def parts_of(parameters: list[str]) -> list[int]:
    """Return the three whole numbers of a time or a date; ScpiError -109 or -108 otherwise."""
    if len(parameters) != 3:
        raise ScpiError(-109 if len(parameters) < 3 else -108)
    return [whole_number(text, 0, 9999) for text in parameters]
