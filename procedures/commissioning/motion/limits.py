"""The limits of the table's part, each with its reason; the shipped plan states the same."""

TURN_RATIO = 0.005
"""Relative. A gyro's scale factor is within 0.1 % (k = 1), wrong counts per turn are not."""
RATE_RATIO = 0.002
"""Relative. A controller's clock is within 0.01 %; its noise at slow rates adds to that."""
ENCODER_ZERO_DEG = 0.025
"""Half of 0.05 deg, which a calibration at rest feels as 0.9 mg; a reversal decides it to 0.008 deg
(k = 2)."""
AXIS_LEAN_DEG = 0.05
"""Half of 0.1 deg, by which a turn tilts a device that should stay level."""
OFF_SQUARE_DEG = 0.08
"""A gyro's own misalignment is within 0.015 deg (k = 1); 0.15 deg are decided by it."""
FOLLOWS = 0.5
"""Of the turn by the encoder: a gyro or an accelerometer that feels less does not turn with it."""
COVERAGE = 2.0
"""Standard uncertainties by which a figure must be beyond its limit to be named as a cause."""
