"""The limits of the chamber's part, each with its reason; the shipped plan states the same."""

OVERSHOOT_K = 1.0
"""A fifth of the step: more delays each soak, and a small device is warmer than the plan allows."""
STEADY_ERROR_K = 0.5
"""What a chamber's own sensor is usually stated to, against its controller's set-point."""
GAIN = 0.2
"""A thermometer in the device shows the whole step in the end; the fit leaves a few percent."""
FOLLOWS = 0.5
"""Of the step: a thermometer that shows less does not stand in the chamber."""
IN_AIR_S = 120.0
"""A thermometer in a device of some hundred grams lags by more, whatever the others do."""
IN_AIR = 3.0
"""A thermometer that lags so many times less than the others' middle one stands in the air."""
COVERAGE = 2.0
"""Standard uncertainties by which a figure must be beyond before a cause is named."""
