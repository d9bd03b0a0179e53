"""What `validate` says of a plan that has no fault: what it determines, and how well."""

from __future__ import annotations

from procedures.fog_scale_factor_temperature.expected import expected_uncertainty
from procedures.fog_scale_factor_temperature.parameters import FogParameters
from station.report.numbers import format_number


def outlook(parameters: FogParameters) -> tuple[str, ...]:
    """Return in lines what a plan determines and how well."""
    expected = expected_uncertainty(parameters)
    schedule = parameters.schedule
    low, high = parameters.temperature_range_degC
    order = parameters.initial_order
    lines = [
        f"about {expected.sets} sets of {len(parameters.signs)} turns about each of "
        f"{', '.join(parameters.axes)}, {low:g} degC to {high:g} degC; a set takes "
        f"{schedule.set_s:.0f} s of {schedule.interval_s:g} s",
        f"noise of a turn {format_number(expected.turn_ppm, 2)} ppm, of which the heading's "
        f"resolution makes {format_number(expected.resolution_ppm, 2)} ppm",
        f"scale_factor_error, order {order}: u = {format_number(expected.rms_ppm, 2)} ppm over "
        f"the range, {format_number(expected.end_ppm, 2)} ppm at its ends",
    ]
    if expected.bias_ppm:
        lines.append(
            f"the gyro's bias adds u = {format_number(expected.bias_ppm, 2)} ppm, the same at all "
            "temperatures; turns: pairs would cancel it"
        )
    if parameters.outside:
        lines.append(f"outside the published range: {'; '.join(parameters.outside)}")
    return tuple(lines)
