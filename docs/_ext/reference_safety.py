"""How each role is made safe, as the roles declare it."""

from __future__ import annotations

from tables import code, table

from station import roles


def safe_states() -> str:
    """Return the table of safe states."""
    rows = [
        (code(role), state.brought_to, state.proven_by)
        for role, state in roles.safe_states().items()
    ]
    return table(("role", "brought to", "proven by"), rows)
