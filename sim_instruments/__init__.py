"""Simulated instruments: one physical world, and one simulated instrument per driver.

Written from the instruments' manuals alone, never from the drivers, so that an error on either
side shows up against the other.
"""

DISTRIBUTION = "inertial-station"
