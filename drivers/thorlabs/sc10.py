"""Thorlabs SC10 controller of the pump light's shutter, by serial port or the TCP port of one.

Sources: the manual's table of commands (mode 5 is the external gate, `ens` toggles, `closed?`,
`interlock?`) and public clients for 9600 Bd, CR, the echo before each answer and the prompt after
it, `>` with a blank behind it or, by some clients, without. Not confirmed in a primary source: that
an enabled shutter in the external gate mode is open while its gate is high; that `ens?` survives a
change of the mode, so it is read and set again; the wording of errors around `CMD_NOT_DEFINED` and
`CMD_ARG_INVALID`. The controller reports no serial number: its identity holds `untold` in that
place.

The bench's trigger goes high at time zero, and then the light must go off. Between the trigger and
the gate an inverter is needed for that, and the driver looks whether there is one: a shutter that
stays closed while the trigger is at rest is an error.

Commands and their sources:
    id?, ens, ens?, mode, closed?, interlock? - who answers, enabling, the mode, the sensor, the
        interlock, 1 for a tripped one - SC10 manual 8654-D02 p.15 - confirmed
    CMD_NOT_DEFINED, CMD_ARG_INVALID - refusals, bare or behind `Command error` - the maker's TC200,
        public client code - not confirmed
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import ClassVar, Literal

from pydantic import Field

from drivers.transport.exchanges import Repeatable
from drivers.transport.ports import SerialSettings
from drivers.transport.text_line import SerialLine, odd
from station.errors import InstrumentError
from station.fields import Second
from station.roles import (
    UNTOLD,
    Driver,
    Identity,
    LightSettings,
    Place,
    SafetyReading,
    quantity,
)
from station.roles.patience import PATIENT

MODEL = re.compile(r"THORLABS\s+(SC10)\s+VERSION\s+(\S+)", re.IGNORECASE)
MANUAL, EXTERNAL = 1, 5
TOGGLE_TRIES = 3
LOOK_S = 0.01
NOBODY_ELSE = "check the cable and that nobody else talks to the controller"
REFUSALS = {
    "CMD_NOT_DEFINED": "check the cable and that this is an SC10 with a recent firmware",
    "CMD_ARG_INVALID": NOBODY_ELSE,
}


class PromptLine(SerialLine):
    """A line whose answers end with a prompt, behind which a blank may stand."""

    padding = b" "


class ThorlabsSc10(Driver):
    """A shutter that is closed at rest, opened and closed by commands or by the bench's trigger."""

    class Settings(SerialSettings):
        """How fast its shutter is, and its line."""

        moves_within_s: Second = Field(
            0.1, gt=0, description="in which it must open or close; the SH05 needs about 10 ms"
        )
        baud_rate: Literal[9600, 115200] = Field(9600, description="serial line: bits in a second")

    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask it; it knows no `*IDN?`."""

    repeatable: ClassVar[Repeatable] = Repeatable(r"(id|ens|closed|interlock|mode)\?", r"mode=\d")
    """Not `ens`: sent twice, it does nothing."""

    def __init__(self, place: Place) -> None:
        self.place = place
        settings = self.Settings.of(place)
        self._moves_within_s = settings.moves_within_s
        self.trigger_to_dark_s = LightSettings.of(place).trigger_to_dark_s
        """From the trigger's edge until the light is blocked, s; None where nobody measured."""
        self._line = PromptLine(
            place,
            settings,
            answer_end=">",
            ignores_empty=True,
            repeatable=self.repeatable,
            identity="id?",
        )

    def identify(self) -> Identity:
        """Ask `id?` for model and firmware; the serial number stands on the unit alone."""
        answer = self._ask("id?")
        match = MODEL.search(answer)
        if match is None:
            raise odd(self.place.name, "sent 'id?'", answer)
        return Identity("Thorlabs", match[1], UNTOLD, match[2])

    def open_shutter(self) -> None:
        """Let the light through in manual mode; returns once the shutter's sensor says so.

        Raises InstrumentError for an open interlock, and for a shutter that stays closed.
        """
        self._look_at_interlock("open the shutter")
        self._set_mode(MANUAL)
        self._enable(True)
        self._await(
            True,
            "open the shutter",
            "check that the shutter head is plugged in and nothing blocks its blade",
        )

    def close_shutter(self) -> None:
        """Block the light in manual mode; returns once the shutter's sensor says so.

        Raises InstrumentError for a shutter that does not close.
        """
        self._close(self.place.clock.now() + self._moves_within_s)

    def follow_trigger(self) -> None:
        """Let the light through while the bench's trigger is at rest, by the external gate.

        Raises InstrumentError for an open interlock, and where the gate is low at rest.
        """
        self._look_at_interlock("follow the trigger")
        self._enable(False)
        self._set_mode(EXTERNAL)
        self._enable(True)
        self._await(
            True,
            "follow the trigger, which is at rest",
            "its gate is low: put an inverter between the trigger and the gate, seat their "
            "cables, and take the trigger back to rest before",
        )

    @quantity("output", states=("on", "off"))
    def is_open(self) -> bool:
        """Whether the light passes, by the shutter's own sensor."""
        return not self._flag("closed?")

    def make_safe(self, deadline_s: float) -> None:
        """Close the shutter, in whatever mode it is, and see that it is closed.

        Raises InstrumentError for a shutter that does not close before run time `deadline_s`.
        """
        self._close(deadline_s)

    def read_safety(self) -> SafetyReading:
        """Read back whether the shutter is closed, and whether it is disabled, so that it stays."""
        is_open, enabled, mode_now = self._line.proof.of(
            self.is_open, lambda: self._flag("ens?"), self._mode
        )
        closed = not is_open
        mode = "following the trigger" if mode_now == EXTERNAL else "by command"
        return SafetyReading(
            closed and not enabled,
            f"shutter {'closed' if closed else 'OPEN'}, {'enabled' if enabled else 'disabled'}, "
            f"{mode}",
        )

    def _close(self, deadline_s: float) -> None:
        # Disabled it closes in every mode; the mode comes after, so that nothing opens it again.
        self._enable(False)
        self._await(
            False,
            "close the shutter",
            "THE LIGHT STILL PASSES: switch the pump laser off by hand, then find what holds the "
            "blade",
            deadline_s,
        )
        self._set_mode(MANUAL)

    def _await(
        self, is_open: bool, attempted: str, do_now: str, deadline_s: float = math.inf
    ) -> None:
        """Wait until the sensor says what it should; InstrumentError when it does not in time."""
        within_s = min(self._moves_within_s, max(deadline_s - self.place.clock.now(), 0.0))
        until_s = self.place.clock.now() + within_s
        while self.is_open() != is_open:
            if self.place.clock.now() >= until_s:
                state = "closed" if is_open else "open"
                enabled = "enabled" if self._flag("ens?") else "disabled"
                raise self.error(
                    attempted,
                    f"its sensor still reads {state} after {within_s:g} s, and the controller is "
                    f"{enabled}",
                    do_now,
                )
            self.place.clock.sleep(LOOK_S)

    def _enable(self, wanted: bool) -> None:
        """Enable or disable the shutter by a toggle, which is why each is preceded by a look."""
        attempted = f"{'enable' if wanted else 'disable'} the shutter by 'ens'"
        for _ in range(TOGGLE_TRIES):
            if self._flag("ens?") == wanted:
                return
            try:
                self._ask("ens")
            except InstrumentError:  # on the way to rest another look tells what became of it
                if not PATIENT.get():
                    raise
        if self._flag("ens?") != wanted:
            if wanted:
                self._look_at_interlock(attempted)
            raise self.error(
                attempted,
                f"ens? still reads {int(not wanted)} after {TOGGLE_TRIES} attempts",
                "press ENABLE at its front panel, and see that nobody else uses the controller",
            )

    def _look_at_interlock(self, attempted: str) -> None:
        if self._flag("interlock?"):
            raise self.error(
                attempted,
                "its interlock is open (interlock? reads 1)",
                "make sure that nobody is in the beam, close the interlock at its rear panel, then "
                "run again",
            )

    def _set_mode(self, mode: int) -> None:
        self._ask(f"mode={mode}")
        has = self._mode()
        if has != mode:
            raise self.error(
                f"set its mode to {mode}",
                f"mode? reads {has}",
                "see that nobody works at its front panel, then run again",
            )

        self.met(f"prompt {'with' if self._line.padded else 'without'} a blank")

    def _mode(self) -> int:
        return int(self._ask("mode?", str.isdecimal))

    def _flag(self, question: str) -> bool:
        return self._ask(question, ("0", "1").__contains__) == "1"

    def _ask(self, message: str, fits: Callable[[str], bool] = lambda value: True) -> str:
        """Send a message and return the value after its echo, empty for a command.

        With patience, what does no harm twice is sent again, so that one lost answer does not leave
        the light on.
        """
        answer = self._line.patiently(message, lambda: self._value(message))
        if not fits(answer):
            raise self._odd(message, answer)
        return answer

    def _value(self, message: str) -> str:
        answer = self._line.query(message)
        lines = [line.strip() for line in answer.splitlines() if line.strip()]
        if not lines or lines[0] != message:
            raise self._odd(message, answer)
        value = " ".join(lines[1:])
        for refusal, do_now in REFUSALS.items():
            if refusal in value:
                raise self.error(f"sent {message!r}", f"it refused with {refusal}", do_now)
        return value

    def _odd(self, message: str, answer: str) -> InstrumentError:
        return odd(self.place.name, f"sent {message!r}", answer, NOBODY_ELSE)
