"""Newport ESP301 motion controller with a rotary stage, by serial port or the TCP port of one.

At most 80 characters a line and ten kept errors. Commands of a line are carried out in order and do
not wait for a movement; that it is over is asked for. Not confirmed in a primary source: the serial
settings (921600 Bd by USB on the ESP301, 19200 Bd with handshake on the ESP300).

Commands and their sources:
    VE? - version - ESP300 clients - not confirmed
    ID? - stage and serial number; its form - ESP300 clients - not confirmed
    TB? - oldest error as code, time stamp and text - ESP300 clients - not confirmed
    SN - unit, 7 is degree - ESP300 clients - not confirmed
    VU, AU - largest velocity and acceleration; that they can be written - ESP300 clients -
        not confirmed
    VA, AC, AG - velocity, acceleration, deceleration - ESP300 clients - not confirmed
    SL, SR - software limits - ESP300 clients - not confirmed
    MO, MO? - motor on, and whether it is - ESP300 clients - not confirmed
    OR - search for the encoder's zero - ESP300 clients - not confirmed
    PA - turn to an absolute angle, without waiting - ESP300 manual p.3-2, 3-8 - confirmed
    MD? - whether the movement is over - ESP300 clients - not confirmed
    TP? - angle of the encoder - ESP300 manual p.3-2, 3-8 - confirmed
    DP?, TV? - commanded angle, velocity - ESP300 clients - not confirmed
    ST - stop with the programmed deceleration - ESP300 clients - not confirmed
    AB - abort all motion - ESP300 clients - not confirmed
"""

from __future__ import annotations

import math
import re
from contextlib import suppress
from typing import ClassVar

from pydantic import Field

from drivers.newport.esp301_line import MODEL, EspLine
from drivers.transport.exchanges import Repeatable
from drivers.transport.ports import BaudRate, Handshake, SerialSettings
from drivers.transport.text_line import check_written, errors_until_none, not_this_model
from station.errors import InstrumentError
from station.fields import Degree, Second
from station.roles import Driver, Identity, Place, SafetyReading, quantity

STAGE = re.compile(r"\s*([^,\s][^,]*?)\s*,\s*S/?N\s*(\S+)\s*")
LOOK_S = 0.05
STILL_S = 0.1

UNIT_DEGREE = 7
PROTECTED = 17
OUT_OF_RANGE = 1
AGREES = 1e-4
MOVING = (
    ("rate", "deg/s", "VU", ("VA",)),
    ("acceleration", "deg/s^2", "AU", ("AC", "AG")),
)
"""A limit of the bench, its unit, the controller's maximum, and what the controller uses."""


class NewportEsp301(Driver):
    """A rotary stage that turns to absolute angles once its encoder's zero was found.

    Limits: `rate` deg/s and `acceleration` deg/s^2; `angle_low` and `angle_high` deg go into the
    controller where they are given.

    The controller reports errors only when asked for them, so every command asks in the same line.
    The zero counts as found only when this program has had it looked for, and no longer once the
    controller reports a fault or its motor off: a trip may cost steps.
    """

    class Settings(SerialSettings):
        """The stage's axis, and its line."""

        axis: int = Field(1, ge=1, le=3, description="of the controller")
        in_position_deg: Degree = Field(
            0.002, gt=0, description="how far the encoder may be from the commanded angle at rest"
        )
        home_mode: int = Field(
            1, ge=1, le=6, description="the controller's OR; 1 is home switch and index"
        )
        home_within_s: Second = Field(120.0, gt=0, description="to find the encoder's zero")
        baud_rate: BaudRate = 921600
        hardware_handshake: Handshake = True

    without_limits = "the stage does not turn"
    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask it; it knows no `*IDN?`."""

    repeatable: ClassVar[Repeatable] = Repeatable(
        r"VE\?|\d(ID|TP|DP|MD|MO|TV|VA|VU|AC|AG|AU|SL|SR|SN)\?", r"\dST"
    )
    """Neither TB?, which forgets the error it tells, nor what begins a movement."""

    def __init__(self, place: Place) -> None:
        self.place = place
        settings = self.Settings.of(place)
        self._axis = settings.axis
        self._in_position_deg = settings.in_position_deg
        self._home_mode, self._home_within_s = settings.home_mode, settings.home_within_s
        self._limits_written = False
        self._homed = False
        self._homing = False
        self._turning = False
        self._until_s = math.inf
        self._line = EspLine(place, settings, self._axis, self.repeatable)

    def _as_sent(self, command: str) -> str:
        return command if command in self.repeatable else self._of_axis(command)

    def identify(self) -> Identity:
        """Ask for the controller's version (`VE?`), and stage and serial number (`ID?`)."""
        version = self._line.query("VE?")
        match = MODEL.search(version)
        if match is None:
            raise not_this_model(self.place.name, "sent 'VE?'", version)
        answer = self._line.query(self._of_axis("ID?"))
        stage = STAGE.fullmatch(answer)
        if stage is None:
            raise self._line.odd(self._of_axis("ID?"), answer)
        return Identity("Newport", f"{match[1]} with {stage[1]}", stage[2], match[2])

    def programme_limits(self) -> None:
        """Write rate, acceleration and angle limits into the controller and read them back.

        Stages that protect their settings refuse VU and AU (x17) and keep their rating as maximum;
        what is used, VA, AC and AG, is the bench's all the same. Raises InstrumentError where the
        bench allows more than the stage is rated for.
        """
        self._line.forget_errors()
        if self._number("SN?") != UNIT_DEGREE:
            self._write("SN", UNIT_DEGREE)
        for name, unit, maximum, headers in MOVING:
            wanted = self.limit(name)
            command = self._of_axis(f"{maximum}{wanted:.6g}")
            if self._line.command(command, but_for=(PROTECTED, OUT_OF_RANGE)):
                self.met(f"keeps its own {maximum}")
            rating = self._number(f"{maximum}?")
            self.check_rating(name, rating, unit, whose="the stage", rounded=AGREES)
            for header in headers:
                self._write(header, wanted)
        limits = self.place.limits
        ends = (("SL", "angle_low"), ("SR", "angle_high"))
        angles = [(header, limits[name]) for header, name in ends if name in limits]
        if len(angles) == 2 and angles[0][1] >= self._number("SR?"):
            angles.reverse()  # neither may pass the other on its way
        for header, wanted in angles:
            self._write(header, wanted)
        self._limits_written = True

    def is_homed(self) -> bool:
        """Whether the encoder's zero was found, and nothing has put it in doubt since."""
        if self._homing:
            self.is_moving()
        return self._homed

    def home(self) -> None:
        """Switch the motor on and begin to look for the encoder's zero."""
        self._prepare()
        self._line.command(self._of_axis("MO"))
        self._homed, self._homing = False, True
        self._began(self._home_within_s)
        self._command(f"OR{self._home_mode}")

    def move_to(self, angle_deg: float) -> None:
        """Begin to turn to an absolute angle of the encoder; returns at once.

        Raises InstrumentError where the bench's limits do not hold the angle, and on a stage whose
        zero has not been found.
        """
        low = self.place.limits.get("angle_low", -math.inf)
        high = self.place.limits.get("angle_high", math.inf)
        attempted = f"turn to {angle_deg:g} deg"
        if not (math.isfinite(angle_deg) and low <= angle_deg <= high):
            raise self.error(
                attempted,
                f"the bench allows {low:g} deg to {high:g} deg",
                "correct the plan's angles, or limits.angle_low and limits.angle_high",
            )
        if not self.is_homed():
            raise self.error(
                attempted,
                "the encoder's zero has not been found since the stage was opened or has tripped",
                "home it first",
            )
        self._prepare()
        rate, acceleration = self.limit("rate"), self.limit("acceleration")
        takes_s = abs(angle_deg - self._encoder_deg()) / rate + 2 * rate / acceleration
        self._began(2 * takes_s + 5.0)
        self._command(f"PA{angle_deg:.6f}")

    def is_moving(self) -> bool:
        """Whether the stage still turns.

        Raises InstrumentError for a fault of the axis, and for a movement that does not end.
        """
        # What was asked in time is no fault, however late this computer comes to look at it.
        asked_s = self.place.clock.now()
        if self._is_turning():
            if asked_s > self._until_s:
                raise self.error(
                    "waited for the stage to stand still",
                    "it still turns, or has not settled, long after it should have",
                    "look whether something blocks it, then run again",
                )
            return True
        homing, self._turning, self._homing = self._homing, False, False
        try:
            self._line.check("asked whether it stands still")
            if self._number("MO?") == 0 and (homing or self._homed):
                raise self._line.motor_off("asked whether it stands still")
        except InstrumentError:
            self._homed = self._limits_written = False
            raise
        self._homed = self._homed or homing
        return False

    def angle_deg(self) -> float:
        """Return the encoder's angle in deg.

        Raises InstrumentError where the stage stands still and the encoder is further than
        `in_position` from the angle that the controller believes in.
        """
        angle_deg = self._encoder_deg()
        if self._homed and not self._turning:
            desired_deg = self._number("DP?")
            if abs(angle_deg - desired_deg) > self._in_position_deg:
                self._homed = False
                raise self.error(
                    "read the angle at rest",
                    f"the encoder reads {angle_deg:.5f} deg where {desired_deg:.5f} deg was "
                    f"commanded, more than {self._in_position_deg:g} deg apart",
                    "look for a blocked stage or a loose encoder cable, then home it again",
                )
        return angle_deg

    def make_safe(self, deadline_s: float) -> None:
        """Brake with the programmed deceleration and wait until the stage stands still.

        The motor stays on: on a horizontal axis a device that is not balanced would turn the stage
        as soon as nothing holds it.
        """
        self._homed = self._homed and not self._homing
        self._homing = False
        stop = self._of_axis("ST")
        # What was refused before is no refusal of this: that it stands is what is read back.
        self._line.patiently(stop, lambda: self._line.query(f"{stop};TB?"))
        while self._number("MD?") == 0 and self.place.clock.now() < deadline_s - STILL_S:
            self.place.clock.sleep(LOOK_S)
        self._turning = False
        with suppress(InstrumentError):
            self._line.forget_errors()

    def last_attempt(self) -> None:
        """Abort all motion, and wait for no answer."""
        self._line.last_attempt("AB")

    def read_safety(self) -> SafetyReading:
        """Read back whether the movement is over, and from two readings that the angle stays."""
        (first_deg,) = self._line.proof.of(lambda: self._number("TP?"))
        self.place.clock.sleep(STILL_S)
        angle_deg, done, motor_on = self._line.proof.of(
            lambda: self._number("TP?"),
            lambda: self._number("MD?") != 0,
            lambda: self._number("MO?") != 0,
        )
        rate = (angle_deg - first_deg) / STILL_S
        still = abs(angle_deg - first_deg) <= self._in_position_deg
        self.place.publish("rate", rate, "deg/s")
        self.place.publish("angle", angle_deg, "deg")
        self.place.publish("motion", "at-rest" if done and still else "moving")
        return SafetyReading(
            done and still,
            f"{'at rest' if done else 'moving'} at {angle_deg:.3f} deg, {abs(rate):.3f} deg/s, "
            f"motor {'on' if motor_on else 'off'}",
        )

    def take_errors(self) -> list[str]:
        """Return the errors that it keeps, the oldest first, and leave its queue empty."""
        return errors_until_none(self.place.name, self._line.next_error)

    def _prepare(self) -> None:
        """Have the bench's limits in the controller before anything turns."""
        if not self._limits_written:
            self.programme_limits()

    def _began(self, within_s: float) -> None:
        self._turning = True
        clock = self.place.clock
        self._until_s = clock.now() + clock.patience_s(within_s)
        self.place.publish("motion", "moving")

    def _command(self, command: str) -> None:
        """Send what begins a movement; an error that puts the zero in doubt is remembered."""
        try:
            self._line.command(self._of_axis(command))
        except InstrumentError:
            self._homed = self._homing = self._limits_written = False
            raise

    @quantity("angle", "deg")
    def _encoder_deg(self) -> float:
        return self._number("TP?")

    @quantity("rate", "deg/s")
    def _rate_deg_per_s(self) -> float:
        return self._number("TV?")

    @quantity("motion", states=("moving", "at-rest"))
    def _is_turning(self) -> bool:
        return self._number("MD?") == 0

    def _write(self, header: str, value: float) -> None:
        """Set a value and read it back; InstrumentError where another one comes."""
        self._line.command(self._of_axis(f"{header}{value:.6g}"))
        check_written(self.place.name, header, value, self._number(f"{header}?"), AGREES)

    def _number(self, query: str) -> float:
        return self._line.number(self._of_axis(query))

    def _of_axis(self, command: str) -> str:
        return f"{self._axis}{command}"
