"""Keysight E36312A triple-output DC supply, SCPI over TCP.

From the data sheet 5992-2124EN: 6 V and 5 A at output 1, 25 V and 1 A at outputs 2 and 3. From
public clients of the model: channel lists `(@1)` behind a comma, or behind the blank of a query,
`OUTP?` as 0 or 1, over-current protection that is a switch with a delay and no level of its own (it
trips where the output has been limiting its current for that long), trips that are read and cleared
by output, `VOLT:PROT:CLE`, `CURR:PROT:CLE` and `VOLT:PROT:STAT` by output, `VOLT? MAX,(@1)`,
`OUTP:PAIR OFF|PAR|SER` and `SENS:DLOG`. From the contents of the guide E36311-90008 (p. 38, 39):
`ABOR (@1)`, `ABOR:DLOG`, `APPL CH1|P6V,5,1` and its query.

Not confirmed, from the guides of older triple supplies (E3631A) and an extract of a third party:
`INST:SEL`, `INST:NSEL`, levels that wait for a trigger (`VOLT:TRIG`, `CURR:TRIG`, `INIT`,
`*TRG`), `SYST:REM|LOC|RWL`, `DISP:TEXT`, and that `STAT:QUES:INST:ISUM1:COND?` answers 1 while the
current is constant and 2 while the voltage is. Assumed, since no source at hand says it: what a
setting beyond the rating answers (-222), the form of numbers and that `APPL?` puts two in quotes,
that both protections end at 110 % of the rating, that an output without a channel list is the
selected one, 1 after `*RST`, the default delay, the bounds of the log, and that a tripped output
reads 0. A pair and the log are only kept: outputs stay apart, and no file is written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

from sim_instruments.faults.lasting import DeviceShorted
from sim_instruments.instrument import Setting
from sim_instruments.wire.scpi import ScpiError, boolean, choice, numeric, unquoted, within, word
from sim_instruments.wire.scpi_device import (
    KeptSettings,
    KeptTable,
    Listed,
    ScpiDevice,
    Value,
    kept,
)

RATINGS = {1: (6.0, 5.0), 2: (25.0, 1.0), 3: (25.0, 1.0)}
HEADROOM = 1.1
MAX_DELAY_S = 3600.0
ROOTS = ("", "SOURce:")
NAMES = {"CH1": 1, "P6V": 1, "CH2": 2, "P25V": 2, "CH3": 3, "N25V": 3}
BOUNDS = ("MIN", "MINIMUM", "MAX", "MAXIMUM", "DEF", "DEFAULT")
CONSTANT_CURRENT, CONSTANT_VOLTAGE = 1, 2
KEPT: KeptTable = {
    "OUTPut:PAIR": (word("OFF", "PARallel", "SERies"), "OFF"),
    "SENSe:DLOG:TIME": (within(1.0, 999_999.0, 30.0), 30.0),
    "SENSe:DLOG:PERiod": (within(0.2, 60.0, 0.2), 0.2),
    "TRIGger:DLOG:SOURce": (word("IMMediate", "BUS"), "IMM"),
    "TRIGger:SOURce": (word("IMMediate", "BUS"), "IMM"),
}


@runtime_checkable
class PoweredWorld(Protocol):
    """A world whose device can be switched on and off."""

    def power(self, time_s: float, on: bool) -> None:
        """Switch the device under test on or off."""


@dataclass
class Output:
    """One output with its settings, as after `*RST`: off, at 0 V."""

    rated_V: float
    rated_A: float
    voltage_V: float = 0.0
    current_A: float = 0.1
    protect_V: float = 0.0
    protects_voltage: bool = True
    logs_voltage: bool = True
    logs_current: bool = False
    waiting_V: float | None = None
    waiting_A: float | None = None
    protects_current: bool = False
    delay_s: float = 0.05
    on: bool = False
    over_current: bool = False
    over_voltage: bool = False
    limiting_since_s: float | None = None

    def __post_init__(self) -> None:
        self.protect_V = HEADROOM * self.rated_V


class KeysightE36312A(ScpiDevice):
    """The supply, one of whose outputs may feed the device of the world.

    Truth (`simulator` mapping): `feeds` (`1`, `2`, `3` or `nothing`); `resistance` of the device;
    `readback_gain_error` and `readback_offset` of the measured current. May be given:
    `own_limit: false`, an output that neither limits its current nor trips.
    """

    model = "Keysight E36312A"
    lasting_faults: ClassVar = (DeviceShorted.kind,)

    def __init__(self, setting: Setting) -> None:
        super().__init__(f"Keysight Technologies,E36312A,{setting.serial},2.1.0-1.0.4-1.12")
        truth = setting.truth
        self._clock, self._faults = setting.clock, setting.faults
        self._world = setting.world.find(PoweredWorld)
        feeds = truth.word("feeds", ("1", "2", "3", "nothing"))
        self._feeds = int(feeds) if feeds != "nothing" else 0
        self._device_ohm = truth.positive("resistance", "ohm")
        self._gain = 1.0 + truth.quantity("readback_gain_error", "1")
        self._offset_A = truth.quantity("readback_offset", "A")
        self._limits_itself = truth.switch("own_limit") if "own_limit" in truth else True
        self._powered = False
        self._switched_s = 0.0
        self._outputs: dict[int, Output] = {}
        self._kept = KeptSettings(KEPT)
        self._displayed, self._lit = "", True
        self.reset()
        self._add_all()
        self.begin_to_serve(setting)

    def energised(self) -> bool:
        """Whether an output is on."""
        self.before_each()
        return any(output.on for output in self._outputs.values())

    def reset(self) -> None:
        """Go to the state after `*RST`: all outputs off, at 0 V."""
        self._outputs = {number: Output(*rating) for number, rating in RATINGS.items()}
        self._kept.reset()
        self._selected, self._armed = 1, set[int]()
        self._power()

    def before_each(self) -> None:
        """Trip what has limited its current for longer than its delay."""
        now_s = self._clock.now()
        for number, output in self._outputs.items():
            beyond = output.voltage_V > output.protect_V
            if output.on and output.protects_voltage and beyond:
                output.on, output.over_voltage = False, True
            if not (
                output.on and self._limits_itself and self._wanted_A(number) > output.current_A
            ):
                output.limiting_since_s = None
                continue
            if output.limiting_since_s is None:
                output.limiting_since_s = self._began_s(now_s)
            if output.protects_current and now_s - output.limiting_since_s >= output.delay_s:
                output.on, output.over_current = False, True
        self._power()

    def _began_s(self, now_s: float) -> float:
        """Return when limiting began: with the short where there is one, else with this look."""
        short = self._faults.now(DeviceShorted.kind)
        return now_s if short is None else max(short.begin_s, self._switched_s)

    def _wanted_A(self, number: int) -> float:
        if number != self._feeds:
            return 0.0
        short = self._faults.now(DeviceShorted.kind)
        ohm = short.resistance_ohm if isinstance(short, DeviceShorted) else self._device_ohm
        return self._outputs[number].voltage_V / ohm

    def _flows(self, number: int) -> tuple[float, float]:
        """Return what an output gives, in V and A."""
        output = self._outputs[number]
        if not output.on:
            return 0.0, 0.0
        wanted_A = self._wanted_A(number)
        if self._limits_itself and wanted_A > output.current_A:
            return output.voltage_V * output.current_A / wanted_A, output.current_A
        return output.voltage_V, wanted_A

    def _power(self) -> None:
        on = bool(self._feeds) and self._outputs[self._feeds].on
        if on != self._powered:
            self._powered = on
            if self._world is not None:
                self._world.power(self._clock.now(), on)

    # Commands.

    def _add_all(self) -> None:
        level, dc = "[:LEVel][:IMMediate][:AMPlitude]", "MEASure[:SCALar]{}[:DC]"
        self.add_commands(
            {
                f"VOLTage{level}": self._held("voltage_V", up_to(lambda o: o.rated_V)),
                f"CURRent{level}": self._held("current_A", up_to(lambda o: o.rated_A)),
                "VOLTage:PROTection[:LEVel]": self._held(
                    "protect_V", up_to(lambda o: HEADROOM * o.rated_V)
                ),
                "VOLTage:PROTection:TRIPped": Listed(None, self._shown("over_voltage")),
                "CURRent:PROTection:DELay[:TIME]": self._held(
                    "delay_s", up_to(lambda _: MAX_DELAY_S)
                ),
                "CURRent:PROTection:STATe": self._held(
                    "protects_current", lambda _, text: boolean(text)
                ),
                "CURRent:PROTection:TRIPped": Listed(None, self._shown("over_current")),
            },
            *ROOTS,
            after=self.before_each,
        )
        self.add_commands(
            {
                "OUTPut[:STATe]": self._held("on", self._goes_on),
                "OUTPut:PROTection:CLEar": Listed(self._clear_trips),
                dc.format("[:VOLTage]"): Listed(None, self._each(lambda n: self._flows(n)[0])),
                dc.format(":CURRent"): Listed(None, self._each(self._measured_A)),
            },
            after=self.before_each,
        )

        self.add_commands(self._pending(), after=self.before_each)
        self.add_commands(self._kept.commands())
        self.add_commands(self._weakly_known())
        for number in RATINGS:
            condition = {"CONDition?": lambda number=number: self._regulates(number)}
            self.add_commands(condition, f"STATus:QUEStionable:INSTrument:ISUMmary{number}:")

    def _pending(self) -> dict[str, Value]:
        """Return what acts on several settings at once, and the levels that wait for a trigger."""
        level = "[:LEVel]:TRIGgered[:AMPlitude]"
        return {
            "APPLy": Listed(self._apply, self._applied),
            "ABORt": Listed(lambda given: self._armed.difference_update(self._listed(given))),
            "ABORt:DLOG": lambda: None,
            "INITiate:DLOG": Listed(self._begin_log),
            "INITiate[:IMMediate][:TRANsient]": Listed(self._arm),
            "*TRG": self._trigger,
            f"VOLTage{level}": self._held("waiting_V", up_to(lambda o: o.rated_V)),
            f"CURRent{level}": self._held("waiting_A", up_to(lambda o: o.rated_A)),
            "VOLTage:PROTection:CLEar": Listed(self._clearing("over_voltage")),
            "CURRent:PROTection:CLEar": Listed(self._clearing("over_current")),
            "VOLTage:PROTection:STATe": self._held(
                "protects_voltage", lambda _, text: boolean(text)
            ),
            "SENSe:DLOG:FUNCtion:VOLTage": self._held(
                "logs_voltage", lambda _, text: boolean(text)
            ),
            "SENSe:DLOG:FUNCtion:CURRent": self._held(
                "logs_current", lambda _, text: boolean(text)
            ),
        }

    def _weakly_known(self) -> dict[str, Value]:
        """Return the commands that a third party's extract alone has for this model."""
        return {
            "INSTrument[:SELect]": (
                lambda text: self._select(named(text)),
                lambda: f"CH{self._selected}",
            ),
            "INSTrument:NSELect": (
                lambda text: self._select(round(numeric(text, 1, 3, 1))),
                lambda: self._selected,
            ),
            **{f"SYSTem:{mode}": lambda: None for mode in ("REMote", "LOCal", "RWLock")},
            "DISPlay[:STATe]": kept(self, "_lit", boolean),
            "DISPlay:TEXT[:DATA]": (self._display, lambda: f'"{self._displayed}"'),
            "DISPlay:TEXT:CLEar": lambda: self._display('""'),
        }

    def _held(self, name: str, read: Callable[[Output, str], float]) -> Listed:
        """Return a setting of each output of a channel list; MIN, MAX and DEF may be asked for."""

        def take(parameters: list[str]) -> None:
            if not parameters:
                raise ScpiError(-109)
            for number in self._listed(parameters[1:]):
                output = self._outputs[number]
                setattr(output, name, read(output, parameters[0]))

        def give(parameters: list[str]) -> str:
            if parameters and parameters[0].upper() in BOUNDS:
                numbers = self._listed(parameters[1:])
                return self._answers(read(self._outputs[n], parameters[0]) for n in numbers)
            return self._shown(name)(parameters)

        return Listed(take, give)

    def _shown(self, name: str) -> Callable[[list[str]], str]:
        def give(number: int) -> float:
            value = getattr(self._outputs[number], name)
            # A level that waits for nothing is the present one.
            present = {"waiting_V": "voltage_V", "waiting_A": "current_A"}.get(name, name)
            return float(getattr(self._outputs[number], present)) if value is None else value

        return self._each(give)

    def _each(self, give: Callable[[int], float]) -> Callable[[list[str]], str]:
        """Return a query that answers for each output of its channel list."""
        return lambda given: self._answers(give(number) for number in self._listed(given))

    def _answers(self, values: Iterable[float]) -> str:
        return ",".join(map(self.written, values))

    def _listed(self, parameters: list[str]) -> list[int]:
        return listed(parameters) or [self._selected]

    def _select(self, number: int) -> None:
        self._selected = number

    def _display(self, text: str) -> None:
        self._displayed = unquoted(text)

    def _apply(self, parameters: list[str]) -> None:
        if not parameters:
            raise ScpiError(-109)
        if len(parameters) > 3:
            raise ScpiError(-108)
        number = named(parameters[0])
        output, fresh = self._outputs[number], Output(*RATINGS[number])
        wanted = [output.voltage_V, output.current_A]
        bounds = ((fresh.rated_V, fresh.voltage_V), (fresh.rated_A, fresh.current_A))
        for k, text in enumerate(parameters[1:]):
            wanted[k] = numeric(text, 0.0, *bounds[k])
        output.voltage_V, output.current_A = wanted

    def _applied(self, parameters: list[str]) -> str:
        number = named(self.only(parameters)) if parameters else self._selected
        output = self._outputs[number]
        return f'"{self._answers((output.voltage_V, output.current_A))}"'

    def _begin_log(self, parameters: list[str]) -> None:
        unquoted(self.only(parameters))

    def _arm(self, parameters: list[str]) -> None:
        self._armed.update(self._listed(parameters))
        if self._kept.values["TRIGger:SOURce"] == "IMM":
            self._trigger()

    def _trigger(self) -> None:
        if not self._armed:
            raise ScpiError(-211)
        for output in (self._outputs[number] for number in self._armed):
            if output.waiting_V is not None:
                output.voltage_V = output.waiting_V
            if output.waiting_A is not None:
                output.current_A = output.waiting_A
            output.waiting_V = output.waiting_A = None
        self._armed.clear()

    def _clearing(self, trip: str) -> Callable[[list[str]], None]:
        def clear(parameters: list[str]) -> None:
            for number in self._listed(parameters):
                setattr(self._outputs[number], trip, False)

        return clear

    def _regulates(self, number: int) -> int:
        output = self._outputs[number]
        if not output.on:
            return 0
        limits = self._limits_itself and self._wanted_A(number) > output.current_A
        return CONSTANT_CURRENT if limits else CONSTANT_VOLTAGE

    def _measured_A(self, number: int) -> float:
        return self._gain * self._flows(number)[1] + self._offset_A

    def _goes_on(self, output: Output, text: str) -> bool:
        on = boolean(text) and not (output.over_current or output.over_voltage)
        if on and not output.on:
            self._switched_s = self._clock.now()
        return on

    def _clear_trips(self, parameters: list[str]) -> None:
        for number in self._listed(parameters):
            self._outputs[number].over_current = self._outputs[number].over_voltage = False


def up_to(largest: Callable[[Output], float]) -> Callable[[Output, str], float]:
    """Return what reads a number from zero to what an output can."""
    return lambda output, text: numeric(text, 0.0, largest(output), 0.0)


def named(text: str) -> int:
    """Return the number of an output by one of its names; ScpiError -224 where it is none."""
    return int(choice(text, {name: str(number) for name, number in NAMES.items()}))


def listed(parameters: list[str]) -> list[int]:
    """Return the outputs of a channel list, none without one; ScpiError where it is none."""
    text = ",".join(parameters).replace(" ", "")
    if not text:
        return []
    if not (text.startswith("(@") and text.endswith(")")):
        raise ScpiError(-108)
    numbers: list[int] = []
    for part in text[2:-1].split(","):
        first, _, last = part.partition(":")
        if not (first.isdigit() and (last or first).isdigit()):
            raise ScpiError(-102)
        numbers += range(int(first), int(last or first) + 1)
    if not numbers or not set(numbers) <= set(RATINGS):
        raise ScpiError(-222)
    return numbers
