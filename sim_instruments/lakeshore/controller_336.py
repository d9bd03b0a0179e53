"""Lake Shore 336 temperature controller with the oven of the vapour cell, over TCP.

From the manuals of the 335 and 350 and the maker's public client: LF ends a message, CR LF a reply;
commands are joined by `;`, and a colon may stand before each; replies are joined by `;`; `*ESR?`
has the bits of IEEE 488.2; forms of numbers; `TLIMIT` in kelvin, zero for none, switches every
output off; a range of outputs 1 and 2 is 0 to 3, a ramp 0.1 to 100 K/min; the bits of `RDGST?` and
the codes of `HTRST?`. Assumed, since no source at hand says it: `SETP?` reads where a ramp stands;
a ramp begins where the set-point stands, heater on or off; the ranges are decades; percent are
those of power; the power in percent is P (e + I/1000 of the integral of e), e in K, without windup;
the loop acts twice a second; a reading below or above what its curve has, or of an open sensor, is
zero; a heater in a loop without a reading gets no power; what changes an output or an input that
nothing hangs at is kept and does no more; an open heater switches its output off; alarms are held
against the reading in kelvin whenever a message comes; least and largest reading are those that
were looked at; an input without a curve reads zero kelvin, as does one beyond its curve; the
maker's curves other than that of the platinum sensor, curve 6, are taken for it; a zone has the
terms, the input and, where it is not zero, the range of output 1. Autotuning, a zone's manual power
and ramp, the voltage of a diode and options (thermocouples, further inputs) are left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import ClassVar

from sim_instruments.faults.lasting import HeaterBroken, LastingFault, SensorOpen
from sim_instruments.instrument import Setting
from sim_instruments.lakeshore.controller_336_settings import (
    EXECUTION_ERROR,
    SETTINGS,
    USER_CURVES,
    ZERO_DEGC_K,
    Curves,
    RefusedCommand,
    Settings,
    float_of,
)
from sim_instruments.wire.requests import LineInstrument
from sim_instruments.world.serf_oven import Oven

FIRMWARE = "2.9"
COMMAND = re.compile(r":?\s*(\*?[A-Za-z]+\??)[ ,]*(.*)")
INPUTS, OUTPUTS = "ABCD", "1234"
KELVIN, CELSIUS = 1, 2
OPERATION_COMPLETE, COMMAND_ERROR, POWER_ON = 1, 32, 128
INVALID, SENSOR_OPEN = 1, 128
SHARE = {"0": 0.0, "1": 0.01, "2": 0.1, "3": 1.0}
"""Of the full power, by range."""
STEP_S = 0.5
CLOSED_LOOP, ZONES, OPEN_LOOP, MONITOR = "1", "2", "3", "4"
DEFAULTS: dict[str, tuple[str, str]] = {
    "OUTMODE": (OUTPUTS, "1,1,0"),
    "PID": (OUTPUTS, "+0050.0,+0020.0,+000.00"),
    "HTRSET": (OUTPUTS, "1,2,+1.414,2"),
    "MOUT": (OUTPUTS, "+000.00"),
    "INTYPE": (INPUTS, "2,1,0,1,2"),
    "FILTER": (INPUTS, "0,08,02"),
}
"""By command what it concerns, and its values at first: no more than kept, but for some."""


class Lakeshore336(LineInstrument):
    """The controller: its output 1 heats an oven, the world's if any; its input A has the sensor.

    Truth (`simulator` mapping): `full_power` of the heater, `sensor_error`, what the sensor reads
    too much, and `noise` of a reading. May be given: `unit: kelvin` of the input.
    """

    model = "Lake Shore 336"
    resource = "TCPIP::{host}::{port}::SOCKET"
    lasting_faults: ClassVar = (SensorOpen.kind, HeaterBroken.kind)

    def __init__(self, setting: Setting) -> None:
        self._clock, self._rng, self._faults = setting.clock, setting.rng, setting.faults
        self._identity = f"LSCI,MODEL336,{setting.serial}/#######,{FIRMWARE}"
        truth = setting.truth
        self._full_W = truth.positive("full_power", "W")
        self._error_K = truth.quantity("sensor_error", "K")
        self._noise_K = truth.quantity("noise", "K")
        self._oven = setting.world.find(Oven) or Oven()
        self._kept = {
            name: dict.fromkeys(places, value) for name, (places, value) in DEFAULTS.items()
        }
        if truth.word("unit", ("kelvin", "celsius"), "celsius") == "kelvin":
            self._kept["INTYPE"]["A"] = "2,1,0,1,1"
        self._range = dict.fromkeys(OUTPUTS, "0")
        self._limit_K = dict.fromkeys(INPUTS, 0.0)
        self._ramp = dict.fromkeys(OUTPUTS, (False, 0.1))
        # Of each set-point, in degC: when it began to go, from where, and to where.
        self._way = dict.fromkeys(OUTPUTS, (0.0, -ZERO_DEGC_K, -ZERO_DEGC_K))
        self._integral = self._percent = 0.0
        self._stepped_s = self._clock.now()
        self._settings, self._curves = Settings(), Curves()
        # Of each input, in kelvin: the least and the largest reading that was looked at.
        self._extremes: dict[str, tuple[float, float]] = {}
        self._alarms = dict.fromkeys(INPUTS, (False, False))
        self._event = POWER_ON
        self._enabled = {"*ESE": 0, "*SRE": 0}
        self._commands: dict[str, Callable[[str], str | None]] = {
            "*IDN?": lambda _: self._identity,
            "*ESR?": self._take_event,
            "*CLS": self._clear,
            "*OPC": self._complete,
            "*OPC?": lambda _: "1",
            "*STB?": lambda _: f"{32 * bool(self._event & self._enabled['*ESE']):03d}",
            "*TST?": lambda _: "0",
            "CRDG?": lambda text: self._readings(text, 0.0),
            "KRDG?": lambda text: self._readings(text, ZERO_DEGC_K),
            "SRDG?": self._sensors,
            "MDAT?": self._least_and_largest,
            "MNMXRST": lambda _: self._extremes.clear(),
            "ALARMST?": lambda text: ",".join(str(int(on)) for on in self._alarm_of(text)),
            "ALMRST": self._forget_alarms,
            "RELAYST?": lambda text: str(int(self._relay(one_of("12", text)))),
            "AOUT?": lambda text: f"{self._analog(one_of('34', text)):+07.2f}",
            "CRVHDR": self._curves.put_header,
            "CRVHDR?": self._curves.header,
            "CRVPT": self._curves.put_point,
            "CRVPT?": self._curves.point,
            "CRVDEL": self._curves.delete,
            "OPST?": lambda _: f"{self._operation():03d}",
            "OPSTR?": lambda _: f"{self._operation():03d}",
            "TUNEST?": lambda _: "0,1,0,0",
            "NETID?": self._network,
            "RDGST?": lambda text: f"{self._reading(one_of(INPUTS, text))[1]:03d}",
            "SETP": self._set_point,
            "SETP?": lambda text: f"{self._shown_set_point(one_of(OUTPUTS, text)):+.4f}",
            "RAMP": self._set_ramp,
            "RAMP?": lambda text: self._shown_ramp(one_of(OUTPUTS, text)),
            "RAMPST?": lambda text: str(int(self._goes(one_of(OUTPUTS, text)))),
            "RANGE": self._set_range,
            "RANGE?": lambda text: self._range[one_of(OUTPUTS, text)],
            "HTR?": lambda text: f"{self._power(one_of('12', text)):+06.1f}",
            "HTRST?": lambda text: str(int(self._broken(one_of("12", text)))),
            "TLIMIT": self._set_limit,
            "TLIMIT?": lambda text: f"{self._limit_K[one_of(INPUTS, text)]:+07.1f}",
        }
        self._oven.drive(self._advance)
        setting.faults.when_changed(HeaterBroken.kind, self._heater_changed)
        self.begin_to_serve(setting)

    def energised(self) -> bool:
        """Return whether an output may heat."""
        self._advance(self._clock.now())
        return any(value != "0" for value in self._range.values())

    def knows(self, command: str) -> bool:
        """Whether the controller has every command of a message."""
        names = [COMMAND.fullmatch(part.strip()) for part in command.split(";")]
        return all(match is not None and self._find(match[1]) is not None for match in names)

    # The loop.

    def _advance(self, to_s: float) -> None:
        """Bring the loop, and the heat that it gives, up to a time; never beyond now."""
        to_s = min(to_s, self._clock.now())
        if self._range["1"] == "0":
            self._stepped_s = max(self._stepped_s, to_s)
            return
        while self._stepped_s + STEP_S <= to_s:
            self._stepped_s += STEP_S
            self._act(self._stepped_s)
            if self._range["1"] == "0":
                self._stepped_s = to_s

    def _act(self, time_s: float) -> None:
        """Look at the sensor and set the power."""
        here_degC = self._sensed_degC(time_s)
        limit_K = self._limit_K["A"]
        if here_degC is not None and 0.0 < limit_K < here_degC + ZERO_DEGC_K:
            self._off(time_s)
            return
        mode, source, _ = self._kept["OUTMODE"]["1"].split(",")
        zone = self._zone(time_s) if mode == ZONES else None
        source = source if zone is None else zone[6]
        if here_degC is None or source != "1" or (mode != CLOSED_LOOP and zone is None):
            self._heat(time_s, 0.0)
            return
        if zone is not None and zone[5] != "0":
            self._range["1"] = zone[5]
        terms = self._kept["PID"]["1"].split(",") if zone is None else zone[1:4]
        gain, integral, _ = (float(part) for part in terms)
        error_K = self._set_point_degC("1", time_s) - here_degC
        summed = self._integral + integral / 1000.0 * error_K * STEP_S
        wanted = gain * (error_K + summed)
        if 0.0 <= wanted <= 100.0 or abs(summed) < abs(self._integral):
            self._integral = summed
        self._heat(time_s, min(max(wanted, 0.0), 100.0))

    def _zone(self, time_s: float) -> list[str] | None:
        """Return the row of the zone that the set-point of output 1 lies in, None for none."""
        wanted_K = self._set_point_degC("1", time_s) + ZERO_DEGC_K
        rows = [self._settings.values("ZONE", "1", str(number)) for number in range(1, 11)]
        return next((row for row in rows if wanted_K <= float(row[0])), None)

    def _heat(self, time_s: float, percent: float) -> None:
        self._percent = percent
        full_W = self._full_W * SHARE[self._range["1"]]
        self._oven.heat(time_s, 0.01 * percent * full_W)

    def _off(self, time_s: float) -> None:
        """Switch every output off."""
        self._range = dict.fromkeys(OUTPUTS, "0")
        self._integral = 0.0
        self._heat(time_s, 0.0)

    def _heater_changed(self, time_s: float, fault: LastingFault | None) -> None:
        if fault is not None:
            self._advance(time_s)
            self._off(time_s)

    def _broken(self, output: str) -> bool:
        return output == "1" and self._faults.now(HeaterBroken.kind) is not None

    def _sensed_degC(self, time_s: float) -> float | None:
        """Return what the sensor of the oven has by its curve; None where it is open, or beyond."""
        if self._faults.now(SensorOpen.kind) is not None:
            return None
        degC = self._oven.now_degC(time_s) + self._error_K
        curve = int(self._settings.values("INCRV", "A")[0])
        if curve not in USER_CURVES:
            return degC if curve else None
        kelvin = self._curves.reading_K(curve, ohm_of(degC))
        return None if kelvin is None else kelvin - ZERO_DEGC_K

    # Set-points.

    def _set_point_degC(self, output: str, time_s: float) -> float:
        """Return where a set-point stands at a time."""
        began_s, begin, end = self._way[output]
        ramps, rate = self._ramp[output]
        if not ramps or rate <= 0.0:
            return end
        gone = rate / 60.0 * (time_s - began_s)
        return end if gone >= abs(end - begin) else begin + math.copysign(gone, end - begin)

    def _goes(self, output: str) -> bool:
        return self._set_point_degC(output, self._clock.now()) != self._way[output][2]

    def _unit_of(self, output: str) -> int:
        """Return the unit of the input that an output is controlled by."""
        source = int(self._kept["OUTMODE"][output].split(",")[1])
        of = INPUTS[source - 1] if 1 <= source <= len(INPUTS) else INPUTS[0]
        return int(self._kept["INTYPE"][of].split(",")[-1])

    def _shown_set_point(self, output: str) -> float:
        shift = ZERO_DEGC_K if self._unit_of(output) == KELVIN else 0.0
        return self._set_point_degC(output, self._clock.now()) + shift

    def _set_point(self, text: str) -> None:
        output, value = self._of_output(text)
        shift = ZERO_DEGC_K if self._unit_of(output) == KELVIN else 0.0
        now_s, wanted = self._clock.now(), float_of(value) - shift
        self._way[output] = (now_s, self._set_point_degC(output, now_s), wanted)

    def _set_ramp(self, text: str) -> None:
        output, rest = self._of_output(text)
        on, _, rate = rest.partition(",")
        rate_K_per_min = float_of(rate)
        if on not in {"0", "1"} or not (rate_K_per_min == 0.0 or 0.1 <= rate_K_per_min <= 100.0):
            raise RefusedCommand(EXECUTION_ERROR)
        now_s = self._clock.now()
        stands = self._set_point_degC(output, now_s)
        self._way[output] = (now_s, stands, self._way[output][2])
        self._ramp[output] = on == "1", rate_K_per_min

    def _shown_ramp(self, output: str) -> str:
        on, rate_K_per_min = self._ramp[output]
        return f"{on:d},{rate_K_per_min:+.1f}"

    def _set_range(self, text: str) -> None:
        output, value = self._of_output(text)
        if value not in (SHARE if output in "12" else ("0", "1")):
            raise RefusedCommand(EXECUTION_ERROR)
        now_s = self._clock.now()
        if output != "1":
            self._range[output] = value
        elif value == "0":
            self._range[output], self._integral = value, 0.0
            self._heat(now_s, 0.0)
        elif not self._broken(output):
            if self._range[output] == "0":
                self._stepped_s = now_s
            self._range[output] = value
            self._act(now_s)

    def _set_limit(self, text: str) -> None:
        place, _, value = text.partition(",")
        limit_K = float_of(value)
        if limit_K < 0.0:
            raise RefusedCommand(EXECUTION_ERROR)
        self._limit_K[one_of(INPUTS, place)] = limit_K

    def _power(self, output: str) -> float:
        return self._percent if output == "1" and self._range["1"] != "0" else 0.0

    # Readings.

    def _reading(self, place: str) -> tuple[float | None, int]:
        """Return what an input reads in degC, and its status."""
        sensed = self._sensed_degC(self._clock.now()) if place == "A" else None
        if sensed is None:
            is_open = place != "A" or self._faults.now(SensorOpen.kind) is not None
            return None, SENSOR_OPEN if is_open else INVALID
        return sensed + self._noise_K * float(self._rng.standard_normal()), 0

    def _readings(self, text: str, shift: float) -> str:
        """Return the temperature of an input, of all of them for `0`."""
        places = INPUTS if text.strip() == "0" else one_of(INPUTS, text)
        read = [self._reading(place)[0] for place in places]
        return ",".join(f"{0.0 if degC is None else degC + shift:+.3f}" for degC in read)

    def _sensors(self, text: str) -> str:
        """Return what the sensor of an input has in ohm, of all of them for `0`."""
        places = INPUTS if text.strip() == "0" else one_of(INPUTS, text)
        return ",".join(f"{self._ohm(place):+.4f}" for place in places)

    def _ohm(self, place: str) -> float:
        """Return what a sensor has, whatever its curve makes of it."""
        if place != "A" or self._faults.now(SensorOpen.kind) is not None:
            return 0.0
        noise_K = self._noise_K * float(self._rng.standard_normal())
        return ohm_of(self._oven.now_degC(self._clock.now()) + self._error_K + noise_K)

    def _kelvin(self, place: str) -> float:
        degC, _ = self._reading(place)
        kelvin = 0.0 if degC is None else degC + ZERO_DEGC_K
        least, largest = self._extremes.get(place, (kelvin, kelvin))
        self._extremes[place] = min(least, kelvin), max(largest, kelvin)
        return kelvin

    def _least_and_largest(self, text: str) -> str:
        place = one_of(INPUTS, text)
        self._kelvin(place)
        return ",".join(f"{kelvin:+.3f}" for kelvin in self._extremes[place])

    # Alarms, relays and monitor outputs.

    def _alarm_of(self, text: str) -> tuple[bool, bool]:
        """Return whether the alarms of an input are on, high and low."""
        place = one_of(INPUTS, text)
        on, high, low, deadband, latched, *_ = map(float, self._settings.values("ALARM", place))
        if not on:
            self._alarms[place] = False, False
            return self._alarms[place]
        kelvin, (was_high, was_low) = self._kelvin(place), self._alarms[place]
        is_high = kelvin > (high - deadband if was_high else high)
        is_low = kelvin < (low + deadband if was_low else low)
        if latched:
            is_high, is_low = is_high or was_high, is_low or was_low
        self._alarms[place] = is_high, is_low
        return self._alarms[place]

    def _look_at_alarms(self) -> None:
        """Let a latched alarm see where its input is now."""
        for place in INPUTS:
            if self._settings.values("ALARM", place)[0] == "1":
                self._alarm_of(place)

    def _forget_alarms(self, text: str) -> None:
        self._alarms = dict.fromkeys(INPUTS, (False, False))

    def _relay(self, number: str) -> bool:
        mode, place, kind = self._settings.values("RELAY", number)
        if mode != "2":
            return mode == "1"
        high, low = self._alarm_of(place)
        return (kind != "0" and high) or (kind != "1" and low)

    def _analog(self, output: str) -> float:
        """Return the voltage of an output in percent."""
        mode, *_ = self._kept["OUTMODE"][output].split(",")
        if mode == OPEN_LOOP:
            return float(self._kept["MOUT"][output]) if self._range[output] != "0" else 0.0
        if mode != MONITOR:
            return 0.0
        source, unit, top, bottom, bipolar = self._settings.values("ANALOG", output)
        high, low = float(top), float(bottom)
        if source == "0" or high == low:
            return 0.0
        place = INPUTS[int(source) - 1]
        value = self._ohm(place) if unit == "3" else self._kelvin(place)
        if unit == "2":
            value -= ZERO_DEGC_K
        part = (value - low) / (high - low)
        percent = 200.0 * part - 100.0 if bipolar == "1" else 100.0 * part
        return min(max(percent, -100.0 if bipolar == "1" else 0.0), 100.0)

    def _operation(self) -> int:
        """Return bit 0 for an alarm, bit 1 for an overloaded sensor in use."""
        alarm = any(any(self._alarm_of(place)) for place in INPUTS)
        overloaded = self._faults.now(SensorOpen.kind) is not None
        return alarm + 2 * overloaded

    def _network(self, text: str) -> str:
        _, _, *addresses, host, domain, _ = self._settings.values("NET")
        return ",".join(["1", *addresses, "00:0C:9E:00:03:36", host, domain])

    # The wire.

    def _line(self, line: bytes) -> bytes:
        self._advance(self._clock.now())
        self._look_at_alarms()
        said = [self._carry_out(part) for part in line.decode("ascii", "replace").split(";")]
        replies = [reply for reply in said if reply is not None]
        return ";".join(replies).encode("ascii") + b"\r\n" if replies else b""

    def _carry_out(self, text: str) -> str | None:
        if not text.strip():
            return None
        try:
            match = COMMAND.fullmatch(text.strip())
            act = None if match is None else self._find(match[1])
            if match is None or act is None:
                raise RefusedCommand(COMMAND_ERROR)
            return act(match[2].strip())
        except RefusedCommand as refused:
            self._event |= refused.args[0]
            return None

    def _find(self, name: str) -> Callable[[str], str | None] | None:
        """Return what carries a command out, None for one that it does not have."""
        name = name.upper()
        if name in self._commands:
            return self._commands[name]
        bare = name.removesuffix("?")
        if bare in self._enabled:
            return self._enable_of(bare, asked=name != bare)
        if bare in SETTINGS:
            settings = self._settings
            asked = name != bare
            return lambda text: settings.answer(bare, text) if asked else settings.put(bare, text)
        if bare in self._kept:
            return self._keep_of(bare, asked=name != bare)
        return None

    def _enable_of(self, name: str, *, asked: bool) -> Callable[[str], str | None]:
        def act(text: str) -> str | None:
            if asked:
                return f"{self._enabled[name]:03d}"
            if not text.isdecimal() or int(text) > 255:
                raise RefusedCommand(EXECUTION_ERROR)
            self._enabled[name] = int(text)
            return None

        return act

    def _keep_of(self, name: str, *, asked: bool) -> Callable[[str], str | None]:
        values = self._kept[name]

        def act(text: str) -> str | None:
            place, _, value = text.partition(",")
            place = one_of("".join(values), place)
            if asked:
                return values[place]
            if value.count(",") != values[place].count(","):
                raise RefusedCommand(EXECUTION_ERROR)
            values[place] = ",".join(part.strip() for part in value.split(","))
            return None

        return act

    def _of_output(self, text: str) -> tuple[str, str]:
        place, _, value = text.partition(",")
        return one_of(OUTPUTS, place), value.strip()

    def _take_event(self, text: str) -> str:
        event, self._event = self._event, 0
        return f"{event:03d}"

    def _clear(self, text: str) -> None:
        self._event = 0

    def _complete(self, text: str) -> None:
        self._event |= OPERATION_COMPLETE


def one_of(places: str, text: str) -> str:
    """Return an input or an output; RefusedCommand for none."""
    place = text.strip().upper()
    if len(place) != 1 or place not in places:
        raise RefusedCommand(EXECUTION_ERROR)
    return place


def ohm_of(degC: float) -> float:
    """Return the resistance of a platinum sensor of 100 ohm at a temperature (IEC 60751)."""
    return 100.0 * (1.0 + 3.9083e-3 * degC - 5.775e-7 * degC**2)
