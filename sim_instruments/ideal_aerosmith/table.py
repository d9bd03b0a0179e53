"""Ideal Aerosmith rate table with up to three axes, in the maker's table language, by lines.

No manual of the maker was at hand. What is here is what three public clients of one-axis tables
send and expect (a control panel of a 1270VS, an incoming inspection's rate sweep, a test suite of
an IMU): CR ends a command, LF after it is nothing; a value is followed by CR LF, `>`, CR LF, a
command that was carried out answers with these alone; `?` in an answer is a refusal. Positive rates
are clockwise from above. STO acts without the end of a line, as one of the clients sends it.

Where they differ, or one is silent, the form is a key of the truth (`Forms`). Assumed, because none
says so: a digit before the command names the axis of a table with several, none is the first;
values are in deg, deg/s and deg/s^2 and may have a fraction; a motor that is off refuses movements;
VEL limits moves and not JOG; STO brakes with ACL; HOM goes to the encoder's zero; what is asked
with `?` behind the mnemonic; the bits of STA. Values of an oscillation, HOF, DIR, CAL, CLU and REX
are taken and drive nothing; SGO moves nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, ClassVar

from sim_instruments.faults.lasting import EmergencyStop, FollowingError, LastingFault, Stuck
from sim_instruments.generic.table_axis import Encoder, let_faults_act
from sim_instruments.ideal_aerosmith.axis import AtlTableData, Axis, Refused
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.wire.requests import Conversation, LineInstrument, LineServer
from sim_instruments.world.noise import generator
from sim_instruments.world.rotation import RotationHistory
from sim_instruments.world.table import Table

END = "\r\n>\r\n"
REFUSAL = "?"
COMMAND = re.compile(r"(\d?)(?:([A-Z]{3})(\?)?|(P)(?=[-+.\d]))([-+]?(?:\d+\.?\d*|\.\d+))?")
STOPS_AT_ONCE = re.compile(rb"(?i)\s*\d?STO")
MOTOR_ON, MOVING, COMPLETE, PRESSED = 1, 2, 4, 8
KEPT = ("AMP", "FRQ", "PER", "CYC", "HOF", "DIR", "CAL", "CLU", "REX")
"""Values that are kept and drive nothing."""

BY = {"second": 1.0, "minute": 60.0}


class Forms:
    """What the clients do not agree on; each a key of the truth, and optional.

    * `acknowledges`: `all`, or `no-motion`: JOG and SGO are not answered;
    * `position`: `wraps` from 0 deg to 360 deg on an axis that turns for ever, or counts `turns`;
    * `complete`: what MCO answers for a movement that is over, `1` or `0`;
    * `rates`: by `second` or by `minute`, in and out;
    * `settings_asked`: false where nothing can be asked with `?` behind the mnemonic;
    * `whole_rates`: true where JOG takes whole numbers alone;
    * `echoes`: true where a command is said again before its answer;
    * `unknown`: mnemonics that the firmware does not have, with blanks between; without SRV motors
      are on.
    """

    def __init__(self, truth: Truth) -> None:
        self.silent_motion = truth.word("acknowledges", ("all", "no-motion"), "all") != "all"
        self.wraps = truth.word("position", ("wraps", "turns"), "wraps") == "wraps"
        self.complete = truth.word("complete", ("1", "0"), "1") == "1"
        self.per_s = BY[truth.word("rates", tuple(BY), "second")]
        self.asked = "settings_asked" not in truth or truth.switch("settings_asked")
        self.whole_rates = "whole_rates" in truth and truth.switch("whole_rates")
        self.echoes = "echoes" in truth and truth.switch("echoes")
        self.unknown = set(truth.text("unknown", "").split())


class StopServer(LineServer):
    """A server of lines in which STO needs no end."""

    def requests(self, talk: Conversation, data: bytes) -> Iterator[bytes]:
        """Yield each line that is whole, and STO as soon as it is there."""
        yield from super().requests(talk, data)
        if STOPS_AT_ONCE.fullmatch(talk.pending):
            stop, talk.pending = talk.pending, b""
            yield stop


class IdealAerosmithTable(LineInstrument):
    """The controller, whose axes turn those of the world's `table`, or axes of its own.

    Truth (`simulator` mapping): what `AtlTableData` of `axis` there and `Forms` take, and
    `axis_1` to `axis_3`, as many as there are, each as `Encoder` of
    `sim_instruments.generic.table_axis`.
    """

    model = "Ideal Aerosmith rate table"
    line_end = b"\r"
    lasting_faults: ClassVar = (FollowingError.kind, Stuck.kind, EmergencyStop.kind)

    def __init__(self, setting: Setting) -> None:
        truth, clock = setting.truth, setting.clock
        self._forms = Forms(truth)
        data = AtlTableData(truth)
        idle_on = "SRV" in self._forms.unknown
        self.axes: dict[int, Axis] = {}
        for n in range(1, 4):
            if f"axis_{n}" not in truth:
                break
            encoder = Encoder(truth.section(f"axis_{n}"))
            rotation = self._rotation(setting, n)
            rng = generator(int(setting.rng.integers(2**32)), f"axis {n}")
            self.axes[n] = Axis(data, encoder, rotation, rng, clock.now, motor_on=idle_on)
        if not self.axes:
            raise SimulationError(f"{truth.where}: 'axis_1' is missing; a table has an axis")
        self._largest = data
        self._kept: dict[tuple[str, int], float] = {}
        self._acts = self._commands()
        let_faults_act(setting, self.axes.values())
        setting.faults.when_changed(EmergencyStop.kind, self._emergency)
        self.begin_to_serve(setting)

    def _rotation(self, setting: Setting, n: int) -> RotationHistory | None:
        """Return what an axis turns in the world; None for an axis of its own."""
        world = setting.world.find(Table)
        return world.axis(n) if world is not None else None

    def energised(self) -> bool:
        """Return whether an axis turns."""
        for axis in self.axes.values():
            axis.catch_up()
        return any(axis.turns() for axis in self.axes.values())

    def knows(self, command: str) -> bool:
        """Whether the controller has a mnemonic, as it is written or asked."""
        match = COMMAND.fullmatch(command.strip().upper())
        return match is not None and self._mnemonic(match) in self._acts

    def _server_kind(self) -> Callable[..., LineServer]:
        return StopServer

    def _line(self, line: bytes) -> bytes:
        for axis in self.axes.values():
            axis.catch_up()
        text = line.decode("ascii", "replace").strip().upper()
        # STO needs no end, so another command may stand right behind it.
        stop = re.match(r"(\d?STO)(?=.)", text)
        answers = "".join(map(self._answer, (stop[1], text[stop.end() :]) if stop else (text,)))
        return answers.encode("ascii")

    def _answer(self, text: str) -> str:
        if not text:
            return END
        echo = f"{text}\r" if self._forms.echoes else ""
        try:
            answer = self._carried_out(text)
        except Refused:
            return f"{echo}{REFUSAL}{END}"
        if answer is None:
            return echo
        return f"{echo}{answer}{END}"

    def _carried_out(self, text: str) -> str | None:
        """Return the value of an answer, empty where it has none; None for no answer at all."""
        match = COMMAND.fullmatch(text)
        if match is None:
            raise Refused
        act = self._acts.get(self._mnemonic(match))
        prefix, number = match[1], match[5]
        if act is None or (prefix and (len(self.axes) == 1 or int(prefix) not in self.axes)):
            raise Refused
        n = int(prefix or 1)
        answer = act(self.axes[n], number)
        silent = self._forms.silent_motion and match[2] in ("JOG", "SGO")
        return None if silent else answer

    def _mnemonic(self, match: re.Match[str]) -> str:
        return f"{match[2] or match[4]}{match[3] or ''}"

    def _commands(self) -> dict[str, Callable[[Axis, str | None], str]]:
        forms, largest = self._forms, self._largest
        act, asked, value = acts, asks, values
        table: dict[str, Callable[[Axis, str | None], str]] = {
            "HOM": act(Axis.search_zero),
            "STO": act(Axis.stop),
            "SAV": act(lambda axis: None),
            "SGO": act(lambda axis: None),
            "PZR": act(self._set_zero_here),
            "JOG": value(self._jog),
            "MOV": value(lambda axis, deg: axis.move_to(deg, forms.wraps)),
            "P": value(lambda axis, deg: axis.move_to(deg, forms.wraps)),
            "RMO": value(Axis.move_by),
            "ZER": value(self._set_zero),
            "SRV": value(self._motor),
            "ACL": value(self._setter("acceleration", largest.largest_acceleration, 1.0)),
            "VEL": value(self._setter("velocity", largest.largest_rate, forms.per_s)),
            "PPO": asked(self._position),
            "PVE": asked(lambda axis: f"{forms.per_s * axis.rate_deg_per_s():.6f}"),
            "STA": asked(self._status),
            "MCO": lambda axis, tolerance: str(int(axis.complete == forms.complete)),
        }
        for name in KEPT:
            table[name] = value(partial(self._keep, name))
        if forms.asked:
            table["SRV?"] = asked(lambda axis: str(int(axis.motor_on)))
            table["ACL?"] = asked(lambda axis: f"{axis.acceleration:.4f}")
            table["VEL?"] = asked(lambda axis: f"{forms.per_s * axis.velocity:.4f}")
            for name in KEPT:
                table[f"{name}?"] = asked(partial(self._told, name))
        return {name: does for name, does in table.items() if name[:3] not in forms.unknown}

    def _jog(self, axis: Axis, rate: float) -> None:
        if self._forms.whole_rates and rate != int(rate):
            raise Refused
        axis.turn_at(rate / self._forms.per_s)

    def _motor(self, axis: Axis, on: float) -> None:
        if on not in (0.0, 1.0):
            raise Refused
        (axis.switch_on if on else axis.switch_off)()

    def _setter(self, name: str, most: float, per_s: float) -> Callable[[Axis, float], None]:
        def take(axis: Axis, given: float) -> None:
            if not 0 < given / per_s <= most:
                raise Refused
            setattr(axis, name, given / per_s)

        return take

    def _position(self, axis: Axis) -> str:
        reading_deg = axis.reading_deg()
        wraps = self._forms.wraps and axis.encoder.continuous
        return f"{reading_deg % 360.0 if wraps else reading_deg:.6f}"

    def _status(self, axis: Axis) -> str:
        flags = (axis.motor_on, axis.turns(), axis.complete, axis.pressed)
        bits = (MOTOR_ON, MOVING, COMPLETE, PRESSED)
        return str(sum(bit for bit, flag in zip(bits, flags, strict=True) if flag))

    def _set_zero_here(self, axis: Axis) -> None:
        self._set_zero(axis, 0.0)

    def _set_zero(self, axis: Axis, reading_deg: float) -> None:
        if not axis.complete:
            raise Refused
        axis.count_from(reading_deg)

    def _keep(self, name: str, axis: Axis, number: float) -> None:
        self._kept[name, id(axis)] = number

    def _told(self, name: str, axis: Axis) -> str:
        return f"{self._kept.get((name, id(axis)), 0.0):g}"

    def _emergency(self, time_s: float, fault: LastingFault | None) -> None:
        for axis in self.axes.values():
            axis.catch_up()
            axis.emergency(time_s, fault is not None)

    def describe(self) -> dict[str, Any]:
        """Return what `station sim` prints about this instrument."""
        return {**super().describe(), "axes": len(self.axes)}


class IdealAerosmithStage(IdealAerosmithTable):
    """A table whose one axis is the rotary stage of the world, or an axis of its own."""

    model = "Ideal Aerosmith rate table as a stage"

    def _rotation(self, setting: Setting, n: int) -> RotationHistory | None:
        return setting.world.find(RotationHistory)


def acts(act: Callable[[Axis], None]) -> Callable[[Axis, str | None], str]:
    """Return a command without a number."""

    def command(axis: Axis, number: str | None) -> str:
        if number is not None:
            raise Refused
        act(axis)
        return ""

    return command


def asks(answer: Callable[[Axis], str]) -> Callable[[Axis, str | None], str]:
    """Return a question, which has no number."""

    def question(axis: Axis, number: str | None) -> str:
        if number is not None:
            raise Refused
        return answer(axis)

    return question


def values(take: Callable[[Axis, float], None]) -> Callable[[Axis, str | None], str]:
    """Return a command with a number."""

    def command(axis: Axis, number: str | None) -> str:
        if number is None:
            raise Refused
        take(axis, float(number))
        return ""

    return command
