"""Newport ESP301 motion controller with one rotary stage on axis 1, in lines of text.

From public clients of the ESP300 family and what they quote of its manual: `xxAAnn` with `;`
between commands, at most 80 characters a line, CR at its end, CR LF at the end of an answer, error
codes, ten errors kept in the order they came, reported only when asked. Commands do not wait; WS
and WT hold the rest of the line and what comes after it. ST refuses no axis that exists.

The names of the commands are those of the ESP300 manual's list of commands (section 3).

What no source at hand says, and is assumed: what comes when ten errors are kept is lost; a target
beyond a software limit is refused with x06 or x07 and nothing moves; a changed velocity or
acceleration holds from the next movement on; the maximum velocity can be lowered by VU, and VA
follows it; a line that is too long is refused whole with 7; WT is taken with an axis and without;
what a URS100BPP holds in its settings, and what PH answers while nothing is wrong; an emergency
stop, AB as well, brakes with AE, and with AG where that is more; where the other settings may lie:
gains 0 to 2E9 and KS 0 to 1, TJ 1 to 6, QM 0 to 4, FP 0 to 7, VB to VA, JH to VU, JW to JH, QI to
3 A, QV to 60 V.

Set up, and changing no movement here: `ZB` feedback and `ZH` limit switches in hexadecimal digits,
of which the answer ends with H, `SU` resolution of the encoder, `FR` of a full step, `QS` 1 to 250
microsteps, `PH` state of the inputs, `SM` save, `LC` keys of the panel, `JK` jerk, `VB` base
velocity, `JH` and `JW` jog velocities, `FE` following-error threshold, `QM` motor type, `QI` and
`QV` its current and voltage, `KP` `KI` `KD` `KS` `AF` `VF` gains, which UF brings into use, `TJ`
trajectory mode, `FP` digits shown. Left out: WP, groups, stored programs, units other than degrees.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from math import inf
from typing import ClassVar

from sim_instruments.faults.lasting import EmergencyStop, EncoderJump, FollowingError, Stuck
from sim_instruments.instrument import Setting
from sim_instruments.newport.esp301_axis import AXIS, Axis, EspError, text_of
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
OUT_OF_RANGE = 100 * AXIS + 1
LARGEST_WORD = 0xFFFF
LARGEST = 2e9
STEPPER, S_CURVE = 2, 2
Act = Callable[[str], str | None]
Row = tuple[Act, Callable[[], str] | None]
"""What a command does with its parameter, and what is answered where that is `?`."""


class NewportEsp301(LineInstrument):
    """The controller, whose stage turns `rotation` of the world, or an axis of its own.

    Truth (`simulator` mapping): see `sim_instruments.newport.esp301_axis.Axis`.
    """

    model = "Newport ESP301"
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
        # Of stage and front panel, which changes no movement here.
        self._feedback, self._switches = 0x300, 0x24
        self._microsteps, self._step_deg = 100, self._axis.step_deg
        self._full_step_deg = self._step_deg * self._microsteps
        self._jerk = 2.0 * self._axis.stage_acceleration
        self._jog_fast, self._jog_slow = self._axis.stage_rate / 4, self._axis.stage_rate / 40
        self._base_rate, self._threshold_deg = 0.0, 1.0
        self._motor, self._motor_A, self._motor_V = STEPPER, 1.0, 30.0
        self._gains = {"KP": 0.0, "KI": 0.0, "KD": 0.0, "KS": 0.0, "AF": 0.0, "VF": 0.0}
        self._trajectory, self._digits = S_CURVE, 4
        self._general, self._of_axis = expanded(self._of_controller()), expanded(self._of_an_axis())
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

    def _of_controller(self) -> dict[str, Row]:
        """Return the commands without an axis."""
        return {
            "VE": asked(lambda: VERSION),
            "TE": asked(lambda: self._next_error()[0]),
            "TB": asked(lambda: ", ".join(self._next_error())),
            "ST": (done(self._axis.stop), None),
            "AB": (done(self._axis.abort), None),
            "WT": (self._wait, None),
            "PH": (lambda _: "0H, 0H", None),
            **dict.fromkeys(("SM", "LC"), (lambda _: None, None)),
        }

    def _of_an_axis(self) -> dict[str, Row]:
        """Return the commands of the axis."""
        axis = self._axis
        return {
            "ID": asked(lambda: f"{STAGE}, SN{self._serial}"),
            "TP": asked(lambda: decimal(axis.position_deg())),
            "TV": asked(lambda: decimal(axis.velocity_deg_per_s())),
            "DP": asked(lambda: decimal(axis.desired_deg())),
            "MD": asked(lambda: str(int(axis.is_done()))),
            "MO": (done(axis.switch_on), lambda: str(int(axis.motor_on))),
            "MF": (done(axis.switch_off), lambda: str(int(axis.motor_on))),
            "PA": (lambda text: axis.move_to(number(text)), None),
            "PR": (lambda text: axis.move_by(number(text)), None),
            "WS": (lambda text: self._waiting.for_stop(milliseconds(text or "0")), None),
            "WT": (self._wait, None),
            "ST": (done(axis.stop), None),
            "OR": (self._search_home, None),
            "DH": (
                lambda text: axis.define_home(number(text or "0")),
                lambda: decimal(axis.defined_home_deg),
            ),
            "SN": (self._set_unit, lambda: str(DEGREES)),
            "VA": held(axis, "rate", self._rate),
            "VU": held(axis, "largest_rate", self._largest_rate),
            "AC": (self._set_acceleration, lambda: decimal(axis.acceleration)),
            "AG": held(axis, "deceleration", self._acceleration),
            "AU": held(axis, "largest_acceleration", self._largest_acceleration),
            "SL": held(axis, "low_deg", lambda text: allowed(number(text), -inf, axis.high_deg)),
            "SR": held(axis, "high_deg", lambda text: allowed(number(text), axis.low_deg, inf)),
            "OH": held(axis, "home_rate", self._rate),
            "OL": held(axis, "home_slow_rate", self._rate),
            "SH": held(axis, "home_deg", number),
            "ZB": held(self, "_feedback", word, "{:X}H"),
            "ZH": held(self, "_switches", word, "{:X}H"),
            "SU": held(self, "_step_deg", resolution, "{:.9f}"),
            "FR": held(self, "_full_step_deg", resolution, "{:.9f}"),
            "QS": held(self, "_microsteps", lambda text: whole(text, 1, 250), "{}"),
            "AE": held(axis, "emergency_deceleration", lambda text: within(text, 0.0, LARGEST)),
            "JK": held(self, "_jerk", lambda text: within(text, 0.0, LARGEST)),
            "JH": held(self, "_jog_fast", self._rate),
            "JW": held(self, "_jog_slow", lambda text: within(text, 0.0, self._jog_fast)),
            "VB": held(self, "_base_rate", lambda text: within(text, 0.0, axis.rate)),
            "FE": held(self, "_threshold_deg", lambda text: within(text, 0.0, LARGEST)),
            "QM": held(self, "_motor", lambda text: whole(text, 0, 4), "{}"),
            "QI": held(self, "_motor_A", lambda text: within(text, 0.0, 3.0)),
            "QV": held(self, "_motor_V", lambda text: within(text, 0.0, 60.0)),
            "TJ": held(self, "_trajectory", lambda text: whole(text, 1, 6), "{}"),
            "FP": held(self, "_digits", lambda text: whole(text, 0, 7), "{}"),
            "UF": (lambda _: None, None),
            **{name: self._gain(name) for name in self._gains},
        }

    def _gain(self, name: str) -> Row:
        """Return a gain of the servo loop, which a stepper does without."""
        largest = 1.0 if name == "KS" else LARGEST

        def put(text: str) -> None:
            self._gains[name] = within(text, 0.0, largest)

        return put, lambda: decimal(self._gains[name])

    def _wait(self, text: str) -> None:
        self._waiting.for_time(self._clock.now(), milliseconds(text))

    def _next_error(self) -> tuple[str, str, str]:
        code, tick = self._axis.errors.pop(self._clock.now())
        return str(code), str(tick), text_of(code)

    def _search_home(self, parameter: str) -> None:
        mode = number(parameter or "2")
        if mode not in range(7):
            raise EspError(OUT_OF_RANGE)
        if mode == 0:
            self._axis.move_to(0.0)
        else:
            self._axis.search_home()

    def _set_unit(self, parameter: str) -> None:
        if number(parameter) != DEGREES:
            raise EspError(OUT_OF_RANGE)

    def _rate(self, text: str) -> float:
        """Return a rate that the axis may have."""
        return no_more(positive(text), self._axis.largest_rate, 100 * AXIS + 10)

    def _acceleration(self, text: str) -> float:
        """Return an acceleration that the axis may have."""
        return no_more(positive(text), self._axis.largest_acceleration, 100 * AXIS + 11)

    def _set_acceleration(self, text: str) -> None:
        self._axis.acceleration = self._axis.deceleration = self._acceleration(text)

    def _largest_rate(self, text: str) -> float:
        axis = self._axis
        value = self._not_protected(positive(text), axis.stage_rate)
        axis.rate = min(axis.rate, value)
        return value

    def _largest_acceleration(self, text: str) -> float:
        axis = self._axis
        value = self._not_protected(positive(text), axis.stage_acceleration)
        axis.acceleration = min(axis.acceleration, value)
        axis.deceleration = min(axis.deceleration, value)
        return value

    def _not_protected(self, value: float, largest: float) -> float:
        if self._axis.protected:
            raise EspError(100 * AXIS + 17)
        return no_more(value, largest, OUT_OF_RANGE)


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


def expanded(rows: dict[str, Row]) -> dict[str, Act]:
    """Return what each command does, and each query of its name with a question mark."""
    queries = {f"{name}?": done(give) for name, (_, give) in rows.items() if give is not None}
    return {name: act for name, (act, _) in rows.items()} | queries


def asked(give: Callable[[], str]) -> Row:
    """Return a query that is the same with a question mark and without."""
    return done(give), give


def done(act: Callable[[], str | None]) -> Act:
    """Return a command that takes no parameter."""
    return lambda _: act()


def held(owner: object, name: str, read: Callable[[str], float], form: str = "{:.6f}") -> Row:
    """Return a setting that is an attribute of its owner."""
    return (
        lambda text: setattr(owner, name, read(text)),
        lambda: form.format(getattr(owner, name)),
    )


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
        raise EspError(OUT_OF_RANGE)
    return value / 1000


def positive(text: str) -> float:
    """Return a parameter above zero; EspError x01 otherwise."""
    return allowed(number(text), 0.0, inf)


def allowed(value: float, above: float, below: float) -> float:
    """Return a value between two others; EspError x01 otherwise."""
    if not above < value < below:
        raise EspError(OUT_OF_RANGE)
    return value


def no_more(value: float, largest: float, code: int) -> float:
    """Return a value; EspError with a code where it is above the largest."""
    if value > largest * (1 + 1e-9):
        raise EspError(code)
    return value


def within(text: str, low: float, high: float) -> float:
    """Return a parameter between two values, or at one of them; EspError x01 otherwise."""
    value = number(text)
    if not low <= value <= high:
        raise EspError(OUT_OF_RANGE)
    return value


def whole(text: str, low: int, high: int) -> int:
    """Return a whole parameter from a range; EspError x01 otherwise."""
    value = number(text)
    if value not in range(low, high + 1):
        raise EspError(OUT_OF_RANGE)
    return int(value)


def resolution(text: str) -> float:
    """Return a resolution."""
    return within(text, 2e-9, 2e9)


def word(text: str) -> int:
    """Return a word of 16 bits from hexadecimal digits; EspError 38, 7 or x01 otherwise."""
    if not text:
        raise EspError(38)
    try:
        value = int(text.removesuffix("H"), 16)
    except ValueError:
        raise EspError(7) from None
    if not 0 <= value <= LARGEST_WORD:
        raise EspError(OUT_OF_RANGE)
    return value


def decimal(value: float) -> str:
    """Return a number as the controller writes it."""
    return f"{value:.6f}"
