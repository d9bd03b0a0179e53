"""The limits of the lines' part, each with its reason; the shipped plan states the same."""

SLOWEST_MS = 250.0
"""Half of the 0.5 s that an exchange may take: more of that and interlocks, which look every
0.2 s, look too late."""
NEAR = 0.5
"""The share of its deadline from which an answer is near it: another day may take twice as long."""
LOST = 0
"""A sound line loses no answer of fifty."""
