"""Acutronic ACUTROL3000 motion controller with a table of up to three axes, in ACL.

Sources: manuals TM-8004-C (command language), TM-9384C (TCP/IP, port 9878), TM-9374A, TM-9389 and
public clients. Not confirmed in a primary source: how the eight characters before each answer are
coded (digits and 32-bit words are taken, `framing: line` does without them, and the run's log says
which was met); how an error of the queue and an empty queue are written (a code with its text, and
nothing, `0` or `0,NO ERROR` are taken); that a continuous axis reads 0 deg to 360 deg.

Numbers are rounded in and out to a precision set at the controller, so a value agrees with what
reads back within half of the last printed digit. Limits of trip and position are written for each
mode, and where that is not taken, without a mode; both are proved by read-back.

Commands and their sources:
    *IDN? - identity - TM-8004-C - confirmed
    *STB? - whose interlock opened; clears the byte - TM-8004-C p.180 - confirmed
    :Status:MSG? QERROR;:Status:STB? - errors, until none is left - TM-8004-C p.178, 180; how they
        are written is not given - not confirmed
    :Status:CSR? A1STATE|A1DYN|A1SWFLT - registers of an axis; a tracking fault is bit 2, or 12
        before build 1848 - TM-8004-C, TM-9389 p.5 - confirmed
    :Mode 1,Rate|Position|Off, :Mode ALL,Off, :Mode? 1 - mode, answered by word or letter -
        TM-8004-C - confirmed
    :Mode:Home 1 - search for the encoder's zero, proved by status and position - TM-8004-C p.25,
        as a future command - not confirmed
    :Demand:Rate 1,10.0, :Demand:Position 1,10.5, and with ? - demands - TM-8004-C - confirmed
    :Read:Position? 1, :Read:Rate? 1 - angle and rate, of one servo frame - TM-8004-C - confirmed
    :Interlock:Close 1, :Interlock:Reset - servo, and forgetting a break - TM-8004-C - confirmed
    :Limit:Absolute? 1 - what the axis is rated for, six values or more - TM-8004-C p.138; its
        answer is not shown - not confirmed
    :Limit:Rate P,1,110.0, :Limit:Acceleration P,1,50.0, and with ? - limits of a mode - TM-8004-C -
        confirmed
    :Limit:VTR P,1,121.0, :Limit:HPOS, :Limit:LPOS, and with ? - trip and positions, with a mode -
        TM-8004-C p.143-146 - confirmed
    :L:V 1,121.0, :L:H, :L:L, and with ? - the same without a mode - TM-8004-C, which prints both -
        not confirmed
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import ClassVar

from drivers.acutronic.limits import Limits
from drivers.acutronic.line import AclLine, AclSettings
from drivers.acutronic.table import Table
from drivers.generic.table_axis import Doing
from drivers.generic.turntable import AxesTurntable
from drivers.transport.exchanges import Repeatable
from drivers.transport.text_line import not_this_model
from station.errors import InstrumentError
from station.roles import Identity, Place, SafetyReading

CLOSES_WITHIN_S = 10.0


class Acutrol3000(AxesTurntable):
    """A table whose axes go to angles and turn at rates, each against its own encoder.

    In position mode a continuous axis takes the shortest way, so `move_to` goes in steps of less
    than half a turn, each begun by `is_moving`; turns are counted from the encoder and the plan.

    Limits: `rate` deg/s and `acceleration` deg/s^2 of every axis; `angle_low` and `angle_high` deg.

    Watched are the largest rate and the largest angle of all axes, with their signs.
    """

    Settings = AclSettings
    _table: Table
    identifies_on: ClassVar[str] = "socket"
    recognises: ClassVar[str] = (
        r"(?is)^(.{8})?Acutronic[^,]*,\s*ACU?T(ROL)?3000,\s*(?P<serial>[^,]+)"
    )
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?",
        r"(READ:(POSITION|RATE)|MODE|DEMAND:(POSITION|RATE)|LIMIT:\w+|L:[VHL])\? [\w,]+",
        r"STATUS:CSR\? A\d(STATE|DYN|SWFLT)",
        r"DEMAND:RATE \d,0|MODE \d,RATE|MODE ALL,OFF",
    )
    """Neither what forgets what it tells (*STB?, MSG?) nor what closes a servo."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self._settings = self.Settings.of(place)
        self._limits_written = False
        self._line = AclLine(
            place, self._settings, self._settings.framing == "framed", self.met, self.repeatable
        )
        self._limits = Limits(place, self._settings, self._line, self.limit, self.met)
        self._table = Table(place, self._settings, self._line, self.limit)

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number and firmware."""
        answer = self._line.query("*IDN?")
        parts = [part.strip() for part in answer.split(",")]
        if len(parts) < 3 or "acutronic" not in parts[0].lower():
            raise not_this_model(self.place.name, "asked *IDN?", answer)
        return Identity(parts[0], parts[1], parts[2], ",".join(parts[3:]))

    def programme_limits(self) -> None:
        """Write rate, acceleration, trip and angle limits into the controller and read them back.

        Raises InstrumentError where the bench allows more than an axis is rated for.
        """
        self._line.forget_errors()
        for n in self._table.axes:
            self._limits.programme(n)
        self._limits_written = True

    def home(self, axis: int) -> None:
        """Reset a break that is over, close the servo, and look for the encoder's zero if it must.

        Turns are counted anew from there: the angle is one from -180 deg to 180 deg.
        """
        state = self._table.axis(axis)
        if not self._limits_written:
            self.programme_limits()
        state.forgets()
        if self._table.status(state).broken:
            self._line.command(":Interlock:Reset")
        self._line.command(f":Mode {axis},Off")
        self._line.command(f":Interlock:Close {axis}")
        state.begins(Doing.CLOSING, self.place.clock.now() + CLOSES_WITHIN_S)

    def take_errors(self) -> list[str]:
        """Return the errors that it keeps, the oldest first, and leave its queue empty."""
        return self._table.take_errors()

    def make_safe(self, deadline_s: float) -> None:
        """Brake every axis with its programmed acceleration, wait for rest, and set all modes off.

        Off is what the controller calls a controlled stop at zero rate: the servo stays closed, on
        purpose. A gimbal with a device that is not balanced would turn by itself with nothing that
        holds it. First comes rate zero, because the acceleration of Off is not documented.
        """
        self._come_to_rest(deadline_s)
        self._line.tell(":Mode ALL,Off")
        self._table.forget_errors()

    def last_attempt(self) -> None:
        """Set all modes off, whatever comes back."""
        self._table.last_attempt(":Mode ALL,Off")

    def read_safety(self) -> SafetyReading:
        """Read back that no axis turns, by rate and by two angles of each, and that all are off."""
        table, still = self._table, self._stands(self._line.proof.of)
        modes = self._line.proof.of(*(partial(self._line.mode, n) for n in table.axes))
        axes = [
            f"axis {state.number} {mode.lower()} at {state.count.angle_deg:.3f} deg, "
            f"{abs(state.rate):.3f} deg/s"
            for state, mode in zip(table.axes.values(), modes, strict=True)
        ]
        safe = still and set(modes) <= {"Off", "Abort"}
        return SafetyReading(safe, f"{'at rest' if still else 'turning'}: {'; '.join(axes)}")

    quantities: ClassVar = {
        **AxesTurntable.quantities,
        "chain": lambda self: "open" if self.open_contacts() else "closed",
    }

    def open_contacts(self) -> tuple[str, ...]:
        """Return `interlock` where a contact of the controller's interlock is open, or was.

        The controller keeps a break until it is reset. While no axis is homed, a break that is over
        is reset here: no servo closes by that, and one whose contact is still open is refused.
        """
        axes = self._table.axes.values()
        opened = self._interlock_broke()
        if opened and not any(axis.homed or axis.doing is not Doing.NOTHING for axis in axes):
            with suppress(InstrumentError):
                self._line.command(":Interlock:Reset")
            opened = self._interlock_broke()
        return ("interlock",) if opened else ()

    def _interlock_broke(self) -> bool:
        asked = self._table.state_queries
        return self._table.say_interlock(map(int, self._line.numbers(*asked)))
