"""The limits of the pick-up part, each with its reason; the shipped plan states the same."""

PICK_UP_UV = 5.0
"""5 ug of an accelerometer of 1 V/g at 0.5 mT: what its noise leaves of a reading of a second."""
COVERAGE = 2.0
"""Standard uncertainties by which a line must be beyond before it is named."""
OF_ROOM = 0.5
"""Of a line with a coil driven: so much of it with all coils off is not the coil's."""
