"""The limits of the supplies' part, each with its reason; the shipped plan names the same."""

OWN_LIMIT = 1.05
"""Over the limit that was programmed: a limit of a supply is set to some per cent."""
FIELD_AFTER_CUT_MT = 0.01
"""As after a ramp to zero: 20 mA, what counts as no current, make up to 8 uT in a coil."""
COVERAGE = 2.0
"""Standard uncertainties by which a figure must be beyond its limit to be named as a cause."""
