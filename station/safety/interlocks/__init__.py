"""Limits on the level of any published quantity, watched outside the sequence of steps."""
