"""How long a plan takes, step by step, and how many sets of turns its ramp holds.

The gyros follow the chamber's air late and are warmer than it by their own heat: on a ramp they are
behind where they would come to rest by its rate times their lag, and go on when it has ended.
"""

from __future__ import annotations

import math

from .dataset import SECONDS_PER_HOUR
from .parameters import FogParameters

EXPECTED_HEAT_DEGC = 5.0
"""By how much gyros warm themselves."""

EXPECTED_LAG_S = 2520.0
PROVED_WITHIN_DEGC = 2.0
"""So near to where the first turns were made the proof begins and ends; nearer takes hours."""

APPROACH_S = 2700.0
LEAST_LEFT_DEGC = 0.1


def soak_s(parameters: FogParameters) -> float:
    """Return the expected bench time in s of step 1."""
    warm_s = max(_until_s(EXPECTED_HEAT_DEGC, left_degC(parameters)), parameters.warm_up.window_s)
    steady_s = parameters.alignment_s + min(warm_s, parameters.warm_up.at_most_s)
    return APPROACH_S + parameters.soak_s + steady_s + parameters.random_rotation_s


def ramp_s(parameters: FogParameters) -> float:
    """Return the expected bench time in s of step 2: until the gyros are at the upper end."""
    behind_degC = _behind_degC(parameters, parameters.ramp_rate_degC_per_h)
    return _whole_sets_s(
        parameters, parameters.ramp_rate_degC_per_h, _until_s(behind_degC, EXPECTED_HEAT_DEGC)
    )


def proof_s(parameters: FogParameters) -> float:
    """Return the expected bench time in s of step 4."""
    rule = parameters.verification
    if rule is None:
        return 0.0
    behind_degC = _behind_degC(parameters, rule.ramp_rate_degC_per_h)
    near_degC = max(PROVED_WITHIN_DEGC - left_degC(parameters), LEAST_LEFT_DEGC)
    if rule.direction == "down":
        after_s = _until_s(behind_degC, near_degC)
        return _whole_sets_s(parameters, rule.ramp_rate_degC_per_h, after_s)
    cools_s = APPROACH_S + _until_s(parameters.span_degC, near_degC)
    after_s = _until_s(behind_degC, EXPECTED_HEAT_DEGC)
    return cools_s + _whole_sets_s(parameters, rule.ramp_rate_degC_per_h, after_s)


def sets_of_ramp(parameters: FogParameters) -> int:
    """Return how many sets of turns step 2 makes."""
    return round(ramp_s(parameters) / parameters.set_interval_s)


def left_degC(parameters: FogParameters) -> float:
    """Return how much warmer the gyros would still become when they count as warm."""
    slope_degC_per_s = parameters.warm_up.slope_limit_degC_per_h / SECONDS_PER_HOUR
    return min(slope_degC_per_s * EXPECTED_LAG_S, EXPECTED_HEAT_DEGC)


def _behind_degC(parameters: FogParameters, rate_degC_per_h: float) -> float:
    """Return how far behind the gyros are when a ramp over the plan's range ends."""
    lag_degC = rate_degC_per_h / SECONDS_PER_HOUR * EXPECTED_LAG_S
    return lag_degC * -math.expm1(-parameters.span_degC / lag_degC)


def _until_s(from_degC: float, to_degC: float) -> float:
    """Return the time in which the gyros come from one distance to another, nearer one."""
    return EXPECTED_LAG_S * math.log(max(from_degC / to_degC, 1.0))


def _whole_sets_s(parameters: FogParameters, rate_degC_per_h: float, after_s: float) -> float:
    """Return the time of the sets of turns that a ramp, and what comes after it, take."""
    ramp_s = parameters.span_degC / rate_degC_per_h * SECONDS_PER_HOUR
    sets = math.ceil((ramp_s + after_s) / parameters.set_interval_s - 1e-9) + 1
    return sets * parameters.set_interval_s
