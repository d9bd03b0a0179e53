"""Acutronic ACUTROL3000 motion controller with up to three axes, in ACL over TCP.

From the manuals TM-8004-C (command language), TM-9384C (TCP/IP), TM-9389 and public clients:
commands, modes, what a change of mode applies, the shortest way to a position on an axis that
turns for ever, status that stays frozen after a break, status byte that `*STB?` forgets and
`:Status:STB?` does not, limits of trip and position by mode, numbers without an exponent. What no
source settles of the answers is a key of the truth (`sim_instruments.acutronic.answers`). Assumed:
that the queue gives the oldest error first, that a servo closes with the mode off, and that
`:Mode:Home`, which the manual marks as future, turns to the encoder's zero; `mode_home` of the
truth makes it `refused` or `ignored`. Left out: oscillating, following, jerk (it is kept, and
limits nothing), the wrapping of values beyond full scale, real-time data, binary numbers.
"""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

from sim_instruments.acutronic.answers import Answers, ErrorQueue
from sim_instruments.acutronic.axes import Axes
from sim_instruments.acutronic.axis import MODES, Axis
from sim_instruments.acutronic.language import (
    AMBIGUOUS,
    MISSING_PARAMETER,
    OUT_OF_RANGE,
    SYNTAX,
    TEXTS,
    TOO_LONG,
    UNKNOWN_COMMAND,
    AclError,
    Language,
    argument,
    number,
    whole,
)
from sim_instruments.acutronic.limits import Limits
from sim_instruments.acutronic.others import add_others
from sim_instruments.acutronic.table import Encoder, TableData
from sim_instruments.faults.lasting import EmergencyStop, FollowingError, LastingFault, Stuck
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.wire.requests import LineInstrument
from sim_instruments.world.noise import generator
from sim_instruments.world.table import Table

FIRMWARE = "A8800-001-01.000-a"
HOMES = ("done", "ignored", "refused")
MAX_MESSAGE = 32768
EVERY_ERROR = 1 << 30
SAFETY_INTERLOCK, SUMMARY, ERRORS_WAIT = 1 << 0, 1 << 6, 1 << 7
COMMAND_ERROR, EXECUTION_ERROR = 1 << 5, 1 << 4
"""Of the standard event register, IEEE 488.2 11.5.1."""

NOT_UNDERSTOOD = (UNKNOWN_COMMAND, AMBIGUOUS, SYNTAX, MISSING_PARAMETER, TOO_LONG)
REGISTERS = ("STATE", "DYN", "SWFLT")


class Acutrol3000(LineInstrument):
    """The controller, whose axes turn those of the world's `table`, or axes of its own.

    Truth (`simulator` mapping): what `Answers` of `sim_instruments.acutronic.answers`, `Limits` of
    `limits` and `TableData` of `table` there take; `mode_home`; and `axis_1` to `axis_3`, as many
    as there are, each as `Encoder` there.
    """

    model = "Acutronic ACUTROL3000"
    protocol = "acl"
    resource = "socket://{host}:{port}"
    longest_line = MAX_MESSAGE
    lasting_faults: ClassVar = (FollowingError.kind, Stuck.kind, EmergencyStop.kind)

    def __init__(self, setting: Setting) -> None:
        truth, clock = setting.truth, setting.clock
        self._answers = Answers(truth)
        self._mode_home = truth.word("mode_home", HOMES, HOMES[0])
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
        self._errors = ErrorQueue()
        self._status_byte = self._events = 0
        self._language = self._commands()
        Limits(truth, self.axes, table).add_to(self._language)
        setting.faults.when_changed(FollowingError.kind, self._falls_behind)
        setting.faults.when_changed(Stuck.kind, self._sticks)
        setting.faults.when_changed(EmergencyStop.kind, self._emergency)
        self.begin_to_serve(setting)

    def describe(self) -> dict[str, Any]:
        """Return what `station sim` prints about this instrument."""
        return {**super().describe(), "framing": self._answers.framing}

    def energised(self) -> bool:
        """Return whether an axis turns."""
        return any(axis.turns() for axis in self.axes.values())

    def knows(self, command: str) -> bool:
        """Whether the controller has every header of a message."""
        return all(step.act is not None for step in self._language.steps(command))

    def _line(self, line: bytes) -> bytes:
        for axis in self.axes.values():
            axis.catch_up()
        text = line.decode("ascii", "replace").strip()
        if not text:
            return b""
        return self._answers.sent(*self._carried_out(text))

    def _too_long(self) -> bytes:
        return self._answers.sent(self._refused(TOO_LONG), [])

    def _carried_out(self, text: str) -> tuple[int, list[str]]:
        """Carry out a message; return its first error, 0 for none, and its answers."""
        first, answers = 0, []
        for act, arguments, wrong in self._language.steps(text):
            code = wrong
            try:
                answer = act(self._answers.taken(arguments)) if act is not None else None
                if answer is not None:
                    answers.append(self._answers.written(answer))
            except AclError as error:
                code = error.code
            if code:
                first = first or self._refused(code)
        return first, answers

    def _refused(self, code: int) -> int:
        self._events |= COMMAND_ERROR if code in NOT_UNDERSTOOD else EXECUTION_ERROR
        return self._errors.add(code)

    def _commands(self) -> Language:
        language = Language()
        add = language.add
        add("*IDN?", lambda _: self._identity)
        add("*STB?", self._take_status_byte)
        add("*ESR?", self._take_events)
        add("*CLS", self._clear_status)
        add("Mode", self._set_mode)
        add("Mode?", self.axes.answer(lambda axis, _: axis.mode.capitalize()))
        for mode in MODES:
            add(f"Mode:{mode}", partial(self._to_mode, mode))
        if self._mode_home != "refused":
            add("Mode:Home", self.axes.command(self._search_zero))
        for name, mode in (("Position", "POSITION"), ("Rate", "RATE")):
            add(f"Demand:{name}", self.axes.command(partial(demand, mode)))
        add("Demand:Position?", self.axes.answer(lambda a, _: a.demands.position))
        add("Demand:Rate?", self.axes.answer(lambda a, _: a.demands.rate))
        add("Demand:DeltaPosition", self.axes.command(lambda a, v: a.demand_change(number(v, 0))))
        for asked in ("", "?"):
            add(f"Read:Position{asked}", self.axes.answer(lambda a, _: a.position_deg()))
            add(f"Read:Rate{asked}", self.axes.answer(lambda a, _: a.rate_deg_per_s()))
        add("Interlock:Close", self.axes.command(lambda axis, _: axis.close()))
        add("Interlock:Open", self.axes.command(lambda axis, _: axis.open()))
        add("Interlock:Reset", self._reset)
        add("Utility:Lockout", lambda given: whole(argument(given, 0), ("ON", "OFF")) and None)
        add_others(language, self.axes)
        for registers in ("CSR", "ESR"):
            add(f"Status:{registers}?", self._register)
        add("Status:STB?", lambda _: str(self._status()))
        add("Status:MSG?", self._take_errors)
        add("Status:MSGCLR", self._clear_errors)
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
        axis = (
            self.axes.named_axis([name[1:2]]) if name[:1] == "A" and name[1:2].isdigit() else None
        )
        if axis is None or name[2:] not in REGISTERS:
            raise AclError(OUT_OF_RANGE)
        status = axis.status()
        return str((status.state, status.dynamic, status.fault)[REGISTERS.index(name[2:])])

    def _search_zero(self, axis: Axis, given: list[str]) -> None:
        if self._mode_home == "done":
            axis.search_zero()

    def _take_errors(self, given: list[str]) -> str:
        whole(argument(given, 0), ("QERROR",))
        every = len(given) > 1 and given[1].upper() == "ALL"
        count = EVERY_ERROR if every else int(number(given, 1)) if len(given) > 1 else 1
        return self._answers.entries(self._errors.take(count))

    def _clear_errors(self, given: list[str]) -> None:
        whole(argument(given, 0), ("QERROR", "ALL"))
        self._errors.clear()

    def _clear_status(self, given: list[str]) -> None:
        self._errors.clear()
        self._status_byte = self._events = 0

    def _status(self) -> int:
        return self._status_byte | (ERRORS_WAIT if len(self._errors) else 0)

    def _take_status_byte(self, given: list[str]) -> str:
        byte, self._status_byte = self._status(), 0
        return str(byte)

    def _take_events(self, given: list[str]) -> str:
        events, self._events = self._events, 0
        return str(events)

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
