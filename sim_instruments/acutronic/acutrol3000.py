"""Acutronic ACUTROL3000 motion controller with up to three axes, in ACL over TCP.

From the manuals TM-8004-C (command language) and TM-9384C (TCP/IP), and public clients: commands,
modes, what a change of mode applies, the shortest way to a position on an axis that turns for ever,
status that stays frozen after a break, status byte that is forgotten when read, numbers without an
exponent. On every line but IEEE-488 each message is answered, after eight characters of error code
and message length; how these are coded is assumed here: four decimal digits each. `framing: line`
is the other form, lines as on IEEE-488, where only queries are answered. Assumed, too: the answer
of `:Status:MSG? QERROR` (code and text, the oldest first), that a servo closes with the mode off,
and that `:Mode:Home` turns to the encoder's zero. Left out: oscillator, following, jerk (it is
kept, and limits nothing), real-time data, binary numbers.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

from sim_instruments.acutronic.axis import MODES, Axis
from sim_instruments.acutronic.language import (
    OUT_OF_RANGE,
    TEXTS,
    TOO_LONG,
    AclError,
    Language,
    argument,
    decimal,
    number,
    whole,
)
from sim_instruments.acutronic.table import Encoder, ModeLimits, TableData
from sim_instruments.faults.lasting import EmergencyStop, FollowingError, LastingFault, Stuck
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.wire.requests import LineInstrument
from sim_instruments.world.noise import generator
from sim_instruments.world.table import Table

NAMES = {"RATE": "rate", "ACCELERATION": "acceleration", "JERK": "jerk"}
TRIP_ABOVE = 1.2
"""The largest velocity trip, in the axis' largest rate."""


class Axes(dict[int, Axis]):
    """Axes by number; in a command ALL means each of them."""

    def one(self, given: list[str]) -> Axis:
        """Return the axis that the first argument names."""
        n = number(given, 0)
        if n not in self:
            raise AclError(OUT_OF_RANGE)
        return self[int(n)]

    def named(self, given: list[str]) -> list[Axis]:
        """Return the axes that the first argument names."""
        if given and given[0].upper() == "ALL":
            return list(self.values())
        return [self.one(given)]

    def answer(self, answer: Callable[[Axis, list[str]], str]) -> Callable[[list[str]], str]:
        """Return a query whose first argument is an axis."""
        return lambda given: answer(self.one(given), given[1:])

    def command(self, act: Callable[[Axis, list[str]], None]) -> Callable[[list[str]], None]:
        """Return a command whose first argument is an axis, or ALL."""

        def command(given: list[str]) -> None:
            for axis in self.named(given):
                act(axis, given[1:])

        return command


def add_limits(language: Language, axes: Axes, table: TableData) -> None:
    """Add the limits: of a mode at once, one by one with the mode first, absolute, and trips."""
    add = language.add
    add("Limit", partial(limit_all, axes, table))
    add("Limit:Absolute?", axes.answer(partial(absolute, table)))
    for name, key in NAMES.items():
        add(f"Limit:{name}", partial(limit_one, axes, table, key))
        add(f"Limit:{name}?", partial(limit_of, axes, key))
    for name, key in (("LowPosition", "low_deg"), ("HighPosition", "high_deg")):
        add(f"Limit:{name}", axes.command(partial(limit_position, key)))
        add(f"Limit:{name}?", axes.answer(partial(position_limit, key)))
    add("Limit:VelocityTrip", axes.command(partial(set_trip, table)))
    add("Limit:VelocityTrip?", axes.answer(lambda axis, _: decimal(axis.velocity_trip)))


def limit_all(axes: Axes, table: TableData, given: list[str]) -> None:
    """Take axis, mode, rate, acceleration and jerk."""
    mode = whole(argument(given, 1), MODES)
    for axis in axes.named(given):
        for place, key in enumerate(NAMES.values(), 2):
            if place < len(given):
                set_limit(table, axis.limits[mode], key, number(given, place))


def limit_one(axes: Axes, table: TableData, key: str, given: list[str]) -> None:
    """Take mode, axis and one limit."""
    mode = whole(argument(given, 0), MODES)
    for axis in axes.named(given[1:]):
        set_limit(table, axis.limits[mode], key, number(given, 2))


def set_limit(table: TableData, limits: ModeLimits, key: str, value: float) -> None:
    """Set a limit that the axis can keep."""
    largest = {"rate": table.largest_rate, "acceleration": table.largest_acceleration}
    if not 0 < value <= largest.get(key, math.inf):
        raise AclError(OUT_OF_RANGE)
    setattr(limits, key, value)


def limit_of(axes: Axes, key: str, given: list[str]) -> str:
    """Return a limit of a mode of an axis."""
    limits = axes.one(given[1:]).limits[whole(argument(given, 0), MODES)]
    return decimal(getattr(limits, key))


def limit_position(key: str, axis: Axis, given: list[str]) -> None:
    """Limit the positions of an axis that has end stops."""
    value = number(given, 0)
    if axis.encoder.continuous or not axis.encoder.low_deg <= value <= axis.encoder.high_deg:
        raise AclError(OUT_OF_RANGE)
    setattr(axis, key, value)


def position_limit(key: str, axis: Axis, given: list[str]) -> str:
    """Return a limit of the positions of an axis."""
    return ended(getattr(axis, key))


def set_trip(table: TableData, axis: Axis, given: list[str]) -> None:
    """Set the rate at which an axis trips."""
    value = number(given, 0)
    if not 0 < value <= TRIP_ABOVE * table.largest_rate:
        raise AclError(OUT_OF_RANGE)
    axis.velocity_trip = value


def absolute(table: TableData, axis: Axis, given: list[str]) -> str:
    """Return what the maker set: rate, acceleration, jerk, positions and velocity trip."""
    rate, acceleration = table.largest_rate, table.largest_acceleration
    ends = [ended(axis.encoder.low_deg), ended(axis.encoder.high_deg)]
    values = [decimal(one) for one in (rate, acceleration, 10 * acceleration)]
    return ",".join([*values, *ends, decimal(TRIP_ABOVE * rate)])


def ended(limit_deg: float) -> str:
    """Return a position limit, 0 and 360 standing for an axis that turns for ever."""
    if limit_deg in (float("inf"), float("-inf")):
        return decimal(360.0 if limit_deg > 0 else 0.0)
    return decimal(limit_deg)


FIRMWARE = "A8800-001-01.000-a"
FRAMINGS = ("framed", "line")
LONGEST_MESSAGE = 32768
ERRORS_KEPT = 20
SAFETY_INTERLOCK, SUMMARY, ERRORS_WAIT = 1 << 0, 1 << 6, 1 << 7
REGISTERS = ("STATE", "DYN", "SWFLT")


class Acutrol3000(LineInstrument):
    """The controller, whose axes turn those of the world's `table`, or axes of its own.

    Truth (`simulator` mapping): `framing`; what `TableData` of `sim_instruments.acutronic.table`
    needs; and `axis_1` to `axis_3`, as many as there are, each as `Encoder` there.
    """

    model = "Acutronic ACUTROL3000"
    protocol = "acl"
    resource = "socket://{host}:{port}"
    lasting_faults: ClassVar = (FollowingError.kind, Stuck.kind, EmergencyStop.kind)

    def __init__(self, setting: Setting) -> None:
        truth, clock = setting.truth, setting.clock
        self._framing = truth.text("framing")
        if self._framing not in FRAMINGS:
            raise SimulationError(f"{truth.where}.framing: write one of {', '.join(FRAMINGS)}")
        self._identity = f"Acutronic R&D USA,Acutrol3000,{setting.serial},{FIRMWARE}"
        table, world = TableData.read(truth), setting.world.find(Table)
        self.axes = Axes()
        for n in range(1, 4):
            if f"axis_{n}" not in truth:
                break
            encoder = Encoder.read(truth.section(f"axis_{n}"))
            rotation = world.axis(n) if world is not None else None
            # One after another, so that an axis that is added changes no other's noise.
            rng = generator(int(setting.rng.integers(2**32)), f"axis {n}")
            self.axes[n] = Axis(table, encoder, rotation, rng, clock.now)
        if not self.axes:
            raise SimulationError(f"{truth.where}: 'axis_1' is missing; a table has an axis")
        self._table = table
        self._errors: deque[int] = deque()
        self._status_byte = 0
        self._language = self._commands()
        setting.faults.when_changed(FollowingError.kind, self._falls_behind)
        setting.faults.when_changed(Stuck.kind, self._sticks)
        setting.faults.when_changed(EmergencyStop.kind, self._emergency)
        self.begin_to_serve(setting)

    def describe(self) -> dict[str, Any]:
        """Return what `station sim` prints about this instrument."""
        return {**super().describe(), "framing": self._framing}

    def energised(self) -> bool:
        """Return whether an axis turns."""
        return any(axis.turns() for axis in self.axes.values())

    def _line(self, line: bytes) -> bytes:
        for axis in self.axes.values():
            axis.catch_up()
        text = line.decode("ascii", "replace").strip()
        code, answers = self._carried_out(text)
        if self._framing == "line":
            return f"{';'.join(answers)}\r\n".encode("ascii") if answers else b""
        if not text:
            return b""
        body = TEXTS[code] if code else ";".join(answers) or "OK"
        return f"{code:04d}{len(body):04d}{body}".encode("ascii")

    def _carried_out(self, text: str) -> tuple[int, list[str]]:
        """Carry out a message; return its first error, 0 for none, and its answers."""
        if len(text) > LONGEST_MESSAGE:
            return self._refused(TOO_LONG), []
        first, answers = 0, []
        for act, arguments, wrong in self._language.steps(text):
            code = wrong
            try:
                answer = act(arguments) if act is not None else None
                if answer is not None:
                    answers.append(answer)
            except AclError as error:
                code = error.code
            if code:
                first = first or self._refused(code)
        return first, answers

    def _refused(self, code: int) -> int:
        if len(self._errors) < ERRORS_KEPT:
            self._errors.append(code)
        return code

    def _commands(self) -> Language:
        language = Language()
        add = language.add
        add("*IDN?", lambda _: self._identity)
        add("*STB?", self._take_status_byte)
        add("Mode", self._set_mode)
        add("Mode?", self.axes.answer(lambda axis, _: axis.mode.capitalize()))
        for mode in MODES:
            add(f"Mode:{mode}", partial(self._to_mode, mode))
        add("Mode:Home", self.axes.command(lambda axis, _: axis.search_zero()))
        for name, mode in (("Position", "POSITION"), ("Rate", "RATE")):
            add(f"Demand:{name}", self.axes.command(partial(demand, mode)))
        add("Demand:Position?", self.axes.answer(lambda a, _: decimal(a.demands.position)))
        add("Demand:Rate?", self.axes.answer(lambda a, _: decimal(a.demands.rate)))
        add("Demand:DeltaPosition", self.axes.command(lambda a, v: a.demand_change(number(v, 0))))
        for asked in ("", "?"):
            add(f"Read:Position{asked}", self.axes.answer(lambda a, _: decimal(a.position_deg())))
            add(f"Read:Rate{asked}", self.axes.answer(lambda a, _: decimal(a.rate_deg_per_s())))
        add("Interlock:Close", self.axes.command(lambda axis, _: axis.close()))
        add("Interlock:Open", self.axes.command(lambda axis, _: axis.open()))
        add("Interlock:Reset", self._reset)
        add("Utility:Lockout", lambda given: whole(argument(given, 0), ("ON", "OFF")) and None)
        add_limits(language, self.axes, self._table)
        add("Status:CSR?", self._register)
        add("Status:MSG?", self._take_error)
        add("Query:Error?", lambda given: TEXTS.get(int(number(given, 0)), "UNKNOWN ERROR"))
        return language

    def _set_mode(self, given: list[str]) -> None:
        mode = whole(argument(given, 1), MODES)
        for axis in self.axes.named(given):
            axis.set_mode(mode)

    def _to_mode(self, mode: str, given: list[str]) -> None:
        self._set_mode([*given[:1], mode])

    def _reset(self, given: list[str]) -> None:
        for axis in self.axes.values():
            axis.reset()

    def _register(self, given: list[str]) -> str:
        name = argument(given, 0).upper()
        axis = self.axes.one([name[1:2]]) if name[:1] == "A" and name[1:2].isdigit() else None
        if axis is None or name[2:] not in REGISTERS:
            raise AclError(OUT_OF_RANGE)
        status = axis.status()
        return str((status.state, status.dynamic, status.fault)[REGISTERS.index(name[2:])])

    def _take_error(self, given: list[str]) -> str:
        whole(argument(given, 0), ("QERROR",))
        code = self._errors.popleft() if self._errors else 0
        return f"{code},{TEXTS[code]}"

    def _take_status_byte(self, given: list[str]) -> str:
        byte, self._status_byte = self._status_byte, 0
        return str(byte | (ERRORS_WAIT if self._errors else 0))

    def _falls_behind(self, time_s: float, fault: LastingFault | None) -> None:
        for axis in self.axes.values():
            axis.falls_behind = False
            if fault is not None:
                axis.fall_behind(time_s)

    def _sticks(self, time_s: float, fault: LastingFault | None) -> None:
        for axis in self.axes.values():
            axis.stick(time_s, fault is not None)

    def _emergency(self, time_s: float, fault: LastingFault | None) -> None:
        for axis in self.axes.values():
            axis.contacts_open = fault is not None
            if fault is not None:
                axis.catch_up()
                axis.emergency(time_s)
        if fault is not None:
            self._status_byte |= SAFETY_INTERLOCK | SUMMARY


def demand(mode: str, axis: Axis, given: list[str]) -> None:
    """Demand a position or a rate of an axis."""
    axis.demand(mode, number(given, 0))
