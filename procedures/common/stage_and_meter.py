"""A device on a rotary stage that a voltmeter reads, and its thermometer: what a position takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from station import registry
from station.errors import InstrumentError
from station.findings import Findings, Flag, extremes
from station.method.commands import Angle, Homing, MeterRange
from station.method.duration import Duration, exactly, on_the_way
from station.method.run import NO_ROWS, Rates, Run
from station.method.verbs import come_to_rest, fetch_bursts, keep, keep_row
from station.procedure import Problem
from station.roles import Multimeter, RotaryStage, Thermometer

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

MULTIMETER, THERMOMETER, STAGE = "multimeter", "thermometer", "rotary_stage"
POWER = "dut_power"
USUAL_DEGC = 20.0
"""Where the record of the thermometer is asked how well it reads."""
LARGEST_G = 1.1
"""What the voltmeter's first range must hold, in the scale factor's units of 1 g."""
MAX_RANGES, HIGHER_RANGE = 3, 10.0
LOOK_S, MAX_LOOK_S = 0.25, 2.0
TURN_S, TURN_DEG_PER_S = 0.75, 20.0
"""A stage of the usual rate."""
HOMING_S = 10.0
STAGE_COLUMNS = {
    "angle_deg": "deg, the stage's encoder, at rest",
    "desired_deg": "deg, the angle that was commanded",
}
SAME_POINTS = 3
"""So many points in a row may not read the same."""
ARRIVAL = "arrival_time_s"


class OfOutput(Protocol):
    """What a plan says of how the output is read."""

    @property
    def readings(self) -> int:
        """How many in a burst."""
        ...

    @property
    def nplc(self) -> float:
        """The integration time of each, in power-line cycles."""
        ...

    @property
    def scale_factor_V_per_g(self) -> float:
        """The nominal one, which decides the range."""
        ...

    @property
    def temperature(self) -> bool:
        """Whether a thermometer is read beside them."""
        ...


@dataclass
class AtStage:
    """Where stage and voltmeter stand: what the next point need not set again.

    Angle or field change from each point to the next, and every reading has noise: one that is the
    same to the last digit over several points is no measurement, and its fit would look perfect.
    """

    angle_deg: float | None = None
    range_V: float = 0.0
    outputs_V: list[set[float]] = field(default_factory=list)

    def read(self, instrument: str, unit: str, readings_V: set[float]) -> None:
        """Take the readings of a point; raises InstrumentError where three points read the same."""
        self.outputs_V = [*self.outputs_V[1 - SAME_POINTS :], readings_V]
        if len(self.outputs_V) == SAME_POINTS and len(set().union(*self.outputs_V)) == 1:
            raise InstrumentError(
                instrument,
                f"measured {unit}",
                f"it reads {min(readings_V):.9g} V to the last digit for {SAME_POINTS} points",
                "look at its display, its input and what triggers it, then run again",
            )


def find_zero(run: Run) -> None:
    """Have the stage look for its encoder's zero where it does not know it."""
    if run.apply(Homing(STAGE)):
        come_to_rest(run, STAGE, "the stage looks for its zero", takes=on_the_way(HOMING_S))


def turn_to(
    run: Run, angle_deg: float, of: str, doing: str, decided_by: tuple[str, ...] = ()
) -> None:
    """Turn the stage to an angle and wait until it rests; nothing moves where it stands there."""
    place = run.state(AtStage)
    if place.angle_deg == angle_deg:
        return
    way_deg = abs(angle_deg - (place.angle_deg or 0.0))
    takes = on_the_way(TURN_S + way_deg / TURN_DEG_PER_S if way_deg else 0.0)
    run.apply(Angle(STAGE, angle_deg, of, decided_by=decided_by))
    come_to_rest(run, STAGE, f"{doing}, turning to {angle_deg:g} deg", takes=takes)
    place.angle_deg = angle_deg


def record_angle(run: Run, unit: str, commanded_deg: float) -> None:
    """Record what the stage's encoder reads."""
    angle_deg = run.role(STAGE, RotaryStage).angle_deg()
    keep_row(run, unit, STAGE, STAGE_COLUMNS, angle_deg, commanded_deg)


def record_output(
    run: Run,
    unit: str,
    doing: str,
    before: Callable[[], object] = lambda: None,
    meanwhile: Callable[[], object] = lambda: None,
    rates: Rates = NO_ROWS,
) -> None:
    """Record a burst of the voltmeter and the temperature beside it; wider where overloaded.

    `before` is done before each burst, `meanwhile` at each look; that gives rows at `rates`.
    """
    parameters: OfOutput = run.parameters
    bursts: dict[str, Any] = {MULTIMETER: run.role(MULTIMETER, Multimeter)}
    run.count_rows(MULTIMETER, parameters.readings)
    if parameters.temperature:
        bursts[THERMOMETER] = run.role(THERMOMETER, Thermometer)
        run.count_rows(THERMOMETER, 1)
    burst_s = burst_of(parameters)
    again_s = (MAX_RANGES - 1) * burst_s + MAX_RANGES * MAX_LOOK_S
    takes = exactly(burst_s) + Duration(LOOK_S, 0.0, again_s)

    def act() -> None:
        for _ in range(MAX_RANGES):
            before()
            if not _read_output(run, unit, bursts, doing, meanwhile):
                return
            _widen(run, unit)
        raise InstrumentError(
            MULTIMETER,
            f"measured {unit}",
            f"it was overloaded in every range up to {run.state(AtStage).range_V:g} V",
            "look at the accelerometer's output and its load resistor",
        )

    run.read(act, takes=takes, rates=rates)


def burst_of(parameters: OfOutput) -> float:
    """Return the bench time in s of one burst: auto-zero doubles the integration time."""
    return 2.0 * parameters.readings * parameters.nplc / 50.0


def _read_output(
    run: Run,
    unit: str,
    bursts: Mapping[str, Any],
    doing: str,
    meanwhile: Callable[[], object],
) -> bool:
    """Record a burst of each meter; True when the voltmeter was overloaded."""
    parameters: OfOutput = run.parameters
    bursts[MULTIMETER].start(parameters.readings)
    if parameters.temperature:
        bursts[THERMOMETER].start(1)
    overloaded = False
    for name, block in fetch_bursts(
        run, unit, bursts, lasts_s=burst_of(parameters), meanwhile=meanwhile, doing=doing
    ):
        keep(run, unit, bursts[name], block)
        if name == MULTIMETER:
            overloaded = bool(block.columns["overload"].any())
            if not overloaded:
                readings_V = {float(reading_V) for reading_V in block.columns["voltage_V"]}
                run.state(AtStage).read(name, unit, readings_V)
    return overloaded


def _widen(run: Run, unit: str) -> None:
    """Take the next higher range after an overload; the point is then measured again."""
    place = run.state(AtStage)
    before_V = place.range_V
    wider = replace(first_range(run.parameters), largest_V=HIGHER_RANGE * before_V)
    place.range_V = run.apply(wider)
    run.event("overload", unit=unit, range_V=before_V, next_range_V=place.range_V)
    run.say(f"    {unit}: overload, measured again in the {place.range_V:g} V range")


def first_range(parameters: OfOutput) -> MeterRange:
    """Return how the voltmeter is read until it is overloaded."""
    largest_V = LARGEST_G * parameters.scale_factor_V_per_g
    return MeterRange(MULTIMETER, largest_V, parameters.nplc, parameters.readings)


def problems_of_meter(parameters: OfOutput, bench: Bench) -> Iterator[Problem]:
    """Yield what the voltmeter of a bench cannot do, where the bench has one."""
    if MULTIMETER in bench.instruments:
        driver = registry.load(registry.DRIVERS, bench.instruments[MULTIMETER].driver)
        yield from meter_problems(parameters, driver)


def meter_problems(parameters: OfOutput, driver: type[Multimeter]) -> Iterator[Problem]:
    """Yield integration time, range and burst that the voltmeter's driver says it cannot do."""
    if parameters.nplc not in driver.integration_cycles:
        known = ", ".join(f"{cycles:g}" for cycles in driver.integration_cycles)
        yield Problem(
            ("parameters", "nplc"),
            f"the {MULTIMETER} cannot integrate over {parameters.nplc:g} power-line cycles; it can "
            f"do {known}",
        )
    if parameters.readings > driver.most_readings:
        yield Problem(
            ("parameters", "readings"),
            f"the {MULTIMETER} takes {driver.most_readings} readings in a burst at most",
        )
    largest_V = first_range(parameters).largest_V
    if largest_V > driver.highest_V:
        yield Problem(
            ("parameters", "scale_factor"),
            f"the {MULTIMETER} must hold {largest_V:g} V, its highest range ends at "
            f"{driver.highest_V:g} V",
        )


def row_of(
    folder: RunFolder, unit: str, parameters: OfOutput, bench: Bench
) -> tuple[float, float, float, float]:
    """Return a point's time (s), angle (deg), output (V) and temperature (degC; NaN without).

    The output is the mean over its burst; readings that say overload are left out where a higher
    range gave others. The bench file's corrections are applied.
    """
    meter = folder.rows(MULTIMETER, unit)
    good = meter["overload"] == 0
    usable = meter[good] if good.any() else meter
    output_V = bench.corrected(MULTIMETER, "voltage", float(usable["voltage_V"].mean()), "V")
    temperature_degC = math.nan
    if parameters.temperature:
        read_degC = float(folder.rows(THERMOMETER, unit)["temperature_degC"].mean())
        temperature_degC = bench.corrected(THERMOMETER, "temperature", read_degC, "degC")
    read_deg = float(folder.rows(STAGE, unit)["angle_deg"][-1])
    angle_deg = bench.corrected(STAGE, "angle", read_deg, "deg")
    return float(meter[ARRIVAL].mean()), angle_deg, output_V, temperature_degC


def with_overloads(findings: Findings, folder: RunFolder) -> Findings:
    """Return findings with the flag of readings that said overload in finished points, if any."""
    units = folder.finished_units()
    count = sum(int((folder.rows(MULTIMETER, unit)["overload"] != 0).sum()) for unit in units)
    if not count or any(flag.code == "overload" for flag in findings.flags):
        return findings
    message = (
        f"{count} readings of the voltmeter were overloads; they are left out, and their points "
        "were measured again on a higher range."
    )
    overload = Flag("overload", message, None, {"count": count})
    return replace(findings, flags=[*findings.flags, overload])


def what_was_read(
    output_V: NDArray[np.float64], temperature_degC: NDArray[np.float64] | None
) -> dict[tuple[str, str], tuple[float, ...]]:
    """Return between what the means of all points are, as the voltmeter and thermometer read."""
    warmth = () if temperature_degC is None else extremes(temperature_degC)
    return {
        (MULTIMETER, "voltage"): extremes(output_V),
        (THERMOMETER, "temperature"): warmth,
    }


def gain_and_zero(
    bench: Bench, instrument: str, quantity: str, largest: float, unit: str
) -> tuple[float | None, float | None, str]:
    """Return the standard uncertainties of gain (relative) and zero, and what states them.

    The part at zero is common to all readings; the part that grows up to `largest` is a gain.
    """
    u, source = bench.stated(instrument, quantity, largest, unit) or (None, "")
    if u is None:
        return None, None, source
    zero, _ = bench.stated(instrument, quantity, 0.0, unit) or (0.0, "")
    return math.sqrt(max(u**2 - zero**2, 0.0)) / largest, zero, source
