"""Acutronic ACUTROL3000 motion controller with up to three axes, in ACL over TCP.

From the manuals TM-8004-C (command language), TM-9384C (TCP/IP), TM-9389 and public clients:
commands, modes, what a change of mode applies, the shortest way to a position on an axis that
turns for ever, status that stays frozen after a break, status byte that `*STB?` forgets and
`:Status:STB?` does not, limits of trip and position by mode, numbers without an exponent. What no
source settles of the answers is a key of the truth (`sim_instruments.acutronic.answers`). Assumed:
that the queue gives the oldest error first, that a servo closes with the mode off, and that
`:Mode:Home`, which the manual marks as future, turns to the encoder's zero (`mode_home` of the
truth makes it `refused` or `ignored`); that `:Interlock?` answers with the words that the manual
gives for `:Interlock:Control?` (Close, Open, Fault); that the two values of a state vector (p.113,
4.10.6) are position and rate, which `;` parts as it parts the values of an oscillator, and that
`:Read:SVector?` has the same two; that `:Demand:DeltaPosition?` answers the last change demanded;
how `:Configure:Oscillator?` writes what was set; that an event register, whose second argument is
not explained, shows the bits that are set now. An oscillator's values are kept and drive nothing.
`:Query:*` is unknown: the manual says that no commands are implemented there (p.23). A position
beyond a turn wraps around on an axis that turns for ever. Left out: oscillating, following, jerk
(it is kept, and limits nothing), the wrapping of other values beyond full scale, real-time data,
binary numbers.
"""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

from sim_instruments.acutronic.answers import Answers, ErrorQueue
from sim_instruments.acutronic.axis import MODES, Axes, Axis
from sim_instruments.acutronic.language import (
    AMBIGUOUS,
    MISSING_PARAMETER,
    OUT_OF_RANGE,
    SYNTAX,
    TOO_LONG,
    UNKNOWN_COMMAND,
    AclError,
    Act,
    Language,
    argument,
    number,
    whole,
)
from sim_instruments.acutronic.limits import Limits
from sim_instruments.acutronic.table import AclTableData
from sim_instruments.faults.lasting import EmergencyStop, FollowingError, LastingFault, Stuck
from sim_instruments.generic.table_axis import Encoder, let_faults_act
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
SLEWS = {
    0: ("ENABLE", "DISABLE"),
    3: ("POSITION", "RATE", "ACCELERATION"),
    4: ("LINEAR", "LOGARITHMIC"),
}
"""The words that configure an oscillator, by their places after the axis."""
REGISTERS = ("STATE", "DYN", "SWFLT")


class Acutrol3000(LineInstrument):
    """The controller, whose axes turn those of the world's `table`, or axes of its own.

    Truth (`simulator` mapping): what `Answers` of `sim_instruments.acutronic.answers`, `Limits` of
    `limits` and `AclTableData` of `table` there take; `mode_home`; and `axis_1` to `axis_3`, as
    many as there are, each as `Encoder` of `sim_instruments.generic.table_axis`.
    """

    model = "Acutronic ACUTROL3000"
    protocol = "acl"
    longest_line = MAX_MESSAGE
    lasting_faults: ClassVar = (FollowingError.kind, Stuck.kind, EmergencyStop.kind)

    def __init__(self, setting: Setting) -> None:
        truth, clock = setting.truth, setting.clock
        self._answers = Answers(truth)
        self._mode_home = truth.word("mode_home", HOMES, HOMES[0])
        self._identity = f"Acutronic R&D USA,Acutrol3000,{setting.serial},{FIRMWARE}"
        table, world = AclTableData(truth), setting.world.find(Table)
        self.axes = Axes()
        for n in range(1, 4):
            if f"axis_{n}" not in truth:
                break
            encoder = Encoder(truth.section(f"axis_{n}"))
            rotation = world.axis(n) if world is not None else None
            # One after another, so that an axis that is added changes no other's noise.
            rng = generator(int(setting.rng.integers(2**32)), f"axis {n}")
            self.axes[n] = Axis(table, encoder, rotation, rng, clock.now)
        if not self.axes:
            raise SimulationError(f"{truth.where}: 'axis_1' is missing; a table has an axis")
        self._errors = ErrorQueue()
        self._status_byte = self._events = 0
        limits = Limits(truth, self.axes, table)
        self._language = Language({**self._commands(), **limits.commands()})
        let_faults_act(setting, self.axes.values())
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

    def _commands(self) -> dict[str, Act]:
        answer, command, act = self.axes.answer, self.axes.command, self.axes.act
        read: dict[str, Act] = {
            "Position": answer(Axis.position_deg),
            "Rate": answer(Axis.rate_deg_per_s),
            "Acceleration": answer(Axis.acceleration),
            "SVector": answer(lambda axis: (axis.position_deg(), axis.rate_deg_per_s())),
        }
        home = {"Mode:Home": act(self._search_zero)} if self._mode_home != "refused" else {}
        return {
            "*IDN?": lambda _: self._identity,
            "*STB?": self._take_status_byte,
            "*ESR?": self._take_events,
            "*CLS": self._clear_status,
            "Mode": self._set_mode,
            "Mode?": answer(lambda axis: axis.mode.capitalize()),
            **{f"Mode:{mode}": partial(self._to_mode, mode) for mode in MODES},
            **home,
            **{f"Read:{name}{asked}": give for name, give in read.items() for asked in ("", "?")},
            "Demand:Position": command(lambda a, given: a.demand("POSITION", number(given, 0))),
            "Demand:Rate": command(lambda a, given: a.demand("RATE", number(given, 0))),
            "Demand:DeltaPosition": command(lambda a, given: a.demand_change(number(given, 0))),
            "Demand:Acceleration": command(
                lambda a, given: setattr(a.demands, "acceleration", number(given, 0))
            ),
            "Demand:Oscillator": command(
                lambda a, given: setattr(a.demands, "oscillator", numbers(given, 3))
            ),
            "Configure:Oscillator": command(
                lambda a, given: setattr(a.demands, "slews", slews(given))
            ),
            "Configure:Oscillator?": answer(lambda axis: axis.demands.slews),
            "Demand:SVector": command(lambda a, given: a.demand_vector(*numbers(given, 2))),
            "Demand:Position?": answer(lambda axis: axis.demands.position),
            "Demand:Rate?": answer(lambda axis: axis.demands.rate),
            "Demand:Acceleration?": answer(lambda axis: axis.demands.acceleration),
            "Demand:DeltaPosition?": answer(lambda axis: axis.demands.change_deg),
            "Demand:Oscillator?": answer(lambda axis: axis.demands.oscillator),
            "Demand:SVector?": answer(lambda axis: axis.demands.vector()),
            "Interlock?": answer(Axis.interlock),
            "Interlock:Close": act(Axis.close),
            "Interlock:Open": act(Axis.open),
            "Interlock:Reset": self._reset,
            "Utility:Lockout": lambda given: whole(argument(given, 0), ("ON", "OFF")) and None,
            "Status:CSR?": self._register,
            "Status:ESR?": self._register,
            "Status:STB?": lambda _: str(self._status()),
            "Status:MSG?": self._take_errors,
            "Status:MSGCLR": self._clear_errors,
        }

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

    def _search_zero(self, axis: Axis) -> None:
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

    def _emergency(self, time_s: float, fault: LastingFault | None) -> None:
        for axis in self.axes.values():
            axis.contacts_open = fault is not None
            if fault is not None:
                axis.catch_up()
                axis.emergency(time_s)
        if fault is not None:
            self._status_byte |= SAFETY_INTERLOCK | SUMMARY


def numbers(given: list[str], count: int) -> tuple[float, ...]:
    """Return the first arguments as numbers; AclError where there are more or fewer."""
    if len(given) > count:
        raise AclError(SYNTAX)
    return tuple(number(given, place) for place in range(count))


def slews(given: list[str]) -> tuple[str | float, ...]:
    """Return what the oscillator is configured to, in whole words."""
    switch, amplitude, growth = (whole(argument(given, k), SLEWS[k]) for k in SLEWS)
    return (
        switch.capitalize(),
        number(given, 1),
        number(given, 2),
        amplitude.capitalize(),
        growth.capitalize(),
    )
