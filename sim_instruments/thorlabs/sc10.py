"""Thorlabs SC10 shutter controller with an SH05 shutter at the pump light, in lines of text.

From the manual's table of commands and public clients: CR ends a command; the answer is its echo,
CR, the value and CR where there is one, and the prompt `> ` (two clients meet the blank before the
next echo, another expects `>` alone); `id?` and `*idn?` say who it is; `ens` toggles; `closed?` is
1 for a closed shutter, `interlock?` 1 for a tripped one; errors are `Command error CMD_NOT_DEFINED`
and `Command error CMD_ARG_INVALID`, on some bare; `?` lists the commands, which are in lower case;
`save` and `savp` store, `resp` loads what `savp` stored. What no source at hand says, and is
assumed: in the external gate mode an enabled shutter is open while the gate is high; a change of
the mode leaves `ens?` as it is;
an open interlock disables the shutter, and `ens` is then taken without effect; an empty line is
answered by the prompt. The sequences of the modes auto, single and repeat are left out: there an
enabled shutter is open.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Protocol, runtime_checkable

from sim_instruments.faults.lasting import InterlockOpen, LastingFault, StuckOpen
from sim_instruments.instrument import Setting
from sim_instruments.wire.requests import LineInstrument
from sim_instruments.world.base import TriggerLine

IDENTITY = "THORLABS SC10 VERSION 1.07"
PROMPTS = {"blank": b"> ", "bare": b">"}
EXTERNAL = 5
SETTINGS = {
    "mode": (1, 5, 1),
    "trig": (0, 1, 0),
    "xto": (0, 1, 0),
    "rep": (1, 99, 1),
    "open": (1, 999_999, 200),
    "shut": (1, 999_999, 200),
    "baud": (0, 1, 0),
}
"""What can be set, from where to where, and at power-on; the durations of modes 2 to 4 in ms."""


class RefusedCommand(Exception):
    """A command that the controller does not take, with its word for why."""


@runtime_checkable
class PumpWorld(Protocol):
    """A world with pump light that a shutter blocks."""

    def pump(self, time_s: float, on: bool) -> None:
        """Let the light pass, or block it, from a time on."""


class ThorlabsSc10(LineInstrument):
    """The controller; its gate hangs on the world's `trigger`, its blade in the world's `pump`.

    Truth (`simulator` mapping): `opening_time` and `closing_time` (from the change of the gate or
    a command until the light is let through or blocked, which is when its sensor says so, too),
    `gate_inverter` (whether an inverter stands between the trigger and the gate). May be given:
    `errors: bare`, errors without `Command error` before them; `prompt: bare`, `>` without a blank.
    """

    model = "Thorlabs SC10"
    line_end = b"\r"

    lasting_faults: ClassVar = (StuckOpen.kind, InterlockOpen.kind)

    def __init__(self, setting: Setting) -> None:
        self._clock, self._faults = setting.clock, setting.faults
        self._opening_s = setting.truth.quantity("opening_time", "s")
        self._closing_s = setting.truth.quantity("closing_time", "s")
        self._inverter = setting.truth.switch("gate_inverter")
        self._light = setting.world.find(PumpWorld)
        self._wire = setting.world.find(TriggerLine) or TriggerLine()
        self._wire.listen(self._move_blade, self._move_blade)
        self._error = "" if setting.truth.text("errors", "worded") == "bare" else "Command error "
        self._prompt = PROMPTS[setting.truth.word("prompt", tuple(PROMPTS), "blank")]
        self._values = {name: at_power_on for name, (_, _, at_power_on) in SETTINGS.items()}
        self._stored = dict(self._values)
        self._commands: dict[str, Callable[[], str | None]] = {
            **dict.fromkeys(("id?", "*idn?"), lambda: IDENTITY),
            "ens?": lambda: str(int(self._enabled)),
            "closed?": lambda: str(int(self._is_closed(self._clock.now()))),
            "interlock?": lambda: str(int(self._tripped())),
            "ens": self._toggle,
            "?": lambda: "\r".join([*self._commands, *(f"{name}=" for name in SETTINGS)]),
            "save": self._store,
            "savp": self._store,
            "resp": self._load,
        }
        self._enabled = False
        self._open_since_s: float | None = None
        """From when on the light passes; None for a blade that is, or goes, before it."""
        self._moved_until_s = 0.0
        setting.faults.when_changed(StuckOpen.kind, self._changed)
        setting.faults.when_changed(InterlockOpen.kind, self._interlock_changed)
        self.begin_to_serve(setting)

    def energised(self) -> bool:
        """Return whether the light passes, or is about to."""
        return not self._is_closed(self._clock.now())

    def knows(self, command: str) -> bool:
        """Whether the controller has a command or a setting."""
        return command in self._commands or command.removesuffix("?") in SETTINGS

    # The blade.

    def _is_closed(self, time_s: float) -> bool:
        """Return whether the blade stands before the light; one that moves is where it was."""
        opened = self._open_since_s is not None
        return opened if time_s < self._moved_until_s else not opened

    def _wanted_open(self) -> bool:
        if not self._enabled:
            return False
        return self._values["mode"] != EXTERNAL or self._wire.high != self._inverter

    def _move_blade(self, time_s: float) -> None:
        """Move the blade to where it is wanted, from `time_s` on."""
        wanted = self._wanted_open()
        if wanted == (self._open_since_s is not None):
            return
        if not wanted and self._faults.now(StuckOpen.kind) is not None:
            return
        # A blade that is turned on its way passes the beam later than it would have.
        at_s = max(time_s, self._moved_until_s) + (self._opening_s if wanted else self._closing_s)
        self._open_since_s, self._moved_until_s = (at_s if wanted else None), at_s
        if self._light is not None:
            self._light.pump(at_s, wanted)

    def _changed(self, time_s: float, fault: LastingFault | None) -> None:
        self._move_blade(time_s)

    def _interlock_changed(self, time_s: float, fault: LastingFault | None) -> None:
        if fault is not None:
            self._enabled = False
        self._move_blade(time_s)

    # The commands.

    def _line(self, line: bytes) -> bytes:
        text = line.decode("ascii", "replace").strip()
        if not text:
            return b"\r" + self._prompt
        try:
            value = self._carry_out(text)
        except RefusedCommand as error:
            value = f"{self._error}{error}"
        parts = [text] if value is None else [text, value]
        return "\r".join([*parts, ""]).encode("ascii", "replace") + self._prompt

    def _carry_out(self, text: str) -> str | None:
        if text in self._commands:
            return self._commands[text]()
        name, equals, value = text.partition("=")
        if equals and name in SETTINGS:
            self._set(name, value)
            return None
        if text.removesuffix("?") in SETTINGS and text.endswith("?"):
            return str(self._values[text[:-1]])
        raise RefusedCommand("CMD_NOT_DEFINED")

    def _toggle(self) -> None:
        self._enabled = not self._enabled and not self._tripped()
        self._move_blade(self._clock.now())

    def _set(self, name: str, value: str) -> None:
        low, high, _ = SETTINGS[name]
        if not value.isdecimal() or not low <= int(value) <= high:
            raise RefusedCommand("CMD_ARG_INVALID")
        self._values[name] = int(value)
        self._move_blade(self._clock.now())

    def _store(self) -> None:
        self._stored = dict(self._values)

    def _load(self) -> None:
        self._values = dict(self._stored)
        self._move_blade(self._clock.now())

    def _tripped(self) -> bool:
        return self._faults.now(InterlockOpen.kind) is not None
