"""The bias of a gyro over temperature: soaks and ramps in a chamber, the gyro at rest.

Source: JJF 1535, bias temperature sensitivity (title seen, formula by public use; no clause is
quoted).
"""

from __future__ import annotations

from procedures.common.imported import imported_only
from station.procedure import LazyImport, ResultKind

UNITS = {
    "bias": "deg/h",
    "bias_temperature_sensitivity": "deg/h/degC",
    "largest_bias_slope": "deg/h/degC",
    "bias_rate_sensitivity": "deg/h/(degC/min)",
    "hysteresis": "deg/h",
    "sensor_lag": "s",
    "chamber_lag": "s",
}
"""The results and their units, in the order of the contract."""

PROCEDURE = imported_only(
    __name__,
    "bias over temperature",
    name="gyro-bias-temperature",
    title="Gyro at rest: bias over temperature (imported data)",
    source="JJF 1535, bias temperature sensitivity (no clause is quoted)",
    results={name: ResultKind(("IA", "X", "Y", "Z"), unit) for name, unit in UNITS.items()},
    report=LazyImport(f"{__name__}.figures:draw_parts"),
    assumptions=(
        "The curve is the bias at rest in the middle of its hysteresis loop, against the "
        "temperature that the thermometer reads: its offset is not in u.",
        "Without a thermometer of the gyro the temperature is the chamber's: a gyro that warms "
        "itself is warmer than that by an amount that nothing here shows.",
        "With a curve that is nearly a line the lag of the sensor and the sensitivity to the rate "
        "of temperature are one: the stated prior of the lag decides between them.",
        "Another switch-on has another bias: its repeatability is in no u here.",
    ),
)
