"""The limits of a commissioning, each with its reason; the shipped plan states the same."""

COIL_CONSTANT = 0.015
"""Relative. A field that is off by more shifts a sensitivity by more than its usual budget; a
gaussmeter of 0.5 % (k = 2) decides it."""
CROSS_AXIS = 0.05
"""Relative to the coil's field: 3 deg, more than windings and probe are set up to by eye."""
AMBIENT_NOISE_MT = 0.005
"""Standard deviation of single readings. More than that is traffic, a lift or a loose probe."""
FIELD_AFTER_OFF_MT = 0.01
"""A supply at rest carries up to `zero_current`, 20 mA, and a coil makes up to 0.4 mT/A."""
ALIKE = 0.0075
"""Relative. Three coils that are off by as much differ from the statements by one cause."""
AMBIENT_MT = 0.005
"""Beyond what map and compass leave open: iron, a magnet, a gaussmeter that was not zeroed."""
EARTH_MT = 0.1
"""The earth's field is 0.02 mT to 0.07 mT."""
DRIFT = {"coil_constant_ratio": 0.005, "cross_axis": 0.01, "ambient_field": 0.003}
"""From week to week: half of what a gaussmeter of 0.5 % leaves open; 0.6 deg, a coil that was
knocked; in mT, a steel door or a car."""
MIN_SHARE = 0.1
"""Of the commanded field: a coil that makes less on every axis is not connected."""
COVERAGE = 2.0
"""Standard uncertainties by which a cause must differ from another one to be named alone."""
