"""Kepco BOP 36-12 bipolar supply with the BIT 802E interface card, on its raw TCP port.

From the manuals of the card family (BIT 4886, 243-1303; the 802E speaks the same commands over
LAN) and, where those were not at hand, of the BOP 1KW family: the limit and protection commands.
What no source at hand says, and is assumed: set points are refused with -221 while a list runs;
a list may be armed with the output off; protection cannot be set below 1 % of the rating. The full
test DIAG:TST? (BIT 4886 manual, table A-4: 0 where all passes) is refused while a list runs, which
is assumed; that it drives the output to both ends of its range is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from sim_instruments.faults.lasting import (
    ComesBack,
    Compliance,
    Frozen,
    LastingFault,
    Lies,
    ListRefused,
    Overdrive,
)
from sim_instruments.instrument import Setting
from sim_instruments.kepco.output import KINDS, Output, extremes, limit_commands, scientific
from sim_instruments.kepco.output_list import ListMemory, list_commands
from sim_instruments.wire.scpi import (
    ScpiError,
    boolean,
    choice,
    number,
    number_or,
    single_parameter,
    words,
)
from sim_instruments.wire.scpi import whole_number as whole
from sim_instruments.wire.scpi_device import Listed, ScpiDevice, Value

MAX_MESSAGE = 253
ROOTS = ("", "SOURce:")
LIST_ROOTS = ("LIST:", "SOURce:LIST:")
LEVEL = "[:LEVel][:IMMediate][:AMPlitude]"
FILTER_S = 0.005
TRANSIENT = ("TRAN", "TRANSIENT")
RANGES = (1, 4)


class KepcoBop(ScpiDevice):
    """One supply, driving one coil of the simulated world.

    Truth (`simulator` mapping): `coil` (x, y, z), `gain_error` and `offset` of the output,
    `readback_gain_error`, `readback_offset`, `readback_noise`, `time_base_error` of the list. May
    be given: `identity`, the form of the answer to `*IDN?`; `current_loop: true`, the coil follows
    as the supply's loop drives it and not with its own time constant; `command_time`, how long
    after a message its answer goes out, 25 ms unless given, as public clients of a BIT 802E wait;
    `telnet: true`, each message is echoed; `current_limit: false`, a card without `CURR:LIM`;
    `own_limit_broken: true`, limits that are shown and hold nothing; `output_stays_on: true`, a
    contact that does not open, unseen.
    """

    model = "Kepco BOP 36-12"
    identities: ClassVar[Mapping[str, str]] = {
        "lan": "KEPCO,BIT 802E 36-12,{serial},1.15-1.80",
        "blanks": "KEPCO, BIT 4886 36-12 {serial} 1.8-1.8",
        "date-after-serial": "KEPCO, BIT4886-6 36-12, {serial} 11/10/98, 1.81-1.81.",
        "date-before-serial": "KEPCO,BIT 4886 36-12  08-04-2023,{serial},4.04-1.82",
    }
    """As answered by real units and printed in the manuals."""
    command_s: ClassVar[float] = 0.025
    """How long after a message its answer goes out."""
    output_stage: ClassVar[type[Output]] = Output

    lasting_faults: ClassVar = (
        Frozen.kind,
        Compliance.kind,
        ListRefused.kind,
        Overdrive.kind,
        Lies.kind,
        ComesBack.kind,
    )

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        form = truth.word("identity", self.identities, next(iter(self.identities)))
        super().__init__(self.identities[form].format(serial=setting.serial))
        self._clock, self._rng = setting.clock, setting.rng
        self.busy_s = truth.quantity("command_time", "s", self.command_s)
        self._echoes = truth.switch("telnet")
        self._output = self.output_stage(setting.world.coil(truth.text("coil")), truth)
        self._stretch = 1.0 + truth.quantity("time_base_error", "1")
        self._read_gain = 1.0 + truth.quantity("readback_gain_error", "1")
        self._read_offset_A = truth.quantity("readback_offset", "A")
        self._read_noise_A = truth.quantity("readback_noise", "A")
        self._shown = {"CURR": 0.0, "VOLT": 0.0}
        self._faults = setting.faults
        self._faults.when_changed(Compliance.kind, self._sag)
        self._faults.when_changed(Overdrive.kind, self._overdrive)
        self._list = ListMemory()
        self._end_list()
        self._transient_s = 0.0
        self._came_back = 0
        self._add_source()
        limited = truth.text("current_limit", "true").lower() != "false"
        limits = limit_commands(self._output, self._apply_limits, limited=limited)
        self.add_commands(limits, *ROOTS)
        self.add_commands(self._list_commands(), *LIST_ROOTS, before=self._not_in_a_list)
        self.begin_to_serve(setting)

    def energised(self) -> bool:
        """Return whether the output is on."""
        return self._output.on

    def operation_condition(self) -> int:
        """Return bit 8 constant voltage, bit 10 constant current, bit 14 list running."""
        if self._lies():
            return 0
        register = 16384 if self._list_runs() else 0
        if self._output.on:
            register |= 256 if self._output.in_voltage_mode(self._clock.now()) else 1024
        return register

    def questionable_condition(self) -> int:
        """Return bit 12 voltage protection, bit 13 current protection."""
        return self._output.tripped

    def reset(self) -> None:
        """Go to voltage mode, zero, output off, with an empty list."""
        self._list.clear()
        self._end_list()
        self._output.reset(self._clock.now())

    def before_each(self) -> None:
        """End a list or transient whose time is over: the mode is then FIX again."""
        if self._clock.now() >= self._ends_s:
            self._end_list()

    def _end_list(self) -> None:
        self._mode = {"CURR": "FIX", "VOLT": "FIX"}
        self._ends_s = np.inf

    def _line(self, line: bytes) -> bytes:
        answer = self._answered(line)
        return line.rstrip(b"\r") + b"\r\n" + answer if self._echoes else answer

    def _answered(self, line: bytes) -> bytes:
        if len(line.rstrip(b"\r")) > MAX_MESSAGE:
            return self._too_long()
        reply = self.execute(line.decode("ascii", "replace").strip())
        if reply is None:
            return b""
        if len(reply) > MAX_MESSAGE:
            self.refuse(-400)
            return b""
        return reply.encode("ascii") + b"\n"

    def _list_commands(self) -> dict[str, Value]:
        """Return the LIST subsystem; its commands, not its queries, wait for the end of a list."""
        return list_commands(self._list, self._output)

    def _leave_list(self, now_s: float) -> None:
        """Go from a list to the fixed set point."""
        self._output.hold(now_s)

    def _add_source(self) -> None:
        output = self._output
        self.add_commands(
            {
                "OUTPut[:STATe]": Listed(self._set_output),
                "OUTPut[:STATe]?": lambda: output.on and not self._lies(),
                "MEASure[:SCALar]:CURRent[:DC]?": self._measure_current,
                "MEASure[:SCALar]:VOLTage[:DC]?": self._measure_voltage,
                "DIAGnostic:TST?": self._test,
                # Over LAN the card is always in remote; the command changes nothing.
                "SYSTem:REMote": (self._set_remote, None),
            }
        )
        mode = (self._set_function, lambda: output.mode == "CURR")
        self.add_commands({"FUNCtion:MODE": mode}, *ROOTS)
        for kind, word in KINDS.items():
            self.add_commands(self._level_commands(kind), *(f"{root}{word}" for root in ROOTS))

    def _level_commands(self, kind: str) -> dict[str, Value]:
        output = self._output
        return {
            LEVEL: (partial(self._set_level, kind), None),
            f"{LEVEL}?": Listed(None, partial(self._show_level, kind)),
            ":MODE": Listed(partial(self._set_mode, kind)),
            ":MODE?": lambda: self._mode[kind],
            ":RANGe": (partial(self._set_range, kind), lambda: output.ranges[kind]),
            ":RANGe:AUTO": (partial(self._set_auto, kind), lambda: output.auto[kind]),
        }

    def _apply_limits(self, kind: str) -> None:
        self._output.apply_limits(self._clock.now(), kind, self._list_runs())

    def _not_in_a_list(self) -> None:
        """Refuse what cannot be while a list runs."""
        if self._list_runs():
            raise ScpiError(-221)

    def _list_runs(self) -> bool:
        self.before_each()
        return "LIST" in self._mode.values()

    def _test(self) -> str:
        self._not_in_a_list()
        return "0"

    def _set_remote(self, text: str) -> None:
        boolean(text)

    def _set_output(self, parameters: list[str]) -> None:
        on = boolean(single_parameter(parameters))
        if self._lies():
            return
        now_s = self._clock.now()
        fault = self._faults.now(ComesBack.kind)
        if isinstance(fault, ComesBack) and self._output.on and not on:
            self._come_back(now_s, fault)
        if not on:
            self._end_list()
        self._output.switch(now_s, on)

    def _lies(self) -> bool:
        return self._faults.now(Lies.kind) is not None

    def _come_back(self, now_s: float, fault: ComesBack) -> None:
        if self._came_back < fault.times:
            self._came_back += 1

            def switch_on(time_s: float) -> None:
                self._output.switch(time_s, True)
                self._output.set_level(time_s, "CURR", fault.current_A)

            self._faults.later(now_s + fault.after_s, switch_on)

    def _set_function(self, text: str) -> None:
        mode = choice(text, words("VOLTage", "CURRent"))
        self._not_in_a_list()
        self._output.set_mode(self._clock.now(), mode)

    def _set_level(self, kind: str, text: str) -> None:
        if self._lies():
            return
        self._not_in_a_list()
        value = number_or(text, extremes(*self._output.allowed(kind)))
        now = self._clock.now()
        if self._mode[kind] == "TRAN" and not np.isfinite(self._ends_s):
            self._ends_s = now + self._transient_s
            self._output.pulse(now, kind, value, self._ends_s)
        else:
            self._output.set_level(now, kind, value)

    def _show_level(self, kind: str, parameters: list[str]) -> str:
        if not parameters:
            return scientific(0.0 if self._lies() else self._output.levels[kind])
        _, high = self._output.allowed(kind)
        shown = extremes(-self._output.limits[kind, "NEG"], high)
        word = single_parameter(parameters).upper()
        if word not in shown:
            raise ScpiError(-224)
        return scientific(shown[word])

    def _set_mode(self, kind: str, parameters: list[str]) -> None:
        if not parameters:
            raise ScpiError(-109)
        if self._lies():
            return
        # The duration of a transient follows after a blank or a comma.
        given = " ".join(parameters).split()
        now = self._clock.now()
        if given[0].upper() in TRANSIENT:
            seconds = number(single_parameter(given[1:]))
            if not 0.035 <= seconds <= 1.0:
                raise ScpiError(-222)
            self._not_in_a_list()
            self._transient_s, self._mode[kind] = seconds, "TRAN"
            return
        mode = choice(single_parameter(given), words("FIXed", "LIST"))
        if mode == "FIX":
            if self._mode[kind] != "FIX":
                self._mode[kind], self._ends_s = "FIX", np.inf
                self._leave_list(now)
            return
        refused = self._faults.now(ListRefused.kind) is not None
        if refused or self._list_runs() or self._output.mode != kind:
            raise ScpiError(-221)
        passes = [
            (levels, dwells * self._stretch, cycles)
            for levels, dwells, cycles in self._list.passes(kind)
        ]
        self._ends_s = self._output.run(now, passes)
        self._mode[kind] = "LIST"

    def _set_range(self, kind: str, text: str) -> None:
        value = whole(text, 1, 4)
        if value not in RANGES:
            raise ScpiError(-224)
        self._output.set_range(self._clock.now(), kind, value, self._list_runs())

    def _set_auto(self, kind: str, text: str) -> None:
        self._output.auto[kind] = boolean(text)

    def _measure_current(self) -> str:
        now = self._clock.now()
        true_A = self._output.coil.recent_mean(now - FILTER_S, now)
        if self._output.contact_sticks and not self._output.on:
            true_A = 0.0  # its shunt is on the other side of the contact
        if self._lies():
            true_A = 0.0
        noise_A = self._read_noise_A * float(self._rng.standard_normal())
        return self._show("CURR", true_A * self._read_gain + self._read_offset_A + noise_A)

    def _measure_voltage(self) -> str:
        now = self._clock.now()
        coil = self._output.coil
        true_V = coil.mean_level(now - FILTER_S, now) * coil.resistance_ohm
        # The voltmeter is the same converter behind the same filter: its noise scales with range.
        noise_V = self._read_noise_A * self._output.rated["VOLT"] / self._output.rated["CURR"]
        return self._show("VOLT", true_V + noise_V * float(self._rng.standard_normal()))

    def _show(self, kind: str, value: float) -> str:
        if self._faults.now(Frozen.kind) is None:
            self._shown[kind] = value
        return scientific(self._shown[kind])

    def _sag(self, time_s: float, fault: LastingFault | None) -> None:
        volts = fault.voltage_V if isinstance(fault, Compliance) else np.inf
        self._output.sag(time_s, volts)

    def _overdrive(self, time_s: float, fault: LastingFault | None) -> None:
        factor = fault.factor if isinstance(fault, Overdrive) else 1.0
        self._output.overdrive(time_s, factor)
