"""Ideal Aerosmith rate table of up to three axes, in the maker's table language, by serial port.

No manual of the maker was at hand. Sources are three public clients of tables with one axis: the
control panel of a 1270VS with its tests (`panel`), the rate sweep of an incoming inspection,
actigraph/RateTableSweepGUI (`sweep`), and a test suite of an IMU (`suite`). What two of them agree
on is confirmed, what stands in one alone is not. CR ends a command, LF behind it is nothing (suite;
sweep sends it); each answer ends with the prompt `>` (all three); `?` in an answer is a refusal
(suite alone). Where they differ the driver copes with both, and the run's log says which was met:

* whether JOG is answered (panel: every command is, by CR LF `>` CR LF; sweep: JOG and SGO are not).
  So each command asks for the position in the same exchange, and that has to be answered;
* what MCO answers for a movement that is over (sweep: 1, suite: 0). It is not asked: an axis has
  arrived when its encoder stands where it should for 0.5 s;
* what moves to an angle (sweep: MOV, and RMO by an angle; suite: P). `moves_by` names it; RMO, by
  default, means the same where positions go from 0 deg to 360 deg and where they count turns;
* whether rates are in deg/s (sweep, and the panel's limits) or in deg/min (a remark in the panel):
  `rates_by`. A rate counts only where the encoder goes at it, so that a wrong unit ends the run.

Assumed, because no document at hand says so: that a table with several axes has one line, on which
a word before the command names the axis (`prefixes`, 1, 2, 3); the driver stops all axes when one
turns that was not meant, and a bench of another form writes its own words. That values may have a
fraction. That VEL and ACL limit movements, and STO brakes with ACL; the rate of JOG is limited by
the driver alone. That HOM ends at zero. That nothing of this outlasts a power-on, as SAV, which
stores it, is never sent. No question of identity, of an error or of an interlock is documented: the
table names no serial number, and of an emergency stop it tells by a motor that is off (SRV?).
Positive rates are clockwise from above (panel, sweep); a commissioning shows each axis' sense.

Commands and their sources:
    STO - stop - panel, sweep, suite - confirmed
    HOM - search for the encoder's zero - panel, sweep, suite - confirmed
    JOG10 - turn at a rate, clockwise positive - panel, sweep - confirmed
    ACL50 - acceleration, deg/s^2 - panel, sweep - confirmed
    PPO - angle of the encoder, deg - sweep, suite - confirmed
    PVE - measured rate - sweep - not confirmed
    VEL110 - rate of a movement - sweep - not confirmed
    RMO10 - move by an angle - sweep - not confirmed
    MOV10 - move to an angle - sweep - not confirmed
    P10 - move to an angle - suite - not confirmed
    SRV1 - motor on - panel - not confirmed
    SRV? - whether the motor is on - panel, which asks by `?` behind the mnemonic - not confirmed
    ACL?, VEL? - what is set - panel, in the same way - not confirmed
    IDN? - nothing that a table knows; that no number comes shows the line in step - no source -
        not confirmed
    1PPO - the axis before the command - no source - not confirmed
"""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from drivers.generic.turntable import AxesTurntable
from drivers.ideal_aerosmith.axes import AGREES, AtlSettings, AtlTable
from drivers.ideal_aerosmith.line import (
    IDENTITY_QUESTION,
    NUMBER,
    POSITION,
    REFUSAL,
    AtlLine,
    RefusedByTable,
    number,
)
from drivers.transport.exchanges import Repeatable
from drivers.transport.text_line import check_written, not_this_model
from station.errors import InstrumentError
from station.roles import UNTOLD, Identity, Place, SafetyReading

MAKER, MODEL = "Ideal Aerosmith", "rate table"
MOTOR_ON_WITHIN_S = 10.0


class IdealAerosmithTable(AxesTurntable):
    """A table whose axes go to angles and turn at rates, each against its own encoder.

    Turns are counted from the encoder and the plan, whether its position counts them or not.

    Limits: `rate` deg/s and `acceleration` deg/s^2 of every axis; `angle_low` and `angle_high` deg,
    which the driver alone holds.

    Watched are the largest rate and the largest angle of all axes, with their signs.
    """

    Settings = AtlSettings
    _table: AtlTable
    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask it; it knows no `*IDN?`."""

    repeatable: ClassVar[Repeatable] = Repeatable(
        r"IDN\?", r"[!-~]{0,4}(PPO|PVE|STO|(SRV|ACL|VEL)\?|(ACL|VEL)[\d.]+)"
    )
    """Neither what begins a movement nor what switches a motor on."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self._settings = self.Settings.of(place)
        self._limits_written = False
        self._line = AtlLine(place, self._settings, self._settings.words, self.met, self.repeatable)
        self._table = AtlTable(place, self._settings, self._line, self.limit, self.met)

    def identify(self) -> Identity:
        """Return that a table answers: no question of its serial number is documented.

        Raises AnotherInstrument for what names itself otherwise or has no position.
        """
        for n in self._table.axes:
            self._need_position(n)
        answer = self._line.query(IDENTITY_QUESTION)
        named = [part.strip() for part in answer.split(",")]
        if not REFUSAL.search(answer) and "aerosmith" not in answer.lower():
            raise not_this_model(self.place.name, f"asked {IDENTITY_QUESTION}", answer)
        if len(named) < 3 or REFUSAL.search(answer):
            return Identity(MAKER, MODEL, UNTOLD, UNTOLD)
        return Identity(MAKER, named[1], named[2], ",".join(named[3:]))

    def _need_position(self, n: int) -> None:
        message = self._line.of_axis(n, POSITION)
        answer = self._line.query(message)
        if NUMBER.fullmatch(answer):
            return
        attempted = f"asked {message} for the angle of axis {n}"
        if REFUSAL.search(answer):
            do_now = "compare settings.axes and settings.prefixes with the table's manual"
            raise self.error(attempted, f"{answer!r} came back", do_now)
        raise not_this_model(self.place.name, attempted, answer)

    def programme_limits(self) -> None:
        """Write acceleration and rate of movements into the controller, and read them back.

        Raises InstrumentError where the table refuses one or keeps another. A firmware that tells
        no setting is believed; what its axes do is held against their encoders.
        """
        per_s = self._settings.per_s
        for n in self._table.axes:
            self._write(n, "ACL", "acceleration", "deg/s^2", 1.0)
            self._write(n, "VEL", "rate", "deg/s", per_s)
        self._limits_written = True

    def _write(self, n: int, header: str, limit: str, unit: str, per_s: float) -> None:
        wanted = self.limit(limit)
        attempted = f"limit the {limit} of axis {n} to {wanted:g} {unit}"
        do_now = f"lower limits.{limit} in the bench file"
        if limit == "rate":
            do_now += ", or see whether settings.rates_by is the table's unit"
        try:
            self._line.command(n, f"{header}{number(per_s * wanted)}")
        except RefusedByTable as error:
            raise self.error(attempted, error.said, do_now) from error
        kept = self._line.value_if_known(n, f"{header}?")
        if kept is None:
            self.met("does not tell its settings")
        elif kept < per_s * wanted * (1 - AGREES):
            raise self.error(attempted, f"the axis ends at {kept / per_s:g} {unit}", do_now)
        else:
            check_written(self.place.name, header, per_s * wanted, kept, AGREES * per_s * wanted)

    def home(self, axis: int) -> None:
        """Switch the motor on, and look for the encoder's zero if it must.

        Turns are counted anew from there: the angle is one from -180 deg to 180 deg.
        """
        state = self._table.axis(axis)
        if not self._limits_written:
            self.programme_limits()
        state.forgets()
        self._table.switch_motor_on(state, MOTOR_ON_WITHIN_S)

    def make_safe(self, deadline_s: float) -> None:
        """Brake every axis with its programmed acceleration, and wait for rest.

        The motors stay on, on purpose: a gimbal with a device that is not balanced would turn by
        itself with nothing that holds it.
        """
        self._come_to_rest(deadline_s)

    def last_attempt(self) -> None:
        """Stop every axis, whatever comes back."""
        stops = (self._line.of_axis(n, "STO") for n in self._table.axes)
        self._line.last_attempt("\r".join(stops))

    def read_safety(self) -> SafetyReading:
        """Read back that no axis turns, by rate and by two angles of each."""
        table, still = self._table, self._stands(self._line.proof.of)
        motors = self._line.proof.of(*(partial(table.motor_on, n) for n in table.axes))
        words = {None: "", True: ", motor on", False: ", motor off"}
        axes = [
            f"axis {state.number} at {state.count.angle_deg:.3f} deg, {abs(state.rate):.3f} deg/s"
            f"{words[motor]}"
            for state, motor in zip(table.axes.values(), motors, strict=True)
        ]
        return SafetyReading(still, f"{'at rest' if still else 'turning'}: {'; '.join(axes)}")

    def open_contacts(self) -> tuple[str, ...]:
        """Return the motors that are off since `home`: by an emergency stop, the panel or a trip.

        Of an axis that nobody has homed nothing is known. Raises InstrumentError where the
        firmware does not tell of motors: then no contact can be read here.
        """
        table = self._table
        opened = [
            f"motor {n}" for n in table.axes if table.motor_on(n) is False and n in table.held
        ]
        if not table.tells_motor:
            raise InstrumentError(
                self.place.name,
                "asked whether its motors are on",
                "its firmware does not tell",
                "take it out of the shares of interlock_chain, and have its emergency stop read by "
                "an instrument of its own",
            )
        return tuple(opened)
