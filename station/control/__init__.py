"""Pause, abort and ask a run from another terminal of the same user."""
