"""The physical truth that the simulated instruments share."""
