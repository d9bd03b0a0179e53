"""The limits of the probe's part, each with its reason; the shipped plan states the same."""

PROBE_FIELD_ERROR = 0.002
"""Relative: the field at the probe over that at the centre. The place of a probe matters by what it
costs of the field; this is less than half of a gaussmeter's usual 0.5 % (k = 2)."""
HOMOGENEITY = 0.005
"""Relative, within the device: as much as the gaussmeter's own uncertainty."""
COVERAGE = 2.0
"""Standard uncertainties by which the place must be off before it is named."""
MIN_SHARE = 0.5
"""Of the commanded field: a coil with less on its own axis is another one, or not connected."""
SPACING_U = 0.01
"""Relative standard uncertainty of a Helmholtz pair's spacing: windings of some width."""
