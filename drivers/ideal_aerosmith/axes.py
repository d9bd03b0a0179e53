"""The axes of an Ideal Aerosmith table: told by motions, and judged by their encoders alone."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from drivers.generic.axes_table import MARGIN_S, AxesTable
from drivers.generic.table_axis import MAX_AXES, MOVES, TURN_DEG, AxesSettings, AxisState, Doing
from drivers.ideal_aerosmith.line import NOBODY_ELSE, POSITION, AtlLine, RefusedByTable, number
from station.errors import InstrumentError
from station.fields import Degree
from station.roles import Place

RATE = "PVE"
MOTOR = "SRV?"
SETTLES_S = 0.5
"""An axis has settled when it stood, or had its rate, for so long; nothing else tells of it."""

HOME_SETTLES_S = 1.0
AGREES = 1e-3
"""By how much a setting may differ from what reads back, in itself: nobody says how it is printed.
"""

ENCODER_AGREES = 0.2
"""By how much rate and encoder of an axis that has its rate may differ, in the rate."""

STEADY, HIGH = 0.01, 0.5
"""By how much a rate may change on the way to an angle while it is held against the encoder, and in
the bench's limit, how high it is then."""

WORD = re.compile("[!-:<=@-~]*")
PREFIXES = {1: ("",), 2: ("1", "2"), 3: ("1", "2", "3")}
MOVED = (Doing.STOPPING, Doing.POSITIONING, Doing.TURNING)
HOME_AGAIN = "then home the axis again"


def is_word(word: str) -> str:
    """Refuse what would be taken for a prompt, for a refusal, or for the end of a command."""
    if not WORD.fullmatch(word):
        raise ValueError(
            f"{word!r} cannot name an axis; write letters, digits or signs, without blank, `>`, "
            "`?` and `;`"
        )
    return word


Prefix = Annotated[str, Field(max_length=4), AfterValidator(is_word)]


class AtlSettings(AxesSettings):
    """What the bench file says of a table, of its axes, and of its controller's line."""

    axes: int = Field(1, ge=1, le=MAX_AXES, description="how many axes it has")
    prefixes: tuple[Prefix, ...] | None = Field(
        None,
        description="the word before a command that names each axis; `1`, `2`, `3` unless given, "
        "nothing where there is one axis",
    )
    rates_by: Literal["second", "minute"] = Field(
        "second", description="whether the controller's rates are in deg/s or in deg/min"
    )
    moves_by: Literal["RMO", "MOV", "P"] = Field(
        "RMO", description="the command that moves: `RMO` by an angle, `MOV` or `P` to an angle"
    )
    longest_move_deg: Degree | None = Field(
        None, ge=1, description="the longest way of one command; a longer one goes in steps"
    )
    zero: Literal["absolute", "search"] = Field(
        "search", description="`search` where each encoder has to find its zero"
    )

    @field_validator("prefixes")
    @classmethod
    def one_for_each(
        cls, given: tuple[str, ...] | None, info: ValidationInfo
    ) -> tuple[str, ...] | None:
        """Refuse prefixes that do not tell the axes apart."""
        axes = info.data.get("axes", len(given or ()))
        if given is not None and (len(given) != axes or len(set(given)) != axes):
            raise ValueError(f"give each of the {axes} axes a prefix of its own")
        return given

    @property
    def words(self) -> tuple[str, ...]:
        """The words before a command, axis by axis."""
        return self.prefixes if self.prefixes is not None else PREFIXES[self.axes]

    @property
    def per_s(self) -> float:
        """By what a rate in deg/s is multiplied for the controller."""
        return 60.0 if self.rates_by == "minute" else 1.0


class AtlTable(AxesTable):
    """All axes. No demand can be read back, and no state is documented: encoders tell all."""

    settings: AtlSettings
    when_commanded_by_another = (
        "compare settings.prefixes and settings.rates_by with the table's manual, and see that "
        f"nobody works at its panel; {NOBODY_ELSE}"
    )

    def __init__(
        self,
        place: Place,
        settings: AtlSettings,
        line: AtlLine,
        limit: Callable[[str], float],
        met: Callable[[str], None],
    ) -> None:
        super().__init__(place, settings, limit)
        self._line, self._met = line, met
        self._reading_deg = dict.fromkeys(self.axes, math.nan)
        self._asked_s = dict.fromkeys(self.axes, -math.inf)
        """When the last angle was asked for: it is no older, whenever its answer was taken up."""
        self._stood_since_s = dict.fromkeys(self.axes, math.inf)
        self._rate_from: dict[int, tuple[float, float, float, float]] = {}
        """Since when an axis has its rate: the times in s before and after the look, angle in deg,
        and the rate in deg/s."""
        self.tells_motor = True
        self.held: set[int] = set()
        """The axes whose motor was switched on here: one that is off now was switched off."""

    # Looks.

    def look(self) -> None:
        """Read angle and rate of every axis, one after the other, and count its turns."""
        with self._looking:
            for n, state in self.axes.items():
                asked_s = self._place.clock.now()
                reading_deg = self._line.value(n, POSITION)
                state.count.take(reading_deg, self._place.clock.now())
                self._reading_deg[n], self._asked_s[n] = reading_deg, asked_s
                self._read_rate(state)
        self._say_angle()
        self._say_rate()

    def look_at_rates(self) -> None:
        """Read the rate of every axis; other looks count the turns."""
        with self._looking:
            for state in self.axes.values():
                self._read_rate(state)
        self._say_rate()

    def look_at(self, state: AxisState) -> None:
        """Read all axes; raises InstrumentError for a fault of the one, or a stranger's motion."""
        self.look()
        concerned = state.homed or state.doing in MOVES
        if concerned and self.motor_on(state.number) is False:
            raise self._motor_off(state, f"looked at axis {state.number}")
        self._need_inside(state)
        self._need_own_motion(state)

    def motor_on(self, n: int) -> bool | None:
        """Whether the motor of an axis is on; None where the firmware does not tell."""
        if not self.tells_motor:
            return None
        value = self._line.value_if_known(n, MOTOR)
        if value is None:
            self.tells_motor = False
            self._met("does not tell whether a motor is on")
            return None
        return bool(value)

    # Commands.

    def switch_motor_on(self, state: AxisState, within_s: float) -> None:
        """Switch a motor on, where the firmware has a command for it."""
        self.held.discard(state.number)
        tells = self.motor_on(state.number) is not None
        try:
            self._line.command(state.number, "SRV1")
        except RefusedByTable as error:
            if tells:
                attempted = f"switch the motor of axis {state.number} on"
                raise self._motor_off(state, attempted, error) from error
            self._met("has no command that switches a motor on")
        state.begins(Doing.CLOSING, self._place.clock.now() + within_s)
        self._begins_to_settle(state.number)

    def set_rate(self, state: AxisState, rate: float, doing: Doing) -> None:
        """Turn at a rate, or brake for none; what becomes of it the encoder tells."""
        n, measured = state.number, None
        if state.mode != "Rate":
            self.look()
            measured = state.rate
        began_s = self._place.clock.now()
        self._begin(state, f"JOG{number(rate * self.settings.per_s)}" if rate else "STO")
        state.mode, state.rate_demand, state.target_deg = "Rate", rate, None
        acceleration = self._limit("acceleration")
        before = state.count.planned_rate(began_s) if measured is None else measured
        state.count.turns_at(began_s, rate, acceleration, measured)
        state.begins(doing, began_s + 2 * abs(rate - before) / acceleration + MARGIN_S)
        self._begins_to_settle(n)
        self.say_motion()

    def step(self, state: AxisState) -> None:
        """Move by what is missing to the target, or by the longest way of one command."""
        assert state.target_deg is not None
        n, here_deg = state.number, state.count.angle_deg
        longest_deg = self.settings.longest_move_deg or math.inf
        by_deg = max(-longest_deg, min(state.target_deg - here_deg, longest_deg))
        whole = abs(by_deg) < longest_deg
        state.step_deg = state.target_deg if whole else here_deg + by_deg
        to_deg = by_deg if self.settings.moves_by == "RMO" else self._reading_deg[n] + by_deg
        began_s, rate = self._place.clock.now(), self._limit("rate")
        acceleration = self._limit("acceleration")
        self._begin(state, f"{self.settings.moves_by}{number(to_deg)}")
        state.mode = "Position"
        state.count.goes_by(began_s, by_deg, rate, acceleration)
        takes_s = abs(by_deg) / rate + 2 * rate / acceleration
        state.begins(Doing.POSITIONING, began_s + 2 * takes_s + MARGIN_S)
        self._begins_to_settle(n)
        self.say_motion()

    def stops_first(self, state: AxisState) -> bool:
        """Whether an axis moves: what is missing to an angle is known of one that stands alone."""
        return state.doing is Doing.POSITIONING or self.is_turning(state)

    def brake(self, state: AxisState) -> None:
        """Have an axis come to rest; a table that refuses has nothing that it could stop."""
        with suppress(RefusedByTable):  # what reads back decides whether it stands
            self._line.command(state.number, "STO")

    # Judgements.

    def has_done(self, state: AxisState, status: None) -> bool:
        """Whether an axis has done what was commanded; begins what comes next where it has not."""
        n, settings = state.number, self.settings
        if state.doing is Doing.CLOSING:
            motor_on = self.motor_on(n)
            if motor_on is None:  # it may take a moment, of which nothing tells
                motor_on = self._has_settled(n, True, HOME_SETTLES_S)
            if not motor_on:
                return False
            self.held.add(n)
            if settings.zero == "absolute":
                return self._knows_zero(state)
            self._search_zero(state)
            within_s = self._place.clock.patience_s(settings.home_within_s)
            state.begins(Doing.SEARCHING, self._place.clock.now() + within_s)
            self._begins_to_settle(n)
            return False
        if state.doing is Doing.SEARCHING:
            near_deg = abs(math.remainder(self._reading_deg[n], TURN_DEG))
            there = near_deg <= settings.in_position_deg and not self.is_turning(state)
            return self._has_settled(n, there, HOME_SETTLES_S) and self._knows_zero(state)
        if state.doing is Doing.POSITIONING:
            self._need_steady_rate_of_encoder(state)
        self.need_turns(state)
        planned = state.count.planned_rate(self._place.clock.now())
        rests = not self.is_turning(state) and not planned
        if state.doing is Doing.STOPPING:
            if self._has_settled(n, rests) and state.target_deg is not None:
                self.step(state)
                return False
            return self._has_settled(n, rests)
        assert state.target_deg is not None
        there = abs(state.count.angle_deg - state.step_deg) <= settings.in_position_deg
        if not self._has_settled(n, rests and there):
            return False
        if state.step_deg != state.target_deg:
            self.step(state)
            return False
        return True

    def has_rate(self, state: AxisState, status: None) -> bool:
        """Whether an axis has reached the commanded rate, now or before, by its encoder, too."""
        n, now_s = state.number, self._place.clock.now()
        ramped = math.isclose(state.count.planned_rate(now_s), state.rate_demand, abs_tol=1e-9)
        agrees = ramped and self.agrees(state)
        settled = self._has_settled(n, agrees)
        if agrees and n not in self._rate_from:
            self._rate_from[n] = self._asked_s[n], now_s, state.count.angle_deg, state.rate
        if settled and not state.at_rate and self._passed_s(n) >= SETTLES_S / 2:
            self._need_rate_of_encoder(state, now_s)
            state.at_rate = True
        return state.at_rate

    def need_in_time(self, state: AxisState) -> None:
        """Raise InstrumentError for a task that should long be done; a search says what it met."""
        late = self._place.clock.now() > state.until_s
        if late and state.doing is Doing.SEARCHING and not self.is_turning(state):
            where_deg = self._reading_deg[state.number]
            state.forgets()
            raise InstrumentError(
                self._place.name,
                f"searched the zero of axis {state.number}",
                f"its encoder reads {where_deg:.5f} deg after that, not zero",
                "look whether something blocks it and whether HOF holds a home offset, then home "
                "it again",
            )
        try:
            super().need_in_time(state)
        except InstrumentError:
            if state.doing in (Doing.CLOSING, Doing.SEARCHING):
                self.brake(state)
                state.forgets()
            raise

    def astray(self, state: AxisState, attempted: str, where_deg: float) -> InstrumentError:
        """Return that an axis stands elsewhere; whole turns away, a setting has it go so."""
        error = super().astray(state, attempted, where_deg)
        apart_deg = state.count.angle_deg - where_deg
        near_deg = abs(math.remainder(apart_deg, TURN_DEG))
        if abs(apart_deg) < TURN_DEG / 2 or near_deg > self.settings.in_position_deg:
            return error
        return InstrumentError(
            self._place.name,
            attempted,
            f"axis {state.number} stands whole turns away, at {state.count.angle_deg:.3f} deg "
            f"where {where_deg:.3f} deg was commanded",
            "write settings.longest_move: 170 deg, as the table takes the shortest way to an "
            "angle, and see whether settings.continuous names the axes that turn for ever; "
            f"{HOME_AGAIN}",
        )

    def _search_zero(self, state: AxisState) -> None:
        """Begin to look for the zero; a table that has no search says so."""
        try:
            self._begin(state, "HOM")
        except RefusedByTable as error:
            raise InstrumentError(
                self._place.name,
                f"searched the zero of axis {state.number}",
                error.said,
                "write settings.zero: absolute where its encoders know their zero; else look at "
                "the table's panel for what keeps it from moving",
            ) from error

    def _begin(self, state: AxisState, command: str) -> None:
        """Send what begins or ends a motion; where it is refused, the zero is in doubt."""
        try:
            self._line.command(state.number, command)
        except RefusedByTable as error:
            state.forgets()
            if self.motor_on(state.number) is False:
                raise self._motor_off(state, f"sent {command!r} to axis {state.number}") from error
            raise

    def _motor_off(
        self, state: AxisState, attempted: str, refused: RefusedByTable | None = None
    ) -> InstrumentError:
        """Return that a motor is off, or does not go on; the axis must be homed again."""
        state.forgets()
        came_back = "its motor is off, though nobody here switched it off"
        if refused is not None:
            came_back = f"its motor does not go on: {refused.said}"
        return InstrumentError(
            self._place.name,
            attempted,
            came_back,
            "find out who or what switched it off (emergency stop, panel, a trip), make sure that "
            f"nobody is in danger, {HOME_AGAIN}",
        )

    def _read_rate(self, state: AxisState) -> None:
        state.rate = self._line.value(state.number, RATE) / self.settings.per_s

    def _begins_to_settle(self, n: int) -> None:
        self._stood_since_s[n] = math.inf
        self._rate_from.pop(n, None)

    def _has_settled(self, n: int, so: bool, for_s: float = SETTLES_S) -> bool:
        """Whether an axis has been as it should be for a while, by looks at both ends of it."""
        now_s = self._place.clock.now()
        self._stood_since_s[n] = min(self._stood_since_s[n], now_s) if so else math.inf
        return now_s - self._stood_since_s[n] >= for_s

    def _need_steady_rate_of_encoder(self, state: AxisState) -> None:
        """Hold a high rate that stays the same on the way to an angle against the encoder.

        Movements are limited in the table's own unit: in the wrong one they take for ever. Between
        two equal rates of a movement it is never slower, and may well be faster.
        """
        n, now_s, passed_s = state.number, self._place.clock.now(), self._passed_s(state.number)
        *_, began_deg, began_rate = self._rate_from.get(n, (0.0, math.inf))
        if abs(state.rate - began_rate) > STEADY * abs(state.rate):
            self._rate_from[n] = self._asked_s[n], now_s, state.count.angle_deg, state.rate
        elif passed_s >= SETTLES_S and abs(state.rate) > HIGH * self._limit("rate"):
            by_encoder = (state.count.angle_deg - began_deg) / passed_s
            if by_encoder / state.rate < 1 - ENCODER_AGREES:
                attempted = f"go to {state.target_deg:g} deg on axis {n}"
                raise self._another_unit(state, attempted, by_encoder)

    def _passed_s(self, n: int) -> float:
        """Return the time that surely passed between the angles of an axis since it has its rate.

        An answer that the computer takes up late is no fault of the table.
        """
        return self._asked_s[n] - self._rate_from.get(n, (0.0, math.inf))[1]

    def _need_rate_of_encoder(self, state: AxisState, now_s: float) -> None:
        """Raise InstrumentError where the encoder goes otherwise than its rate says."""
        asked_s, _, began_deg, _ = self._rate_from[state.number]
        way_deg = state.count.angle_deg - began_deg
        slowest, fastest = sorted(
            (way_deg / (now_s - asked_s), way_deg / self._passed_s(state.number))
        )
        by_encoder = max(slowest, min(state.rate, fastest))
        allowed = self.settings.at_rest_deg_per_s + ENCODER_AGREES * abs(state.rate)
        if state.count.lost or abs(by_encoder - state.rate) > allowed:
            attempted = f"turn axis {state.number} at {state.rate_demand:g} deg/s"
            raise self._another_unit(state, attempted, by_encoder)

    def _another_unit(self, state: AxisState, attempted: str, by_encoder: float) -> InstrumentError:
        """Stop an axis, and return that its encoder goes otherwise than its rate says."""
        self.brake(state)
        state.homed = False
        return InstrumentError(
            self._place.name,
            attempted,
            f"it says {state.rate:.4f} deg/s, and its encoder goes at {by_encoder:.4f} deg/s",
            "look in which units the table's angles and rates are, and write "
            "settings.rates_by where rates are by the minute",
        )

    def _need_inside(self, state: AxisState) -> None:
        """Stop an axis that turns out of the bench's angles, and raise InstrumentError."""
        low = self._place.limits.get("angle_low", -math.inf)
        high = self._place.limits.get("angle_high", math.inf)
        angle_deg = state.count.angle_deg
        outward = (angle_deg < low and state.rate < 0) or (angle_deg > high and state.rate > 0)
        if state.doing is Doing.TURNING and outward:
            self.brake(state)
            state.doing = Doing.NOTHING
            raise InstrumentError(
                self._place.name,
                f"looked at axis {state.number}",
                f"it turned to {angle_deg:.3f} deg where the bench allows {low:g} deg to "
                f"{high:g} deg, and was stopped",
                "correct the plan's rates, or limits.angle_low and limits.angle_high",
            )

    def _need_own_motion(self, state: AxisState) -> None:
        """Stop all where another axis turns that nobody here commanded, and raise InstrumentError.

        What names an axis is in no document: a table might move another one than was meant.
        """
        strangers = [other for other in self.strangers() if other is not state]
        if state.doing in MOVED and strangers:
            for each in self.axes.values():
                self.brake(each)
                each.homed = False
            raise self.commanded_by_another(state, strangers[0], "all were stopped")
