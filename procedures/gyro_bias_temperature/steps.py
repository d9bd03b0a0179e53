"""The steps: in the chamber, on at room temperature, soaks and ramps, back and off."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.common.gyro_source import CABLES, GYRO, earth_arcsec_per_s
from procedures.common.place_readings import PlaceReadings
from procedures.common.sensing import NeedsChanges
from procedures.common.switch_ons import POWER
from station.errors import ConditionNotReached
from station.method.commands import GyroSampling, Power
from station.method.duration import Duration, exactly
from station.method.motion import ChamberOn, TemperatureRamp, TemperatureTo
from station.method.verbs import keep_row, look_until
from station.procedure import Prompt, Step
from station.roles import GyroAcquisition, ThermalChamber

from .parameters import SECONDS_PER_MINUTE, SOAK, BiasTemperatureParameters, Leg

if TYPE_CHECKING:
    from station.method.run import Rates, Run

CHAMBER = "thermal_chamber"
WARM_UP, RETURN = "warm-up", "return"
SOAKS, UP, DOWN = (("parameters", name) for name in ("soaks", "ramp_up", "ramp_down"))
ROOM = ("parameters", "room_temperature")
LOOK_S = 8.0
"""Run time between two looks; less where time runs by itself, so that a kill loses little."""
LATE_S = 2.0
"""The last samples come late."""
APPROACH_S = 600.0
LONGER, LONGER_S = 1.2, 1800.0
"""By so much, and so many seconds, a ramp may be longer than its rate says."""
CHAMBER_COLUMNS = {
    "process_value_degC": "degC, the chamber's air",
    "set_point_degC": "degC, what it is controlled to",
}

MOUNT = Prompt(
    "mount-in-chamber",
    "Mount the gyro in the chamber on a plate or a table that stands still, its input axis as the "
    "plan's `input_axis` says; close the door.",
    checklist=(
        "The gyro is bolted, its cables go through the port and the port is closed.",
        "A table in the chamber has its servos off or holds its angle.",
        "Nothing in the chamber is harmed by the lowest and the highest soak.",
    ),
    then="cables; the gyro is switched on by the station and the chamber goes to the soaks",
)


def mount(run: Run) -> None:
    """1: the gyro in the chamber, its cables connected, the door closed."""
    run.ask(MOUNT)
    run.ask(CABLES[GYRO])


def switch_on(run: Run) -> None:
    """2: the chamber at room temperature, the gyro on and warm, its samples begun.

    A run that goes on does so again: the chamber was switched off, and perhaps the gyro.
    """
    parameters: BiasTemperatureParameters = run.parameters
    climate = run.state(Climate, run)
    climate.chamber.programme_limits()
    run.event("field-on", instrument=CHAMBER)
    run.apply(ChamberOn(CHAMBER))
    room = parameters.room_temperature_degC
    run.apply(TemperatureTo(CHAMBER, room, "room temperature", decided_by=ROOM))
    climate.reach(room, Duration(APPROACH_S, 0.0, parameters.chamber_at_most_s + LOOK_S))
    run.apply(Power(POWER, True))
    climate.follow(parameters.warm_up_s, "the gyro warms up")
    run.apply(GyroSampling(GYRO, parameters.sample_interval_s, parameters.channel))
    climate.begin_pulses()


def soaks(run: Run) -> None:
    """3: from soak to soak; the gyro, its temperature and the chamber's are recorded throughout."""
    go(run, run.parameters.outward)


def back(run: Run) -> None:
    """4: back to room temperature; the gyro off. The bench is made safe when the run ends."""
    go(run, run.parameters.homeward)
    run.role(GYRO, GyroAcquisition).stop()
    run.apply(Power(POWER, False))


STEPS = (
    Step("1", "Mount the gyro in the chamber, its axis as stated, the door closed", mount),
    Step("2", "Switch it on at room temperature, let it warm up", switch_on),
    Step("3", "Soaks from low to high, ramps between them, all recorded", soaks),
    Step("4", "Back to room temperature, gyro off", back),
)


def go(run: Run, legs: tuple[Leg, ...]) -> None:
    """Go through the ramps and soaks that are not finished; each is a unit of work.

    Where the chamber does not stand where the next begins, in a run that goes on, it is brought
    there first, at the plan's rates: what the gyro does on its way belongs to the record.
    """
    parameters: BiasTemperatureParameters = run.parameters
    climate = run.state(Climate, run)
    for leg in run.unfinished(legs, lambda leg: leg.unit):
        if climate.stands_degC != leg.from_degC:
            number = 1 + sum(unit.startswith(RETURN) for unit in run.past.finished)
            follow_leg(
                run, parameters.ramp(f"{RETURN} {number}", climate.stands_degC, leg.from_degC)
            )
        follow_leg(run, leg)


def follow_leg(run: Run, leg: Leg) -> None:
    """Record a ramp or a soak.

    Raises ConditionNotReached for a ramp that does not end, and for air far off at a soak's end.
    """
    climate = run.state(Climate, run)
    facts = {"phase": leg.phase, "set_point_degC": leg.to_degC, "switch_on": climate.switch_on}
    with run.unit(leg.unit, **facts):
        climate.unit = leg.unit
        if leg.phase == SOAK:
            climate.follow(leg.lasts_s, f"{leg.unit}: soaking at {leg.to_degC:g} degC")
            run.read(lambda: climate.require_near(leg.to_degC))
        else:
            rate = leg.rate_degC_per_min * SECONDS_PER_MINUTE
            decides = UP if leg.to_degC > leg.from_degC else DOWN
            ramp = TemperatureRamp(CHAMBER, leg.to_degC, rate, decides, decided_by=SOAKS)
            run.apply(ramp)
            climate.follow_ramp(leg)
        climate.follow(LATE_S, f"{leg.unit}: the last samples come")
    climate.stands_degC = leg.to_degC


class Climate:
    """The chamber of one run, and the gyro's pulses once it is warm: followed all the time."""

    def __init__(self, run: Run) -> None:
        parameters: BiasTemperatureParameters = run.parameters
        self.chamber = run.role(CHAMBER, ThermalChamber)
        self.unit = WARM_UP
        self.stands_degC = parameters.room_temperature_degC
        """Where the set-point stands."""
        before = [int(details.get("switch_on", 1)) for details in run.past.finished.values()]
        self.switch_on = 1 + max(before, default=0)
        """Counted through all processes of the run: each switches the gyro on, or finds it on."""
        self._run, self._parameters = run, parameters
        self._pulses: NeedsChanges | None = None
        self._places = PlaceReadings(run)
        self._due_s = run.now_s

    @property
    def _rates(self) -> Rates:
        pulses = {} if self._pulses is None else self._pulses.rates
        return {CHAMBER: 1.0 / self._parameters.chamber_interval_s, **pulses}

    def begin_pulses(self) -> None:
        """Record the gyro's samples from now on."""
        own = self._parameters
        rates: Rates = {GYRO: 1.0 / own.sample_interval_s}
        earth = earth_arcsec_per_s(own.latitude_deg, own.input_axis["IA"])
        weight = own.pulse_weight_arcsec
        self._pulses = NeedsChanges(self._run, self.unit, rates, earth, weight)

    def follow(self, seconds: float, doing: str) -> None:
        """Record for a time."""

        def act() -> None:
            look_until(self._run, self._run.now_s + seconds, self._look, doing, LOOK_S)

        self._run.read(act, takes=exactly(seconds), rates=self._rates)

    def reach(self, degC: float, takes: Duration) -> None:
        """Wait for the chamber's air; raises ConditionNotReached where it does not come."""
        at_most_s = self._parameters.chamber_at_most_s
        doing = f"the chamber goes to {degC:g} degC"
        self._follow_until(lambda: self._off(degC) <= 0.0, takes, at_most_s, doing)
        self._run.read(lambda: self.require_near(degC))

    def follow_ramp(self, leg: Leg) -> None:
        """Record until the set-point is at its end; raises ConditionNotReached where it is not."""
        at_most_s = LONGER * leg.lasts_s + LONGER_S
        takes = Duration(leg.lasts_s, 0.0, at_most_s + LOOK_S)
        doing = f"{leg.unit}: to {leg.to_degC:g} degC"
        self._follow_until(lambda: not self.chamber.is_ramping(), takes, at_most_s, doing)

    def require_near(self, degC: float) -> None:
        """Raise ConditionNotReached where the chamber's air is far from a temperature."""
        if self._off(degC) > 0.0:
            raise ConditionNotReached(
                f"{CHAMBER} did not come to {degC:g} degC, its air stands at "
                f"{self.chamber.temperature_degC():.1f} degC; look at its door, its alarms and its "
                "load"
            )

    def _follow_until(
        self, reached: Callable[[], bool], takes: Duration, at_most_s: float, doing: str
    ) -> None:
        def act() -> None:
            run = self._run
            until_s = run.now_s + at_most_s
            while not reached():
                if run.now_s >= until_s:
                    raise ConditionNotReached(
                        f"{CHAMBER}: {doing}, and is not there after "
                        f"{at_most_s / SECONDS_PER_HOUR:.3g} h, its air stands at "
                        f"{self.chamber.temperature_degC():.1f} degC; look at its door, its alarms "
                        "and its load"
                    )
                look_until(run, run.now_s + LOOK_S, self._look, doing, LOOK_S)

        self._run.read(act, takes=takes, rates=self._rates)

    def _off(self, degC: float) -> float:
        """Return by how much the air is farther from a temperature than the plan lets it be."""
        away = abs(self.chamber.temperature_degC() - degC)
        return away - self._parameters.soaked_within_degC

    def _look(self) -> None:
        """Record what has come, and the chamber's temperature where it is time to.

        The chamber's ramp is stepped by this where its driver does that.
        """
        run = self._run
        if self._pulses is not None:
            self._pulses.unit = self.unit
            self._pulses.take()
        if run.now_s >= self._due_s:
            self._due_s = run.now_s + self._parameters.chamber_interval_s
            air, set_point = self.chamber.temperature_degC(), self.chamber.set_point_degC()
            keep_row(run, self.unit, CHAMBER, CHAMBER_COLUMNS, air, set_point)
        self._places.look(self.unit)
