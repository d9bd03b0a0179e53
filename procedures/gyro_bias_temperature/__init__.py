"""The bias of a gyro over temperature: soaks and ramps in a chamber, the gyro at rest.

Source: JJF 1535, bias temperature sensitivity (title seen, formula by public use; no clause is
quoted). Numbered as the station does it: mount, on at room temperature, soaks, back and off.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from procedures.common.gyro_source import GYRO
from procedures.common.places import record_uses
from station.procedure import LazyImport, Procedure, RecordUse, ResultKind

from .parameters import UNITS, BiasTemperatureParameters
from .steps import STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def records(parameters: BiasTemperatureParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records."""
    return (RecordUse(GYRO, "scale", 1.0, "1"), *record_uses(bench))


def outlook(parameters: BiasTemperatureParameters) -> Sequence[str]:
    """Return what a plan determines, before anything moves."""
    legs = (*parameters.outward, *parameters.homeward)
    rows = sum(leg.lasts_s for leg in legs) / parameters.row_interval_s
    low, high = min(parameters.soaks_degC), max(parameters.soaks_degC)
    lines = [
        f"{rows:.0f} rows of {parameters.row_interval_s:g} s; a curve from {low:g} degC to "
        f"{high:g} degC and what the gyro warms itself",
    ]
    if parameters.sensor_lag_prior_s:
        lines.append(
            "on a curve that is nearly a line the sensitivity to the rate of temperature rests on "
            f"the stated {parameters.sensor_lag_prior_s:g} s of the sensor's lag"
        )
    return lines


PROCEDURE = Procedure(
    name="gyro-bias-temperature",
    title="Gyro at rest: bias over temperature",
    source="JJF 1535, bias temperature sensitivity (no clause is quoted)",
    parameters=BiasTemperatureParameters,
    results={name: ResultKind(("IA", "X", "Y", "Z"), unit) for name, unit in UNITS.items()},
    steps=STEPS,
    records=records,
    evaluate_run=LazyImport(f"{__name__}.evaluate:findings_of_run"),
    evaluate_dataset=LazyImport(f"{__name__}.evaluate:findings_of_dataset"),
    conditions=LazyImport(f"{__name__}.dataset:Conditions").get,
    report=LazyImport(f"{__name__}.figures:draw_parts"),
    outlook=outlook,
    measured_axes=lambda parameters: dict.fromkeys(UNITS, ("IA",)),
    assumptions=(
        "The curve is the bias at rest in the middle of its hysteresis loop, against the "
        "temperature that the thermometer reads: its offset is in u only where it is stated.",
        "Without a thermometer of the gyro the temperature is the chamber's: a gyro that warms "
        "itself is warmer than that by an amount that nothing here shows.",
        "With a curve that is nearly a line the lag of the sensor and the sensitivity to the rate "
        "of temperature are one: the stated prior of the lag decides between them.",
        "Another switch-on has another bias: its repeatability is in no u here.",
    ),
)
