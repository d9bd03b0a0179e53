"""The limits of the stage's part, each with its reason; the shipped plan states the same."""

RESPONSE = 0.1
"""Relative. Scale factors are stated nearer; a stage that counts in other units is far off."""
ZERO_DEG = 0.025
"""Half of 0.05 deg, which an accelerometer feels as 0.9 mg; its mounting is known to 0.008 deg."""
CLOSURE_DEG = 0.01
"""A whole turn comes back to the same level; noise and drift of a minute are a tenth of this."""
LEAN_DEG = 0.05
"""Half of 0.1 deg, by which a level axis of rotation shows as a bias."""
COVERAGE = 2.0
"""Standard uncertainties by which a figure must be beyond its limit to be named as a cause."""
FAR_DEG = 45.0
"""A zero that is off by more is a device mounted along another axis: nothing else is decided."""
