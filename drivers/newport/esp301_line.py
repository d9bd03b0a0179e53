"""The line of a Newport ESP301: commands that are asked about, and its errors in plain words."""

from __future__ import annotations

import re
from collections.abc import Collection

from drivers.transport.exchanges import NEVER, Repeatable, shortened
from drivers.transport.ports import SerialSettings, serial_port
from drivers.transport.text_line import TextLine
from station.errors import InstrumentError
from station.roles import Place

ERROR_QUERY = "TB?"
MAX_ERRORS = 10
MODEL = re.compile(r"(ESP30\d)\s+Version\s+(\S+)", re.IGNORECASE)
ERROR = re.compile(r"\s*(\d+)\s*,\s*(\d+)\s*,\s*(\S.*?)\s*")

SEE_LIMITS = "compare the plan's and the bench file's values with the stage's ranges"
HOME_AGAIN = "then run again, which homes it first"
GENERAL = {
    4: (
        "the emergency stop was pressed",
        f"make sure that nobody is in danger, release it, {HOME_AGAIN}",
    ),
    8: ("a cable interlock is open", "seat the cables of the controller"),
    9: ("it has no such axis", "correct settings.axis in the bench file"),
}
OF_AXIS = {
    1: ("a value is out of range", SEE_LIMITS),
    2: ("the motor's amplifier reported a fault", "switch the controller off and on"),
    3: (
        "the stage did not keep up with its profile (following error), and the motor is off",
        f"look whether a cable or the device blocks it, {HOME_AGAIN}",
    ),
    4: ("the positive limit switch was reached", f"turn the stage off it by hand, {HOME_AGAIN}"),
    5: ("the negative limit switch was reached", f"turn the stage off it by hand, {HOME_AGAIN}"),
    6: ("the angle is above its software limit", "correct the plan's angles, or limits.angle_high"),
    7: ("the angle is below its software limit", "correct the plan's angles, or limits.angle_low"),
    8: ("no stage is connected to this axis", "seat the stage's cable, or correct settings.axis"),
    9: ("the encoder's signal is faulty", "seat the stage's cable"),
    10: ("the rate is above the stage's maximum", "lower limits.rate in the bench file"),
    11: ("the acceleration is above the stage's maximum", "lower limits.acceleration"),
    13: ("the motor is off", f"find out who or what switched it off, {HOME_AGAIN}"),
    20: ("it stopped before it found its zero", "find what stopped it, then home it again"),
    29: ("a digital interlock is open", "close it, then run again"),
    30: ("it is still looking for its zero", "wait until it has found it"),
}


class EspLine(TextLine):
    """Commands and queries of one controller; `axis` is the one whose errors are ours."""

    def __init__(
        self, place: Place, settings: SerialSettings, axis: int, repeatable: Repeatable = NEVER
    ) -> None:
        self._axis = axis
        super().__init__(
            place,
            serial_port(place.address, settings),
            request_end="\r",
            answer_end="\r\n",
            ignores_empty=True,
            repeatable=repeatable,
            identity="VE?",
        )

    def command(self, message: str, *, but_for: Collection[int] = ()) -> int:
        """Send a command and ask for an error in the same line; a reported one is raised.

        `but_for` are errors of the axis that are no fault here. Returns such an error, or 0.
        """
        code, text = self._error(f"{message};{ERROR_QUERY}")
        if code and code not in [100 * self._axis + error for error in but_for]:
            self.forget_errors()
            raise self.named(f"sent {message!r}", code, text)
        return code

    def check(self, attempted: str) -> None:
        """Raise InstrumentError for the oldest error that is kept, and forget the others."""
        code, text = self._error(ERROR_QUERY)
        if code:
            self.forget_errors()
            raise self.named(attempted, code, text)

    def forget_errors(self) -> None:
        """Read errors until there is none."""
        for _ in range(MAX_ERRORS + 1):
            if not self._error(ERROR_QUERY)[0]:
                return

    def next_error(self) -> str:
        """Take the oldest error that is kept; empty where there is none."""
        code, text = self._error(ERROR_QUERY)
        return f"{code}, {text}" if code else ""

    def motor_off(self, attempted: str) -> InstrumentError:
        """Return the error of a motor that is off for no reported reason."""
        return self.named(attempted, 100 * self._axis + 13, "MOTOR NOT ENABLED")

    def named(self, attempted: str, code: int, text: str) -> InstrumentError:
        """Return an error of the controller in plain words, with its own code and text."""
        known = GENERAL.get(code) if code < 100 else OF_AXIS.get(code % 100)
        meaning, do_now = known or ("it reported an error", SEE_LIMITS)
        return InstrumentError(
            self._place.name, attempted, f"{meaning} (error {code}, {shortened(text)})", do_now
        )

    def _error(self, message: str) -> tuple[int, str]:
        answer = self.query(message)
        match = ERROR.fullmatch(answer)
        if match is None:
            raise self.odd(message, answer)
        return int(match[1]), match[3]
