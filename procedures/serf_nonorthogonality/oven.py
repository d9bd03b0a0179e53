"""Step 1: the cell brought to its working temperature, by its heater or by a person."""

from __future__ import annotations

from station.errors import ConditionNotReached
from station.method.cell_commands import CellHeat
from station.method.duration import Duration
from station.method.prompts import AskedValue
from station.method.run import Run
from station.method.verbs import keep_row
from station.procedure import Prompt
from station.roles import CellHeater

from .parameters import SerfParameters

HEATER = "cell_heater"
WARM_UP, LOOKS = "cell-warm-up", "looks"
"""What rows of the heater belong to beside the shots."""
COLUMNS = {
    "temperature_degC": "degC, the cell's sensor",
    "set_point_degC": "degC, what it is controlled to",
    "power_percent": "%, of the heater's range",
}
ROOM_DEGC = 20.0
LOOK_S = 5.0
SECONDS_PER_MINUTE = 60.0
TEMPERATURE = ("parameters", "cell_temperature")
HEAT = Prompt(
    "heat-cell",
    "Bring the cell to its working temperature and let it settle.",
    value=AskedValue("cell temperature", "degC", 20.0, 250.0),
)


def cell_record(degC: float) -> tuple[str, float, str]:
    """Return quantity, value and unit of the calibration record of the cell's sensor."""
    return "temperature", degC, "degC"


def is_driven(run: Run) -> bool:
    """Whether the plan says how warm the cell is to be, so that its heater is driven."""
    return run.parameters.cell_temperature_degC is not None


class Oven:
    """The heater of one run."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._parameters: SerfParameters = run.parameters
        self._heater = run.role(HEATER, CellHeater)
        self._heater.programme_limits()

    def heat(self) -> None:
        """Go to the plan's temperature and wait until it has been stable for the plan's time."""
        degC, rate = (
            self._parameters.cell_temperature_degC,
            self._parameters.heating_rate_degC_per_min,
        )
        assert degC is not None
        rule = self._parameters.stability
        self._run.event("field-on", instrument=HEATER)
        self._run.apply(CellHeat(HEATER, degC, rate, decided_by=TEMPERATURE))
        ramp_s = SECONDS_PER_MINUTE * abs(degC - ROOM_DEGC) / rate
        expected_s = min(ramp_s + rule.duration_s, rule.at_most_s)
        takes = Duration(expected_s, rule.duration_s, rule.at_most_s + LOOK_S)
        self._run.count_rows(HEATER, expected_s / LOOK_S)
        self._run.read(lambda: self._settle(degC), takes=takes)

    def record(self, unit: str) -> float:
        """Record the temperature now, and what the heater does, for a unit; return it in degC."""
        heater = self._heater
        seen = heater.temperature_degC(), heater.set_point_degC(), heater.power_percent()
        keep_row(self._run, unit, HEATER, COLUMNS, *seen)
        return seen[0]

    def _settle(self, degC: float) -> None:
        """Record until it is stable; raises ConditionNotReached where it does not become so."""
        run, rule = self._run, self._parameters.stability
        until_s, since_s = run.now_s + rule.at_most_s, None
        while True:
            seen_degC, ramps = self.record(WARM_UP), self._heater.is_ramping()
            if ramps or abs(seen_degC - degC) > rule.within_degC:
                since_s = None
            elif since_s is None:
                since_s = run.now_s
            if since_s is not None and run.now_s - since_s >= rule.duration_s:
                return
            if run.now_s >= until_s:
                raise ConditionNotReached(
                    f"{HEATER}: the cell is not stable at {degC:g} degC after "
                    f"{rule.at_most_s / SECONDS_PER_MINUTE:.3g} min, it stands at "
                    f"{seen_degC:.2f} degC; look at the heater, at its loop's settings and at the "
                    "plan's stability"
                )
            run.clock.sleep(LOOK_S)
            run.say_progress(f"the cell is heated to {degC:g} degC, {seen_degC:.1f} degC now")


def record(run: Run, unit: str) -> None:
    """Record the temperature of a cell that its heater keeps warm."""
    if is_driven(run):
        run.state(Oven, run).record(unit)
