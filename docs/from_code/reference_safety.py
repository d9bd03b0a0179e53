"""How each role is made safe, as the roles declare it."""

from __future__ import annotations

from tables import code, table

from station import role_lookup


def safe_states() -> str:
    """Return the table of safe states."""
    rows = [
        (code(role), state.brought_to, state.proven_by)
        for role, state in role_lookup.safe_states().items()
    ]
    return table(("role", "brought to", "proven by"), rows)
