"""Watlow F4T controller of a thermal chamber, on Modbus TCP.

From the register list of the F4T manual (set-points, process value, control mode, alarms, limits,
digital inputs and outputs, identity) and of a chamber maker's (ramp action, scale and rate of the
set-point), and from a public client (exception 4 for an input or output that is not there, floats
with the low word first, states of alarms). Assumed: a set-point or a limit out of range is refused
with exception 3; a ramp that is switched off leaves the set-point at its target at once; an alarm
cuts heater and compressor by its relay; outputs can be written where their state is read; the clock
is set field by field. Profiles have a file of their own. Left out: cascade loops, function keys,
messages, control by the manual power (2784), which is only kept.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from itertools import product

from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.watlow.f4 import CLOCK, ControllerClock
from sim_instruments.watlow.f4t_profiles import ProfileRun, Profiles
from sim_instruments.watlow.plant import Plant, SetPoint, WatlowController
from sim_instruments.wire.modbus import (
    DEVICE_FAILURE,
    ILLEGAL_VALUE,
    ModbusError,
    ModbusTcpServer,
    Parameter,
    Registers,
    Words,
    chosen,
    fixed,
    shown,
)

UNIT = 1
HARDWARE_ID, RELEASE, BUILD = 124, 5, 1203
PART_NUMBER = "F4T1L1EAA1D1AAA"
OFF, ON, AUTO = 62, 63, 10
STATES = (OFF, ON)
CELSIUS, NONE, OK, SAFE = 15, 61, 138, 1667
ALARM_HIGH, ABSOLUTE_TEMPERATURE = 7, 1540
RAMP_STARTUP, RAMP_SET_POINT, RAMP_BOTH = 88, 85, 13
RAMPS = (OFF, RAMP_STARTUP, RAMP_SET_POINT, RAMP_BOTH)
SCALES_S = {57: 60.0, 39: 3600.0}
EVENTS = (16594, 16596, 16598, 16600, 16822, 16824, 16826, 16828)
FIRST_IO, PER_MODULE, PER_IO, MOST = 33718, 240, 40, 6
SWITCHES_DUT, SPARE, DOOR = "dut_power", "spare", "door"
WORD_ORDERS = ("low-first", "high-first")
LIMIT_REGISTERS = {11250: SAFE, 11264: OK, 11288: NONE}


class WatlowF4T(WatlowController):
    """The controller; its loop 1 moves the world's `chamber`, or one of its own.

    Truth (`simulator` mapping): what `Plant` needs; `word_order`; `set_point_low` and
    `set_point_high` as the chamber's maker left them; `alarms`, how many there are;
    `limit_modules`, where limit controllers sit; `outputs` and `inputs` by module and number
    (`"2.1"`): an output is `dut_power` or `spare`, an input `door` (on while it is closed) or
    `spare`; `events`: number to the output that it switches.
    """

    model = "Watlow F4T"
    protocol = "modbus-tcp"
    resource = "modbus-tcp://{host}:{port}"

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        self._clock, self._world = setting.clock, setting.world
        if not setting.serial.isdecimal():
            raise SimulationError(f"{truth.where}: the serial number of an F4T is a number")
        self._serial = int(setting.serial)
        self._low_first = truth.word("word_order", WORD_ORDERS) == WORD_ORDERS[0]
        self._low_degC = truth.quantity("set_point_low", "degC")
        self._high_degC = truth.quantity("set_point_high", "degC")
        self._plant = Plant(setting)
        self._set_point = SetPoint(setting, self._plant, self._plant.process_degC())
        self._mode, self._ramp_action, self._ramp_scale, self._ramp_rate = OFF, OFF, 57, 1.0
        self._manual_percent = 0.0
        self._run = ProfileRun(setting, self._set_point, self)
        self._profiles = Profiles(self._run, self._float, self._in_range)
        self._aside_degC = self._set_point.target_degC
        self._outputs: dict[str, bool] = {}
        self._uses: dict[str, str] = {}
        self._inputs: dict[str, str] = {}
        for key, states in (("outputs", self._uses), ("inputs", self._inputs)):
            for name in truth.raw(key) or {}:
                states[str(name)] = truth.section(key).text(name)
        self._events = dict.fromkeys(range(1, len(EVENTS) + 1), OFF)
        given = truth.raw("events") if "events" in truth else {}
        self._switched_by = {int(n): str(name) for n, name in given.items()}
        table = self._table(truth.integer("alarms", 0), truth.raw("limit_modules"))
        self._registers = Registers(table)
        self._server = ModbusTcpServer(setting, self._registers, UNIT)
        self._server.begin()

    # The registers.

    def _table(self, alarms: int, limit_modules: list[int]) -> dict[int, Parameter]:
        text, long, floating, plant = self._text, self._long, self._float, self._plant
        table = {
            0: long(HARDWARE_ID),
            4: long(RELEASE),
            8: long(BUILD),
            12: long(self._serial),
            16: text(PART_NUMBER, 15),
            46: text("F4T", 20),
            1328: fixed(CELSIUS),
            6730: fixed(CELSIUS),
            2730: chosen((OFF, AUTO), lambda: self._mode, self._set_mode),
            2774: floating(lambda: self._low_degC, partial(self._limit, "_low_degC")),
            2776: floating(lambda: self._high_degC, partial(self._limit, "_high_degC")),
            2782: floating(self._own_degC, self._aim),
            2784: floating(lambda: self._manual_percent, self._set_manual),
            2794: chosen(RAMPS, lambda: self._ramp_action, self._set_action),
            2796: chosen(SCALES_S, lambda: self._ramp_scale, self._set_scale),
            2798: floating(lambda: self._ramp_rate, self._set_rate),
            2808: floating(plant.output_percent),
            2810: floating(self._set_point.now_degC),
            2814: shown(lambda: self._mode),
            2820: floating(plant.process_degC),
            27586: floating(plant.process_degC),
            16536: fixed(ABSOLUTE_TEMPERATURE),
            **self._profiles.table(),
        }
        shows = ControllerClock(self._clock)
        for n, field in enumerate(CLOCK):
            table[14664 + 2 * n] = shows.field(field)
        for n in range(1, alarms + 1):
            table[1356 + 100 * (n - 1)] = shown(partial(self._alarm, n))
        for module in limit_modules:
            for address, well in LIMIT_REGISTERS.items():
                table[address + 60 * (module - 1)] = fixed(well)
        for n, address in enumerate(EVENTS, 1):
            event = partial(self._events.__getitem__, n), partial(self.set_event, n)
            table[address] = chosen(STATES, *event)
        for module, number in product(range(1, MOST + 1), repeat=2):
            name = f"{module}.{number}"
            at = FIRST_IO + PER_MODULE * (module - 1) + PER_IO * (number - 1)
            table[at] = Parameter(partial(self._state, name), partial(self._switch, name))
        return table

    @staticmethod
    def _text(text: str, size: int) -> Parameter:
        return fixed(*text.ljust(size, "\0").encode("ascii"))

    def _long(self, number: int) -> Parameter:
        return fixed(*self._ordered(struct.pack(">i", number)))

    def _float(
        self, give: Callable[[], float], take: Callable[[float], None] | None = None
    ) -> Parameter:
        def taken(words: Words) -> None:
            high, low = reversed(words) if self._low_first else words
            if take is not None:
                take(struct.unpack(">f", struct.pack(">HH", high, low))[0])

        return Parameter(
            lambda: self._ordered(struct.pack(">f", give())), taken if take else None, size=2
        )

    def _ordered(self, data: bytes) -> tuple[int, int]:
        high, low = struct.unpack(">HH", data)
        return (low, high) if self._low_first else (high, low)

    # The loop.

    def _limit(self, name: str, value_degC: float) -> None:
        limits = {"_low_degC": self._low_degC, "_high_degC": self._high_degC, name: value_degC}
        if not limits["_low_degC"] < limits["_high_degC"]:
            raise ModbusError(ILLEGAL_VALUE)
        setattr(self, name, value_degC)

    def _in_range(self, target_degC: float) -> bool:
        return self._low_degC <= target_degC <= self._high_degC

    def _aim(self, target_degC: float) -> None:
        if not self._in_range(target_degC):
            raise ModbusError(ILLEGAL_VALUE)
        if self._run.active:
            self._aside_degC = target_degC
        elif self._ramp_action in (RAMP_SET_POINT, RAMP_BOTH):
            self._ramp(target_degC, self._set_point.now_degC())
        else:
            self._set_point.jump(target_degC)

    def _ramp(self, target_degC: float, start_degC: float) -> None:
        rate_K_per_s = self._ramp_rate / SCALES_S[self._ramp_scale]
        self._set_point.ramp(target_degC, rate_K_per_s, start_degC)

    def _set_rate(self, rate: float) -> None:
        if not 0 <= rate <= 99999:
            raise ModbusError(ILLEGAL_VALUE)
        self._ramp_rate = rate
        self._go_on()

    def _set_manual(self, percent: float) -> None:
        if not -100 <= percent <= 100:
            raise ModbusError(ILLEGAL_VALUE)
        self._manual_percent = percent

    def _set_scale(self, scale: int) -> None:
        self._ramp_scale = scale
        self._go_on()

    def _set_action(self, action: int) -> None:
        self._ramp_action = action
        if action == OFF and not self._run.active:
            self._set_point.jump(self._set_point.target_degC)

    def _go_on(self) -> None:
        """Let a ramp that is under way go on at its new rate."""
        here_degC, target_degC = self._set_point.now_degC(), self._set_point.target_degC
        if self._run.active:
            return
        if self._ramp_action != OFF and here_degC != target_degC:
            self._ramp(target_degC, here_degC)

    def _set_mode(self, mode: int) -> None:
        before, self._mode = self._mode, mode
        ramps = not self._run.active
        if (
            ramps
            and before == OFF
            and mode == AUTO
            and self._ramp_action in (RAMP_STARTUP, RAMP_BOTH)
        ):
            self._ramp(self._set_point.target_degC, self._plant.process_degC())
        self._plant.control(mode == AUTO)

    # What a profile does with the loop.

    def _own_degC(self) -> float:
        """Return the set-point of the loop, which a profile leaves alone."""
        return self._aside_degC if self._run.active else self._set_point.target_degC

    def take_over(self) -> None:
        """Give the loop to a profile."""
        self._aside_degC, self._mode = self._set_point.target_degC, AUTO
        self._plant.control(True)

    def give_back(self, *, hold: bool) -> None:
        """Go on without the profile, at its set-point or at the loop's own."""
        self._set_point.jump(self._set_point.now_degC() if hold else self._aside_degC)

    def switch_off(self) -> None:
        """Switch the loop off."""
        self._set_mode(OFF)

    def set_event(self, number: int, state: int) -> None:
        """Set an event, and the output that it switches."""
        self._events[number] = state
        if number in self._switched_by:
            self._switch(self._switched_by[number], (state,))

    # States, inputs and outputs.

    def _alarm(self, number: int) -> int:
        return ALARM_HIGH if self._plant.alarm_is_on(number) else NONE

    def _state(self, name: str) -> Words:
        if name in self._inputs:
            on = self._inputs[name] == DOOR and not self._plant.door_is_open()
        elif name in self._uses:
            on = self._outputs.get(name, False)
        else:
            raise ModbusError(DEVICE_FAILURE)
        return (ON if on else OFF,)

    def _switch(self, name: str, words: Words) -> None:
        if name not in self._uses:
            raise ModbusError(ILLEGAL_VALUE if name in self._inputs else DEVICE_FAILURE)
        if words[0] not in STATES:
            raise ModbusError(ILLEGAL_VALUE)
        on = words[0] == ON
        self._outputs[name] = on
        if self._uses[name] == SWITCHES_DUT:
            self._world.power(self._clock.now(), on)
