"""Where what the fits of the other six axes rest on comes from: names of rows of their budgets."""

from __future__ import annotations

NOISE = "noise"
TILT, MOUNTING, EDGE = "prior_tilt", "prior_mounting", "prior_edge"
SECOND_ORDER = "prior_accelerometer_second_order"
DIRECTIONS = "prior_directions"
FIELD, INCLINATION = "prior_earth_field_magnitude", "prior_earth_field_inclination"
