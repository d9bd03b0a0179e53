"""Keysight E36312A triple-output DC supply (SCPI over TCP, lines end with LF): the device's power.

The current limit of the output is that of the bench file, and its over-current protection latches
the output off where the device takes more for longer than `inrush`. Every look at current, voltage
or output asks for the trips, too: an output that the instrument has cut, or that carries more than
the bench allows, is switched off in that very look, and the look fails, which ends the run.

Commands and their sources:
    *IDN? - maker, model, serial, firmware - an answer of a real unit that a public client prints -
        confirmed
    OUTP ON|OFF,(@n), OUTP? (@n) - the output - two public clients of the model - confirmed
    VOLT, CURR, VOLT?, CURR? with (@n) - voltage and current limit - two public clients of the
        model - confirmed
    MEAS:VOLT? (@n), MEAS:CURR? (@n) - what flows - two public clients of the model - confirmed
    VOLT:PROT, VOLT:PROT? with (@n) - level of over-voltage protection - two public clients of the
        model - confirmed
    CURR:PROT:STAT, CURR:PROT:DEL and their queries with (@n) - over-current protection and its
        delay - one public client of the model, another of its sister E36234A - not confirmed
    VOLT:PROT:TRIP? (@n), CURR:PROT:TRIP? (@n) - which protection has tripped - one public client -
        not confirmed
    OUTP:PROT:CLE (@n) - clears a trip - public clients of Keysight supplies, and the guide of the
        N6900 series - not confirmed
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field

from drivers.transport.exchanges import Repeatable, shortened
from drivers.transport.text_line import ScpiDriver, VisaSettings, numbers_of
from station.errors import InstrumentError
from station.fields import Unit
from station.roles import Place, SafetyReading, quantity
from station.roles.patience import patience

RATINGS = {1: (6.0, 5.0), 2: (25.0, 1.0), 3: (25.0, 1.0)}
"""V and A of each output (data sheet 5992-2124EN)."""

TOLERANCE = 2e-3
"""Of a set-point that is read back, and of what the display rounds, in V and A."""

SETTLING_S = 0.2
ON = {"1": True, "ON": True, "0": False, "OFF": False}


def is_on(answer: str) -> bool:
    """Return which of two states an answer is; KeyError for one that is neither."""
    return ON[answer.strip().upper()]


LOOKED_AT: dict[str, Callable[[str], Any]] = {
    "MEAS:VOLT": str,
    "MEAS:CURR": str,
    "OUTP": is_on,
    "CURR:PROT:TRIP": is_on,
    "VOLT:PROT:TRIP": is_on,
}
"""What one exchange asks of the output."""


class Look(NamedTuple):
    """What one exchange says of the output: V, A, whether it is on, and what has tripped."""

    voltage_V: float
    current_A: float
    on: bool
    tripped: str


class KeysightE36312A(ScpiDriver):
    """One output that feeds the device under test.

    Limits: `current` A, at which the instrument cuts the device off; `voltage` V, above which its
    over-voltage protection does.
    """

    class Settings(VisaSettings):
        """Which output feeds the device, and with what."""

        channel: int = Field(ge=1, le=3, description="the output that feeds the device")
        voltage_V: Annotated[float, Unit("V")] = Field(
            gt=0, le=25, description="what the device is fed with"
        )
        inrush_s: Annotated[float, Unit("s")] = Field(
            0.05,
            ge=0.005,
            le=0.5,
            description="how long the device may take the limit of current while it is switched on",
        )

    recognises: ClassVar[str] = r"^(?i:Keysight Technologies),E36312A,(?P<serial>[^,]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:ERR\?|OUTP\? \(@\d\)|MEAS:(VOLT|CURR)\? \(@\d\)",
        r"(VOLT|CURR)(:PROT)?(:TRIP|:DEL|:STAT)?\? \(@\d\)",
        r"OUTP OFF,\(@\d\)",
    )
    without_limits: ClassVar[str] = "the device is not switched on"
    when_odd = "check its address in the bench file, and that nobody else talks to it"

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        settings = self.Settings.of(place)
        self._at = f"(@{settings.channel})"
        self._channel, self._voltage_V = settings.channel, settings.voltage_V
        self._inrush_s = settings.inrush_s
        self._limit_A, self._limit_V = self.limit("current"), self.limit("voltage")
        self._check_limits()

    def switch_on(self) -> None:
        """Write and prove limits and protections, switch the device on, and look at what it takes.

        A device that is on already stays on. Raises InstrumentError, the output off, where the
        device takes too much.
        """
        if self._asked().on:
            self._look()
            self._prove()
            return
        try:
            self._line.forget_errors()
            for message in (
                f"OUTP OFF,{self._at}",
                f"OUTP:PROT:CLE {self._at}",
                f"CURR {self._limit_A:g},{self._at}",
                f"CURR:PROT:DEL {self._inrush_s:g},{self._at}",
                f"CURR:PROT:STAT ON,{self._at}",
                f"VOLT:PROT {self._limit_V:g},{self._at}",
                f"VOLT {self._voltage_V:g},{self._at}",
            ):
                self._line.command(message)
            self._prove()
            self._line.command(f"OUTP ON,{self._at}")
            self.place.clock.sleep(self._inrush_s + SETTLING_S)
            if not self._look().on:
                raise self.error(
                    "switched the device on",
                    "its output reads back as off",
                    "look at its display and its front panel, then run again",
                )
        except InstrumentError:
            self._cut()
            raise

    def switch_off(self) -> None:
        """Switch the device off and see that the output is off."""
        self._line.command(f"OUTP OFF,{self._at}")
        if self._asked().on:
            raise self.error(
                "switched the device off", "its output reads back as on", "switch it off by hand"
            )

    def pause(self) -> str:
        """Say that the device stays on within its limits; raises InstrumentError where it is not.

        The instrument's own protection goes on watching.
        """
        return f"the device stays {'on' if self._look().on else 'off'}"

    def make_safe(self, deadline_s: float) -> None:
        """Switch the output off and read it back."""
        self._line.forget_errors()
        self._line.command(f"OUTP OFF,{self._at}")
        reading = self.read_safety()
        if not reading.safe:
            raise self.error("switched the output off", reading.read_back, "switch it off by hand")

    def last_attempt(self) -> None:
        """Switch the output off at once, and wait for no answer."""
        self._line.last_attempt(f"OUTP OFF,{self._at}")

    def read_safety(self) -> SafetyReading:
        """Read back the output and its current."""
        (look,) = self._line.proof.of(self._asked)
        read_back = f"output {self._channel} {'on' if look.on else 'off'}, {look.current_A:.3f} A"
        return SafetyReading(not look.on and look.current_A <= TOLERANCE * 5, read_back)

    @quantity("output", states=("on", "off"))
    def _is_on(self) -> bool:
        return self._look().on

    @quantity("current", "A")
    def _current_A(self) -> float:
        return self._look().current_A

    @quantity("voltage", "V")
    def _output_V(self) -> float:
        return self._look().voltage_V

    def _check_limits(self) -> None:
        largest_V, largest_A = RATINGS[self._channel]
        for limit, value, largest, unit in (
            ("voltage", self._limit_V, largest_V, "V"),
            ("current", self._limit_A, largest_A, "A"),
        ):
            if value > largest:
                raise self.error(
                    f"limit the {limit} to {value:g} {unit}",
                    f"output {self._channel} ends at {largest:g} {unit}",
                    f"lower limits.{limit} in the bench file, or take another output",
                )
        if self._voltage_V > self._limit_V:
            raise self.error(
                f"feed the device with {self._voltage_V:g} V",
                f"the bench allows {self._limit_V:g} V",
                "correct settings.voltage or limits.voltage in the bench file",
            )

    def _prove(self) -> None:
        """Read limits and protections back; InstrumentError where one is another."""
        for header, wanted in (
            ("CURR", self._limit_A),
            ("CURR:PROT:DEL", self._inrush_s),
            ("CURR:PROT:STAT", 1.0),
            ("VOLT:PROT", self._limit_V),
            ("VOLT", self._voltage_V),
        ):
            has = self._line.number(f"{header}? {self._at}")
            agrees = abs(has - wanted) <= TOLERANCE * max(1.0, wanted)
            what = f"{header} of output {self._channel}"
            self.check_set(what, f"{wanted:g}", f"{has:g}", agrees=agrees)

    def _look(self) -> Look:
        """Read the output; cut it and raise InstrumentError where the device takes too much."""
        look = self._asked()
        over = look.current_A > self._limit_A * (1 + TOLERANCE) + TOLERANCE
        if not (look.tripped or over):
            return look
        self._cut()
        cause = f"its {look.tripped} protection has tripped" if look.tripped else "it carried"
        raise self.error(
            f"looked at output {self._channel}, which feeds the device",
            f"{cause} {look.current_A:.3f} A at {look.voltage_V:.3f} V, the bench allows "
            f"{self._limit_A:g} A and {self._limit_V:g} V; the device was cut off",
            "check the device and its cable for a short before it is switched on again",
        )

    @patience()
    def _cut(self) -> None:
        """Switch the output off, whatever comes back."""
        try:
            self._line.command(f"OUTP OFF,{self._at}")
            self._asked()
        except InstrumentError:
            with suppress(InstrumentError):
                self.last_attempt()

    @patience()
    def _asked(self) -> Look:
        """Return what one exchange says, and publish it."""
        questions = {f"{header}? {self._at}": read for header, read in LOOKED_AT.items()}
        volts, amperes, on, current_trip, voltage_trip = self._line.answers(questions)
        sent = shortened(";:".join(questions))
        voltage_V, current_A = numbers_of(self.place.name, sent, [volts, amperes])
        trip = "over-current" if current_trip else "over-voltage" if voltage_trip else ""
        look = Look(voltage_V, current_A, on, trip)
        self.place.publish("voltage", look.voltage_V, "V")
        self.place.publish("current", look.current_A, "A")
        self.place.publish("output", "on" if look.on else "off")
        return look
