"""Faults of the simulated bench: other bytes on a wire, or another world; never another driver."""
