"""What a driver of a Kepco BOP does alike whatever makes its sine: limits, ramps, the way to rest.

Sources: BIT 4886 manual P/N 243-1303 for the error codes and the rounding by calibration constants;
`FUNC:MODE` and the status bits from public client code. Identities as in the manuals 051010 (p.A-3)
and 111315 (A.6) and as answered by real units: commas or blanks between, a calibration date before
or after the serial number, or none.

Commands and their sources:
    *IDN? - who answers, in every recorded form - manuals 051010 p.A-3 and 111315 A.6, answers of
        real units - confirmed
    *CLS, SYST:ERR? - the error queue - BIT 4886 manual 243-1303 - confirmed
    FUNC:MODE CURR - current mode - public client code, BOP-GL guide - confirmed
    CURR, CURR?, CURR? MAX - the set-point and the rating - BIT 4886 manual 243-1303 - confirmed
    CURR:MODE FIX, CURR:MODE LIST - leaves and starts a list - BIT 4886 manual 243-1303 - confirmed
    CURR:RANG 1 - one range, without a jump at a quarter of the scale - BOP-GL guide - not confirmed
    OUTP ON, OUTP OFF, OUTP? - the output - BOP 1KW-MG manual - confirmed
    MEAS:CURR?, MEAS:VOLT? - what flows - BIT 4886 manual 243-1303 - confirmed
    STAT:OPER:COND? - bits 8 voltage mode, 14 list running - BOP-GL guide - not confirmed
    LIST:CLE, LIST:COUN 0 - an empty list, for ever - BIT 4886 manual 243-1303 - confirmed
"""

from __future__ import annotations

import math
import re
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from drivers.kepco.steady_current import STEP_S, SteadyCurrent, set_point_A
from drivers.transport.exchanges import TooLate
from drivers.transport.text_line import not_this_model
from station.clock import Clock
from station.errors import InstrumentError, PauseRefused
from station.roles import TRIES, Identity, Place, SafetyReading, published, quantity

LEAVE_LIST = "CURR:MODE FIX"
OPERATION = "STAT:OPER:COND?"
LIST_RUNNING = 1 << 14
SETTLE_S = 0.1
COMES_TO_REST_S = 60.0
MAX_HALF_PERIOD_S = 10.5
"""Half a period of the slowest published drive, 0.05 Hz, and a little."""

LOOK_S = 0.01
LOOKS = 6
"""A sine near its zero changes by several times its read-back's noise in as many looks."""
DATE = r"\d+[-/]\d+[-/]\d+"
BEHIND_MODEL = (
    rf"[\s,]+(?P<before>{DATE}[\s,]+)?(?P<serial>\w+)[\s,]+(?P<after>{DATE}[\s,]+)?"
    r"(?P<firmware>\d+\.\d+\S*?)\.?\s*$"
)
"""What follows the model in an identity: perhaps a calibration date, serial number, revision."""
ECHO = repr("*IDN?\r")[:-1]
"""How an error of the line begins to show an echo that its answer follows at once."""
TELNET = "it echoes what it is sent, as on its telnet port: write the port of bare sockets, 5025"
DIFFERENT = "compare its identity with the driver's model in the bench file"


class KepcoSupply(SteadyCurrent):
    """A coil supply: a sine that the instrument repeats until stopped, or a steady current.

    Limits: `current` A, `voltage` V, `slew` A/s, and `zero_current` A, the largest measured current
    that counts as zero.
    """

    recognises: ClassVar[str]

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self._voltage_limit_V = self.limit("voltage")
        self._half_period_s = MAX_HALF_PERIOD_S
        self._sine: Sine | None = None
        self._stood_still = False

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model with ratings, serial number, firmware.

        The serial number is the field or word that is neither date, model nor revision.
        """
        try:
            answer = self._line.query("*IDN?")
        except InstrumentError as error:
            if ECHO not in str(error):
                raise
            answer = "*IDN?"
        match = re.match(self.recognises, answer)
        if match is None:
            echo = answer.strip() == "*IDN?"
            do_now = TELNET if echo else DIFFERENT
            raise not_this_model(self.place.name, "asked *IDN?", answer, do_now)
        dated = match["before"] or match["after"]
        self.met(f"identity {'with' if dated else 'without'} a calibration date")
        return Identity(
            "KEPCO", " ".join(match["model"].split()), match["serial"], match["firmware"]
        )

    def programme_limits(self) -> None:
        """Set current mode, zero, and the instrument's own current and voltage limits.

        A supply that is found switched on, as an earlier run may have left it, is first brought to
        rest within its slew limit. Raises InstrumentError when the bench's limit is above the
        instrument's rating.
        """
        if self._line.proof.of(self._output_is_on) == [True]:
            self.make_safe(self.place.clock.now() + COMES_TO_REST_S)
        self._programme_limits()

    @abstractmethod
    def _programme_limits(self) -> None:
        """Set what `programme_limits` says, on a supply at rest."""

    @abstractmethod
    def _prepare(self, frequency_Hz: float, amplitude_A: float) -> float:
        """Put one period of a sine into the list memory; return the frequency in Hz it will have.

        Raises InstrumentError for a frequency that the instrument cannot do.
        """

    def load_sine(self, frequency_Hz: float, amplitude_A: float) -> float:
        """Prepare a sine and switch the output on at a fixed current of zero.

        Returns the frequency in Hz that it will have by the instrument's own time base. Raises
        InstrumentError when the amplitude is above the bench's limit.
        """
        if amplitude_A > self._current_limit_A:
            raise self.error(
                f"prepare a sine of {amplitude_A:g} A",
                f"the bench allows {self._current_limit_A:g} A",
                "lower the plan's amplitude",
            )
        given_Hz = self._prepare(frequency_Hz, amplitude_A)
        self._line.command("OUTP ON")
        self.place.publish("output", "on")
        self._half_period_s = 0.5 / given_Hz
        return given_Hz

    def start_sine(self) -> None:
        """Run the uploaded list and prove from the status register that it runs."""
        self._line.command("CURR:MODE LIST")
        self._sine = Sine(self.place.clock.now(), self._half_period_s)
        if not list_runs(self._line.number(OPERATION)):
            raise self.error(
                "started the list",
                "the status register says that no list runs",
                "look at the supply's display for a fault, clear it and run again",
            )

    def stop(self) -> None:
        """Bring the current to zero within the slew limit and switch the output off."""
        self.make_safe(self.place.clock.now() + COMES_TO_REST_S)

    @published("current", "A")
    def current_A(self) -> float:
        """Return the measured output current in A."""
        return self._line.number("MEAS:CURR?")

    def make_safe(self, deadline_s: float) -> None:
        """Leave the list near a zero of its sine, ramp what remains, switch the output off."""
        self._take_over()
        self._line.forget_errors()
        self._ramp_to_zero(deadline_s)
        self._line.command("OUTP OFF")
        self.place.publish("output", "off")

    def _take_over(self) -> None:
        """Have the supply listen to this line, where a model needs to be told."""

    def last_attempt(self) -> None:
        """Switch the output off at once, and wait for no answer."""
        self._line.last_attempt("OUTP OFF")

    def _ramp_to_zero(self, deadline_s: float) -> None:
        clock = self.place.clock
        # An answer to another question must not be what a ramp starts from.
        if self._line.proof.of(self._list_runs) == [True]:
            self._leave_list(deadline_s)
        present_A, set_A = self._line.proof.of(
            self._sure_current_A, lambda: set_point_A(self._line.number)
        )
        if abs(set_A) > self._ramp_step_A or self._stood_still:
            # What it drives follows what is commanded, also where it reads back something else:
            # in compliance, frozen, or beyond its set-point.
            present_A = set_A
        flows = abs(present_A) > self._zero_A
        steps = math.ceil(abs(present_A) / self._ramp_step_A) if flows else 0
        # First the wait and the present set-point once more: a ramp that was interrupted has just
        # made its step, or its last command was lost.
        clock.sleep(STEP_S)
        for step in range(steps, 0, -1):
            self._line.command(f"CURR {present_A * step / steps:.4f}")
            clock.sleep(STEP_S)
        self._line.command("CURR:MODE FIX;:CURR 0")
        while abs(self._sure_current_A()) > self._zero_A and clock.now() < deadline_s:
            clock.sleep(SETTLE_S)

    def read_safety(self) -> SafetyReading:
        """Read back output state, list state and current."""
        output_on, runs, current_A = self._line.proof.of(
            self._output_is_on, self._list_runs, self._sure_current_A
        )
        safe = not output_on and not runs and abs(current_A) <= self._zero_A
        return SafetyReading(
            safe and not self._stood_still,
            f"output {'on' if output_on else 'off'}, {'list running, ' if runs else ''}"
            f"{round(current_A, 3) + 0.0:.3f} A"
            f"{', which stood still while the list ran' if self._stood_still else ''}",
        )

    def pause(self) -> str:
        """Wait at zero current for any time; raises PauseRefused while it is not at rest."""
        if holds := self._output_is_on() and not self._list_runs():
            self.ramp_to(0.0)
        if (reading := self.read_safety()).safe or holds:
            return reading.read_back
        raise PauseRefused(f"it is not at rest: {reading.read_back}")

    def _leave_list(self, deadline_s: float) -> None:
        """End the list where it carries no more current than one step of a ramp.

        FIX goes at once to the fixed set-point, which was set to zero before the list ran and
        cannot be set while it runs: at full current this would cut the coil off. So it is sent at
        a zero of the current or, where the line is out of step then, at the next. A list that does
        not come to zero in the longest half period is left all the same.
        """
        until_s = min(self.place.clock.now() + MAX_HALF_PERIOD_S, deadline_s - SETTLE_S)
        tries = TRIES
        while tries:
            self._stood_still |= not wait_for_zero(
                self.place.clock,
                self._sure_current_A,
                self._ramp_step_A,
                until_s,
                self._sine,
                self._line.proof.in_step,
            )
            if self.place.clock.now() >= until_s:
                break
            try:
                return self._line.command(LEAVE_LIST, now=True)
            except TooLate:
                continue
            except InstrumentError:  # it may have heard all the same
                tries -= 1
                if self._line.proof.of(self._list_runs) == [False]:
                    return None
        return self._line.command(LEAVE_LIST)

    def _list_runs(self) -> bool:
        return list_runs(self._line.number(OPERATION))

    @quantity("current", "A")
    def _sure_current_A(self) -> float:
        return self._line.number("MEAS:CURR?")

    @quantity("voltage", "V")
    def _voltage_V(self) -> float:
        return self._line.number("MEAS:VOLT?")

    @quantity("output", states=("on", "off"))
    def _output_is_on(self) -> bool:
        return self._line.number("OUTP?") != 0


def list_runs(operation: float) -> bool:
    """Return whether the operation condition register says that a list runs."""
    return bool(int(operation) & LIST_RUNNING)


@dataclass(frozen=True)
class Sine:
    """A list that was started by this driver: when, and half of its period."""

    began_s: float
    half_period_s: float

    def next_zero_s(self, time_s: float) -> float:
        """Return the first zero of the current at or after a run time."""
        halves = math.ceil((time_s - self.began_s) / self.half_period_s - 1e-9)
        return self.began_s + halves * self.half_period_s


def wait_for_zero(
    clock: Clock,
    read_A: Callable[[], float],
    near_zero_A: float,
    until_s: float,
    sine: Sine | None,
    in_step: Callable[[], bool],
) -> bool:
    """Return near a zero of a running list's current; False when the read-back stood still.

    A card that leaves its list goes at once to the fixed set-point, which is zero. At full current
    this would cut the coil off, so the list is left where it carries no more than one step of a
    ramp. A read-back that stands still while a list runs tells nothing: then the zeros are reckoned
    from the time at which the list was started.

    `in_step` proves that a reading near zero is the current, and no answer to another question.
    At `until_s` the list is to be left in any case.
    """
    seen: list[float] = []
    while clock.now() < until_s:
        seen = [*seen[1 - LOOKS :], read_A()]
        if abs(seen[-1]) <= near_zero_A:
            if len(set(seen)) > 1:
                if in_step():
                    return True
                seen = []
                continue
            if len(seen) == LOOKS:
                break
        clock.sleep(LOOK_S)
    stood_still = len(seen) == LOOKS and len(set(seen)) == 1
    if stood_still and sine is not None:
        clock.sleep_until(max(clock.now(), sine.next_zero_s(clock.now())))
    return not stood_still
