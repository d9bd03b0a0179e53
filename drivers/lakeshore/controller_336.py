"""Lake Shore 336 temperature controller over TCP, port 7777: one output heats, one input measures.

Requests end with LF, answers with CR LF. It keeps no error queue: `*ESR?` behind each command tells
whether it was refused. The same commands are those of the 335, which has no Ethernet.

The control loop is set up at the panel, with its sensor, its curve, its PID and the heater's
resistance and largest current; the driver proves that the loop is closed on the sensor of the bench
file and that the heater stays off after a power failure, and sets none of them. The temperature
limit of the input is written into the controller, `OVERSHOOT_K` above the highest set-point: beyond
it the controller itself switches every output off.

Not confirmed in a primary source: that `SETP?` reads where a ramp of the set-point stands, and what
`CRDG?` reads without a sensor, which nobody uses since `RDGST?` goes with it.

Commands and their sources:
    *IDN?, *ESR?, *CLS - who answers, what was refused - the maker's client - confirmed
    CRDG?, RDGST? - temperature in degC, and whether it is one - 335 manual p.123 - confirmed
    SETP, RAMP, RAMPST? - set-point, its ramp in K/min, whether it goes - 335 manual p.122 -
        confirmed
    RANGE - the heater, 0 off, 1 low, 2 medium, 3 high - 335 manual p.123 - confirmed
    TLIMIT - kelvin beyond which all outputs are switched off - 350 manual p.156 - confirmed
    HTR?, HTRST? - output in percent, 1 open, 2 short - the maker's client - confirmed
    OUTMODE?, INTYPE? - the loop's mode and input, the input's unit - the maker's client - confirmed
    SETP? - where a ramp stands - public client code - not confirmed
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import Field

from drivers.transport.exchanges import Repeatable
from drivers.transport.text_line import ScpiDriver, VisaSettings, identification
from station.roles import Identity, Place, SafetyReading, quantity

ZERO_DEGC_K = 273.15
MOST_DEGC = 1226.85
"""1500 K, the highest of any sensor that it takes."""
OVERSHOOT_K = 5.0
INPUTS = ("A", "B", "C", "D")
RANGES = ("off", "low", "medium", "high")
SLOWEST_K_PER_MIN, FASTEST_K_PER_MIN = 0.1, 100.0
CLOSED_LOOP = 1
KELVIN, CELSIUS = 1, 2
AGREES_K = 0.006
"""What is written has as many digits as it reads back."""
NO_POWER_PERCENT = 0.05
LOOK_S = 0.1
NO_READING = {
    1: "no valid reading",
    16: "temperature below its curve",
    32: "temperature above its curve",
    64: "sensor units zero, as of a short",
    128: "sensor units beyond their range, as of an open sensor",
}
HEATER_FAULTS = {1: "the heater is open", 2: "the heater is shorted"}
AT_PANEL = "set it at the controller's panel"


class Lakeshore336(ScpiDriver):
    """The heater of a cell at output 1 or 2, its sensor at an input."""

    class Settings(VisaSettings):
        """Where heater and sensor are connected, and how strong the heater may be."""

        output: Literal[1, 2] = Field(1, description="the heater's output")
        input: Literal["A", "B", "C", "D"] = Field("A", description="the cell's sensor")
        range: Literal["low", "medium", "high"] = Field(
            "high", description="the heater's range while it controls"
        )

    recognises: ClassVar[str] = r"^LSCI,MODEL336,(?P<serial>[^,/]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*CLS|\*(IDN|ESR)\?|(CRDG|RDGST|INTYPE|TLIMIT)\? [A-D]",
        r"(SETP|RAMP|RAMPST|RANGE|HTR|HTRST|OUTMODE)\? \d",
        r"(SETP|RAMP|RANGE) \d,[\d.,+-]+|TLIMIT [A-D],[\d.+-]+",
    )
    error_query = "*ESR?"
    no_error = r"\+?0*(0|1|64|65|128|129|192|193)$"
    """Neither of the bits for a query, an execution or a command that failed."""
    answer_end = "\r\n"
    without_limits = "the heater is not switched on"

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        settings = self.Settings.of(place)
        self._output, self._input = settings.output, settings.input
        self._range = RANGES.index(settings.range)
        self._limits_written = self._on = False
        self._unit = CELSIUS

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number, option and firmware."""
        parts = identification(self.place.name, self._line.query("*IDN?"))
        return Identity(parts[0], parts[1], parts[2].split("/")[0], parts[3])

    def programme_limits(self) -> None:
        """Prove how the loop is set up, and write the temperature limit; it is read back.

        Raises InstrumentError where the loop is another, or the bench allows more than the model.
        """
        self.check_rating("temperature_high", MOST_DEGC, "degC")
        self._line.forget_errors()  # of whoever talked to it before
        self._look_at_loop()
        limit_K = math.ceil(self.limit("temperature_high") + ZERO_DEGC_K + OVERSHOOT_K)
        self._line.command(f"TLIMIT {self._input},{limit_K}")
        has_K = self._line.number(f"TLIMIT? {self._input}")
        self.check_set(
            "its temperature limit", f"{limit_K} K", f"{has_K:g} K", agrees=has_K == limit_K
        )
        self._limits_written = True

    def switch_on(self) -> None:
        """Let the heater control, with the present temperature as set-point, without a ramp.

        Raises InstrumentError without a reading, and for a heater that is open or shorted.
        """
        if not self._limits_written:
            self.programme_limits()
        attempted = "switch the heater on"
        present_degC = self.temperature_degC()
        self._look_at_heater(attempted)
        self._set_ramp(0, SLOWEST_K_PER_MIN)
        self._set_point(min(present_degC, self.limit("temperature_high")))
        self._line.command(f"RANGE {self._output},{self._range}")
        if (has := self._range_now()) != self._range:
            raise self.error(
                attempted,
                f"its range still reads {RANGES[has]}",
                "look at its panel: the temperature limit of an input may have switched it off",
            )
        self._on = True
        self.place.publish("output", "on")

    def ramp_to(self, temperature_degC: float, rate_K_per_min: float) -> None:
        """Begin a ramp of the set-point from where it stands; returns at once.

        Raises InstrumentError beyond the limits, and with the heater off.
        """
        attempted = f"ramp to {temperature_degC:g} degC at {rate_K_per_min:g} degC/min"
        fastest = min(self.limit("temperature_slew"), FASTEST_K_PER_MIN)
        if not SLOWEST_K_PER_MIN <= rate_K_per_min <= fastest:
            raise self.error(
                attempted,
                f"the bench, or the model, allows {SLOWEST_K_PER_MIN:g} to {fastest:g} degC/min",
                "correct the plan's heating_rate, or limits.temperature_slew",
            )
        high = self.limit("temperature_high")
        if not -ZERO_DEGC_K < temperature_degC <= high:
            raise self.error(
                attempted,
                f"the bench allows up to {high:g} degC",
                "correct the plan's cell_temperature, or limits.temperature_high",
            )
        if not self._on:
            raise self.error(attempted, "its heater is off", "switch it on before")
        self._look_at_heater(attempted)
        self._set_ramp(1, rate_K_per_min)
        self._line.command(f"SETP {self._output},{self._in_unit(temperature_degC):.3f}")

    def is_ramping(self) -> bool:
        """Whether the set-point is still on its way; with the heater off nothing is.

        Raises InstrumentError for a heater that failed, or is no longer on.
        """
        self._look_at_heater("follow the ramp")
        return self._on and self._line.query(f"RAMPST? {self._output}").strip() == "1"

    @quantity("temperature", "degC")
    def temperature_degC(self) -> float:
        """Return the temperature of the cell; InstrumentError where the sensor gives none."""
        reading_degC, status = self._line.answers(
            {f"CRDG? {self._input}": float, f"RDGST? {self._input}": int}
        )
        if status or not math.isfinite(reading_degC):
            said = [text for bit, text in NO_READING.items() if int(status) & bit]
            raise self.error(
                "read the temperature",
                f"input {self._input} has none: {', '.join(said) or f'status {status:g}'}",
                "look at the sensor and its cable, and at the curve of the input",
            )
        return float(reading_degC)

    def set_point_degC(self) -> float:
        """Return where the set-point stands now."""
        return self._line.number(f"SETP? {self._output}") - self._offset()

    @quantity("power", "%")
    def power_percent(self) -> float:
        """Return the heater's output in percent of its range."""
        return self._line.number(f"HTR? {self._output}")

    def make_safe(self, deadline_s: float) -> None:
        """Switch the heater off and see, before run time `deadline_s`, that it is."""
        self._on = False
        self._line.query(f"RANGE {self._output},0;:RANGE? {self._output}")
        while self.place.clock.now() < deadline_s - LOOK_S:
            if self.read_safety().safe:
                return
            self.place.clock.sleep(LOOK_S)

    def last_attempt(self) -> None:
        """Switch the heater off at once, and wait for no answer."""
        self._line.last_attempt(f"RANGE {self._output},0")

    def read_safety(self) -> SafetyReading:
        """Read back whether the range is off and the output without power."""
        # A sensor that has failed makes nothing unsafe.
        range_now, percent, at_degC = self._line.proof.of(
            self._range_now, self.power_percent, lambda: self._line.query(f"CRDG? {self._input}")
        )
        self.place.publish("output", "on" if range_now else "off")
        return SafetyReading(
            range_now == 0 and abs(percent) <= NO_POWER_PERCENT,
            f"range {RANGES[range_now]}, output {percent:.1f} %, cell at "
            f"{at_degC.strip(' +')} degC",
        )

    @quantity("output", states=("on", "off"))
    def _is_on(self) -> bool:
        return self._range_now() != 0

    def _range_now(self) -> int:
        question = f"RANGE? {self._output}"
        answer = self._line.query(question).strip()
        if answer not in {str(number) for number in range(len(RANGES))}:
            raise self._line.odd(question, answer)
        return int(answer)

    def _look_at_loop(self) -> None:
        """Prove mode and input of the loop, that it stays off after power, and the input's unit."""
        mode, source, stays_on = self._whole_numbers(f"OUTMODE? {self._output}", 3)
        attempted = f"read how output {self._output} is controlled"
        if (mode, source) != (CLOSED_LOOP, 1 + INPUTS.index(self._input)):
            raise self.error(
                attempted,
                f"its mode is {mode} on input {source}, where closed loop is {CLOSED_LOOP} and "
                f"{self._input} is {1 + INPUTS.index(self._input)}",
                AT_PANEL,
            )
        if stays_on:
            raise self.error(attempted, "its power up enable is on", AT_PANEL)
        self._unit = self._whole_numbers(f"INTYPE? {self._input}", 5)[-1]
        if self._unit not in {KELVIN, CELSIUS}:
            raise self.error(
                f"read the unit of input {self._input}",
                f"{self._unit} came back, neither kelvin nor Celsius",
                AT_PANEL,
            )

    def _whole_numbers(self, question: str, count: int) -> list[int]:
        numbers = self._line.numbers(question)
        if len(numbers) != count:
            raise self._line.odd(question, ",".join(f"{number:g}" for number in numbers))
        return [int(number) for number in numbers]

    def _look_at_heater(self, attempted: str) -> None:
        """Raise InstrumentError for a heater that failed, or is off though it was switched on."""
        question = f"HTRST? {self._output}"
        fault = self._line.number(question)
        if fault:
            said = HEATER_FAULTS.get(int(fault), f"heater error {fault:g}")
            raise self.error(attempted, said, "look at the heater and its cable")
        if self._on and not self._range_now():
            self.place.publish("output", "off")
            raise self.error(
                attempted,
                "its heater is off though it was switched on",
                "look at its panel: the temperature limit of an input may have switched it off",
            )

    def _set_ramp(self, on: int, rate_K_per_min: float) -> None:
        self._line.command(f"RAMP {self._output},{on},{rate_K_per_min:.1f}")

    def _set_point(self, temperature_degC: float) -> None:
        """Put the set-point somewhere at once, and read it back."""
        wanted = self._in_unit(temperature_degC)
        self._line.command(f"SETP {self._output},{wanted:.3f}")
        has = self._line.number(f"SETP? {self._output}")
        self.check_set(
            "its set-point", f"{wanted:.3f}", f"{has:.3f}", agrees=abs(has - wanted) <= AGREES_K
        )

    def _in_unit(self, temperature_degC: float) -> float:
        return temperature_degC + self._offset()

    def _offset(self) -> float:
        """Return what a temperature in the loop's unit has more than in degC."""
        return ZERO_DEGC_K if self._unit == KELVIN else 0.0
