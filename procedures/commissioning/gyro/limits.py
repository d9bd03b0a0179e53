"""The limits of the gyro's part, each with its reason; the shipped plan names the same."""

PULSE_WEIGHT = 0.005
"""Relative. Half of 1 %; a bias of 0.01 deg/h and an input axis within 0.05 deg leave 0.26 %
(k = 2) at 40 deg of latitude."""
MIN_SHARE = 0.1
"""Of the earth's rate: a gyro that counts less of it counts nothing."""
COVERAGE = 2.0
"""Standard uncertainties by which a figure must be beyond its limit to be named as a cause."""
