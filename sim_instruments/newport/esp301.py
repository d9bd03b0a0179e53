"""Newport ESP301 motion controller with one rotary stage on axis 1, in lines of text.

From public clients of the ESP300 family and what they quote of its manual: `xxAAnn` with `;`
between commands, at most 80 characters a line, CR at its end, CR LF at the end of an answer, error
codes, ten errors kept in the order they came, reported only when asked. Commands do not wait; WS
and WT hold the rest of the line and what comes after it. ST refuses no axis that exists.

What no source at hand says, and is assumed: what comes when ten errors are kept is lost; a target
beyond a software limit is refused with x06 or x07 and nothing moves; a changed velocity or
acceleration holds from the next movement on; the maximum velocity can be lowered by VU, and VA
follows it; a line that is too long is refused whole with 7; WT is taken with an axis and without.
Left out: WP, groups, stored programs, units other than degrees.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from typing import ClassVar

from sim_instruments.faults.lasting import EmergencyStop, EncoderJump, FollowingError, Stuck
from sim_instruments.instrument import Setting
from sim_instruments.newport.esp301_axis import AXIS, Axis, EspError, text_of
from sim_instruments.newport.esp301_set_up import SetUp
from sim_instruments.newport.esp301_waiting import Waiting
from sim_instruments.wire.held_lines import HeldLineServer
from sim_instruments.wire.requests import LineInstrument, LineServer
from sim_instruments.world.rotation import RotationHistory

VERSION = "ESP301 Version 3.0.1 6/1/99"
STAGE = "URS100BPP"
MAX_LINE = 80
AXES = 3
DEGREES = 7
COMMAND = re.compile(r"(\d*)\s*([A-Z]{2})\s*(.*)", re.DOTALL)
WAITS = re.compile(rb"\s*\d*\s*W[ST].*", re.IGNORECASE | re.DOTALL)
HELD = {
    "VA": "rate",
    "VU": "largest_rate",
    "AC": "acceleration",
    "AG": "deceleration",
    "AU": "largest_acceleration",
    "SL": "low_deg",
    "SR": "high_deg",
    "OH": "home_rate",
    "OL": "home_slow_rate",
    "SH": "home_deg",
}
"""What each query of a setting shows of the axis."""
Act = Callable[[str], str | None]


class NewportEsp301(LineInstrument):
    """The controller, whose stage turns `rotation` of the world, or an axis of its own.

    Truth (`simulator` mapping): see `sim_instruments.newport.esp301_axis.Axis`.
    """

    model = "Newport ESP301"
    protocol = "ascii"
    resource = "socket://{host}:{port}"
    line_end = b"\r"

    lasting_faults: ClassVar = (
        FollowingError.kind,
        EncoderJump.kind,
        Stuck.kind,
        EmergencyStop.kind,
    )

    def __init__(self, setting: Setting) -> None:
        self._clock, self._serial = setting.clock, setting.serial
        # In some worlds nothing is mounted on it.
        rotation = setting.world.find(RotationHistory) or RotationHistory()
        self._axis = Axis(setting.truth, rotation, setting.faults, setting.rng, setting.clock.now)
        self._waiting = Waiting(self._axis)
        self._set_up = SetUp(self._axis.step_deg, number)
        self._general = self._general_commands()
        self._of_axis = self._axis_commands()
        self.begin_to_serve(setting)

    def energised(self) -> bool:
        """Return whether the stage turns."""
        return self._axis.turns()

    def knows(self, command: str) -> bool:
        """Whether the controller, or an axis, has a command."""
        return command in self._general or command in self._of_axis

    def _server_kind(self) -> Callable[..., LineServer]:
        return partial(HeldLineServer, parts=parts, held_s=self._held_s)

    def _held_s(self) -> float:
        return self._waiting.left_s(self._clock.now())

    def _line(self, line: bytes) -> bytes:
        text = line.decode("ascii", "replace").strip()
        self._axis.catch_up()
        if len(text) > MAX_LINE:
            self._refuse(EspError(7))
            return b""
        answers = []
        for command in text.split(";"):
            if not command.strip():
                continue
            try:
                answer = self._carry_out(command.strip().upper())
            except EspError as error:
                self._refuse(error)
                continue
            if answer is not None:
                answers.append(f"{answer}\r\n")
        return "".join(answers).encode("ascii")

    def _refuse(self, error: EspError) -> None:
        self._axis.errors.push(error.code, self._clock.now())

    def _carry_out(self, command: str) -> str | None:
        match = COMMAND.fullmatch(command)
        if match is None:
            raise EspError(6)
        axis, name, parameter = match.groups()
        asks = parameter == "?"
        key = f"{name}?" if asks else name
        if key in self._general and not axis:
            return self._general[key](parameter)
        if key not in self._of_axis:
            raise EspError(6)
        if not axis:
            raise EspError(37)
        if not 1 <= int(axis) <= AXES:
            raise EspError(9)
        if int(axis) != AXIS:
            if name == "ST":
                return None
            raise EspError(100 * int(axis) + 8)
        return self._of_axis[key](parameter)

    def _general_commands(self) -> dict[str, Act]:
        return {
            **asked({"VE": lambda _: VERSION, "TE": self._take_code, "TB": self._take_text}),
            "ST": done(self._axis.stop),
            "AB": done(self._axis.switch_off),
            "WT": self._wait,
            **self._set_up.of_controller(),
        }

    def _axis_commands(self) -> dict[str, Act]:
        axis = self._axis
        return {
            **asked(
                {
                    "ID": lambda _: f"{STAGE}, SN{self._serial}",
                    "TP": lambda _: decimal(axis.position_deg()),
                    "TV": lambda _: decimal(axis.velocity_deg_per_s()),
                    "DP": lambda _: decimal(axis.desired_deg()),
                    "MD": lambda _: str(int(axis.is_done())),
                }
            ),
            **{f"{name}?": partial(self._shown, held) for name, held in HELD.items()},
            "MO": done(axis.switch_on),
            "MF": done(axis.switch_off),
            "MO?": lambda _: str(int(axis.motor_on)),
            "MF?": lambda _: str(int(axis.motor_on)),
            "PA": lambda text: axis.move_to(number(text)),
            "PR": lambda text: axis.move_by(number(text)),
            "WS": lambda text: self._waiting.for_stop(milliseconds(text or "0")),
            "WT": self._wait,
            "ST": done(axis.stop),
            "OR": self._search_home,
            "DH": lambda text: axis.define_home(number(text or "0")),
            "SN": self._set_unit,
            "SN?": lambda _: str(DEGREES),
            "VA": lambda text: setattr(axis, "rate", self._rate(text)),
            "VU": self._set_largest_rate,
            "AC": self._set_acceleration,
            "AG": lambda text: setattr(axis, "deceleration", self._acceleration(text)),
            "AU": self._set_largest_acceleration,
            "SL": self._set_low,
            "SR": self._set_high,
            "OH": lambda text: setattr(axis, "home_rate", self._rate(text)),
            "OL": lambda text: setattr(axis, "home_slow_rate", self._rate(text)),
            "SH": lambda text: setattr(axis, "home_deg", number(text)),
            **self._set_up.of_axis(),
        }

    def _wait(self, text: str) -> None:
        self._waiting.for_time(self._clock.now(), milliseconds(text))

    def _shown(self, held: str, parameter: str) -> str:
        return decimal(getattr(self._axis, held))

    def _take_code(self, parameter: str) -> str:
        code, _ = self._axis.errors.pop(self._clock.now())
        return str(code)

    def _take_text(self, parameter: str) -> str:
        code, tick = self._axis.errors.pop(self._clock.now())
        return f"{code}, {tick}, {text_of(code)}"

    def _search_home(self, parameter: str) -> None:
        mode = number(parameter or "2")
        if mode not in range(7):
            raise EspError(100 * AXIS + 1)
        if mode == 0:
            self._axis.move_to(0.0)
        else:
            self._axis.search_home()

    def _set_unit(self, parameter: str) -> None:
        if number(parameter) != DEGREES:
            raise EspError(100 * AXIS + 1)

    def _rate(self, text: str) -> float:
        """Return a rate that the axis may have."""
        value = positive(text)
        if value > self._axis.largest_rate * (1 + 1e-9):
            raise EspError(100 * AXIS + 10)
        return value

    def _acceleration(self, text: str) -> float:
        """Return an acceleration that the axis may have."""
        value = positive(text)
        if value > self._axis.largest_acceleration * (1 + 1e-9):
            raise EspError(100 * AXIS + 11)
        return value

    def _set_largest_rate(self, text: str) -> None:
        axis, value = self._axis, positive(text)
        self._not_protected(value, axis.stage_rate)
        axis.largest_rate = value
        axis.rate = min(axis.rate, value)

    def _set_acceleration(self, text: str) -> None:
        self._axis.acceleration = self._axis.deceleration = self._acceleration(text)

    def _set_largest_acceleration(self, text: str) -> None:
        axis, value = self._axis, positive(text)
        self._not_protected(value, axis.stage_acceleration)
        axis.largest_acceleration = value
        axis.acceleration = min(axis.acceleration, value)
        axis.deceleration = min(axis.deceleration, value)

    def _not_protected(self, value: float, largest: float) -> None:
        if self._axis.protected:
            raise EspError(100 * AXIS + 17)
        if value > largest * (1 + 1e-9):
            raise EspError(100 * AXIS + 1)

    def _set_low(self, text: str) -> None:
        value = number(text)
        if value >= self._axis.high_deg:
            raise EspError(100 * AXIS + 1)
        self._axis.low_deg = value

    def _set_high(self, text: str) -> None:
        value = number(text)
        if value <= self._axis.low_deg:
            raise EspError(100 * AXIS + 1)
        self._axis.high_deg = value


def parts(line: bytes) -> list[bytes]:
    """Return a line cut behind each command that may hold the rest of it."""
    if len(line.strip()) > MAX_LINE:
        return [line]
    cut: list[list[bytes]] = [[]]
    for command in line.split(b";"):
        cut[-1].append(command)
        if WAITS.fullmatch(command):
            cut.append([])
    return [b";".join(commands) for commands in cut if commands]


def asked(queries: dict[str, Act]) -> dict[str, Act]:
    """Return queries that are the same with a question mark and without."""
    return {**queries, **{f"{name}?": act for name, act in queries.items()}}


def done(act: Callable[[], None]) -> Act:
    """Return a command that takes no parameter and answers nothing."""

    def command(parameter: str) -> None:
        act()

    return command


def number(text: str) -> float:
    """Return a parameter; EspError 38 without one, 7 when it is no number."""
    if not text:
        raise EspError(38)
    try:
        value = float(text)
    except ValueError:
        raise EspError(7) from None
    if not math.isfinite(value):
        raise EspError(7)
    return value


def milliseconds(text: str) -> float:
    """Return a time in s of a parameter in ms; EspError x01 below zero."""
    value = number(text)
    if value < 0:
        raise EspError(100 * AXIS + 1)
    return value / 1000


def positive(text: str) -> float:
    """Return a parameter above zero; EspError x01 otherwise."""
    value = number(text)
    if value <= 0:
        raise EspError(100 * AXIS + 1)
    return value


def decimal(value: float) -> str:
    """Return a number as the controller writes it."""
    return f"{value:.6f}"
