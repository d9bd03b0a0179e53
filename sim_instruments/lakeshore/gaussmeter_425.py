"""Lake Shore 425 gaussmeter with a probe of one axis, in lines of text.

From its manual: the mnemonics and their parameters, `+nnn.nnnE+nn`, the identity, commands chained
with `;`, `?` alone for the last query again, zero as the minimum of `RDGMNMX?`, `*RST` for the
settings at power-up and `DFLT` for the maker's, the seven fields of ALARM (p. 52: on, magnitude or
algebraic, low, high, outside or inside, sort, audible), the relay that follows it (p. 56), and
that it must be left alone for 30 ms after a line, else "intermittent failures" follow (p.50). From
public clients: the ranges 35 G to 35 kG, the bits of `OPST?`, and that the maker's own client does
not pause and works all the same: of the lines that come sooner one in four is lost here, by the
instrument's own chance. Assumed, since no source at hand says it: answers to chained queries are
joined by `;`; a reading is the mean of the last whole 0.1 s; beyond its range it reads 999.999E+09;
autorange takes the lowest range that holds the last reading; what it does not know or like it
passes over in silence; an alarm that is given the first five fields alone, as some clients send it,
keeps the others. An alarm does not sound here, and zeroing takes no time.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import ClassVar, NamedTuple

import numpy as np

from sim_instruments.faults.lasting import Frozen, Overload
from sim_instruments.instrument import Setting
from sim_instruments.wire.requests import LineInstrument
from sim_instruments.world.coils import AXES, direction_near
from sim_instruments.world.laser_gyro import LaserGyroBench

FIRMWARE = "1.0"
PERIOD_S = 0.1
PAUSE_S = 0.03
PATIENCE = 1e-6
LOST_SHARE = 0.25
RANGES_MT = (3.5, 35.0, 350.0, 3500.0)
PER_MT = {1: 10.0, 2: 1e-3, 3: 10.0, 4: 1e-3 / (4e-7 * np.pi)}
"""Gauss, tesla, oersted (in air), ampere per metre."""
OVERLOAD = 999.999e9
NUMBER = re.compile(r"[+-]?\d+(\.\d*)?([Ee][+-]?\d+)?")
ALARM = re.compile(r"([01]),([12]),([^,]+),([^,]+),([12])(?:,([01]),([01]))?")
LARGEST_ALARM_MT = 35_000.0
RELAY = re.compile(r"([012]),([123])")
LOW, HIGH, ALARM_BIT = 1, 2, 8
MODE = re.compile(r"([12]),([01]),([12])")


class Alarm(NamedTuple):
    """What the reading is held against, and how."""

    on: bool = False
    algebraic: bool = False
    low_mT: float = 0.0
    high_mT: float = 0.0
    inside: bool = False
    sorts: str = "0"
    audible: str = "0"

    def state(self, field_mT: float) -> int:
        """Return which alarms are on: 1 the low one, 2 the high one, 3 both."""
        if not self.on:
            return 0
        value = field_mT if self.algebraic else abs(field_mT)
        if self.inside:
            return LOW | HIGH if self.low_mT < value < self.high_mT else 0
        return (LOW if value < self.low_mT else 0) | (HIGH if value > self.high_mT else 0)


class Lakeshore425(LineInstrument):
    """The gaussmeter at the probe's place, turned to x until somebody turns it.

    Truth (`simulator` mapping): `noise` of a reading (rms), `gain_error`, `zero_offset`, and
    `turned` (x, y, z): by how much the probe leans towards the other axes when it is turned there;
    `unit`, 1 to 4, may be given: as somebody left it.
    """

    model = "Lake Shore 425"
    lasting_faults: ClassVar = (Frozen.kind, Overload.kind)

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        self._serial = setting.serial
        self._turned = setting.world.find(LaserGyroBench)
        self._world, self._clock, self._rng = setting.world, setting.clock, setting.rng
        self._faults = setting.faults
        self._noise_mT = truth.quantity("noise", "mT")
        self._gain = 1.0 + truth.quantity("gain_error", "1")
        self._zero_mT = truth.quantity("zero_offset", "mT")
        turned = truth.section("turned")
        self._directions = {axis: direction_near(axis, turned.section(axis)) for axis in AXES}
        self._free_s = 0.0
        self._last_query = ""
        self._measured_mT, self._reading_mT, self._largest_mT = 0.0, 0.0, 0.0
        self._period = -1
        (self._chance,) = setting.rng.spawn(1)  # that of the noise goes on undisturbed
        self._new = self._zeroed = False
        self._zero_now_mT = 0.0
        self._restore()
        self._unit_at_power_up = self._unit = truth.integer("unit", 1, 1)
        self._queries: dict[str, Callable[[], str]] = {
            "*IDN?": lambda: f"LSCI,MODEL425,{self._serial},{FIRMWARE}",
            "RDGFIELD?": lambda: self._shown(self._read_mT()),
            "RDGMX?": lambda: self._shown(self._largest_mT),
            "RDGMNMX?": lambda: f"{self._shown(0.0)},{self._shown(self._largest_mT)}",
            "UNIT?": lambda: str(self._unit),
            "RANGE?": lambda: str(self._range),
            "AUTO?": lambda: str(int(self._auto)),
            "RDGMODE?": lambda: self._mode,
            "TYPE?": lambda: "40",
            "OPST?": self._operation_status,
            "RDGREL?": lambda: self._shown(self._read_mT() - self._relative_mT),
            "REL?": lambda: str(int(self._relative)),
            "RELSP?": lambda: self._shown(self._relative_mT),
            "ALARM?": self._shown_alarm,
            "RELAY?": lambda: f"{self._relay},{self._relay_alarm}",
            "RELAYST?": lambda: str(int(self._relay_is_on())),
        }
        self.begin_to_serve(setting)

    def knows(self, command: str) -> bool:
        """Whether the meter has a question, or the setting that it asks for."""
        return f"{command.removesuffix('?')}?" in self._queries

    def _restore(self) -> None:
        self._unit, self._range, self._auto, self._mode = 1, 4, True, "1,1,1"
        self._relative, self._relative_mT, self._alarm = False, 0.0, Alarm()
        self._relay, self._relay_alarm = 0, 3

    def _line(self, line: bytes) -> bytes:
        now_s = self._clock.now()
        if now_s < self._free_s - PATIENCE and self._chance.random() < LOST_SHARE:
            return b""
        self._free_s = now_s + PAUSE_S
        text = line.decode("ascii", "replace").strip().upper()
        if text == "?":
            text = self._last_query
        answers = [
            self._carry_out(command.strip()) for command in text.split(";") if command.strip()
        ]
        reply = ";".join(answer for answer in answers if answer is not None)
        return reply.encode("ascii") + b"\r\n" if reply else b""

    def _carry_out(self, command: str) -> str | None:
        if command in self._queries:
            self._last_query = command
            return self._queries[command]()
        name, _, parameter = command.partition(" ")
        number = int(parameter) if parameter.isdigit() else -1
        if name == "UNIT" and number in PER_MT:
            self._unit = number
        elif name == "RANGE" and 1 <= number <= len(RANGES_MT):
            self._range, self._auto = number, False
        elif name == "AUTO":  # public clients send it without a parameter
            self._auto = number != 0
        elif name == "RDGMODE" and MODE.fullmatch(parameter.replace(" ", "")):
            self._mode = parameter.replace(" ", "")
        elif name in ("*RST", "DFLT"):
            self._restore()
            self._unit = self._unit if name == "DFLT" else self._unit_at_power_up
        elif name == "REL" and number in (0, 1):
            self._relative = number == 1
            self._relative_mT = self._read_mT() if self._relative else self._relative_mT
        elif name == "RELSP" and NUMBER.fullmatch(parameter):
            self._relative_mT = float(parameter) / PER_MT[self._unit]
        elif name == "ALARM":
            self._set_alarm(parameter.replace(" ", ""))
        elif name == "RELAY" and (relay := RELAY.fullmatch(parameter.replace(" ", ""))):
            self._relay, self._relay_alarm = int(relay[1]), int(relay[2])
        elif name == "ZPROBE":
            self._zero_now_mT, self._zeroed = self._zero_now_mT + self._read_mT(), True
        elif name == "ZCLEAR":
            self._zero_now_mT, self._zeroed = 0.0, False
        return None

    def _read_mT(self) -> float:
        """Return the mean of the last whole period; within one it stays the same."""
        now_s = self._clock.now()
        period = int(np.floor(now_s / PERIOD_S + 1e-9))
        if self._faults.now(Frozen.kind) is None and period != self._period and period > 0:
            edges_s = np.array([(period - 1) * PERIOD_S, period * PERIOD_S])
            axis = self._turned.probe_axis if self._turned is not None else "x"
            field_mT = self._world.mean_probe_field_mT(edges_s)[0] @ self._directions[axis]
            noise_mT = self._noise_mT * float(self._rng.standard_normal())
            self._measured_mT = float(field_mT) * self._gain + self._zero_mT + noise_mT
            self._period, self._new = period, True
        self._reading_mT = self._measured_mT - self._zero_now_mT
        if self._auto:
            fitting = [k for k, end in enumerate(RANGES_MT, 1) if abs(self._reading_mT) <= end]
            self._range = fitting[0] if fitting else len(RANGES_MT)
        beyond = abs(self._reading_mT) > RANGES_MT[self._range - 1]
        if beyond or self._faults.now(Overload.kind) is not None:
            return float("inf")
        self._largest_mT = max(self._largest_mT, abs(self._reading_mT))
        return self._reading_mT

    def _set_alarm(self, parameter: str) -> None:
        given = ALARM.fullmatch(parameter)
        if given is None or not all(NUMBER.fullmatch(text) for text in given.group(3, 4)):
            return
        low_mT, high_mT = (float(text) / PER_MT[self._unit] for text in given.group(3, 4))
        if max(abs(low_mT), abs(high_mT)) > LARGEST_ALARM_MT:
            return
        inside, algebraic = given[5] == "2", given[2] == "2"
        sorts, audible = given[6] or self._alarm.sorts, given[7] or self._alarm.audible
        self._alarm = Alarm(given[1] == "1", algebraic, low_mT, high_mT, inside, sorts, audible)

    def _shown_alarm(self) -> str:
        alarm = self._alarm
        levels = f"{self._shown(alarm.low_mT)},{self._shown(alarm.high_mT)}"
        return (
            f"{alarm.on:d},{alarm.algebraic + 1:d},{levels},{alarm.inside + 1:d},"
            f"{alarm.sorts},{alarm.audible}"
        )

    def _alarm_state(self) -> int:
        return self._alarm.state(self._read_mT())

    def _relay_is_on(self) -> bool:
        return self._relay == 1 or (
            self._relay == 2 and bool(self._alarm_state() & self._relay_alarm)
        )

    def _operation_status(self) -> str:
        """Return bit 1 overload, 2 a new reading since the last question, 3 alarm, 7 zeroed."""
        overload = not np.isfinite(self._read_mT())
        status = 2 * overload + 4 * self._new + 128 * self._zeroed
        status += ALARM_BIT * bool(self._alarm_state())
        self._new = self._zeroed = False
        return f"{status:03d}"

    def _shown(self, field_mT: float) -> str:
        """Return a reading in the present unit as `+nnn.nnnE+nn`."""
        value = field_mT * PER_MT[self._unit] if np.isfinite(field_mT) else OVERLOAD
        exponent = 3 * int(np.floor(np.log10(abs(value)) / 3)) if value else 0
        mantissa = round(value / 10.0**exponent, 3)
        if abs(mantissa) >= 1000.0:
            mantissa, exponent = mantissa / 1000.0, exponent + 3
        return f"{mantissa:+08.3f}E{exponent:+03d}"
