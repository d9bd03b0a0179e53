"""Lines to instruments: one connection, one lock, one exchange at a time, each with a deadline."""
