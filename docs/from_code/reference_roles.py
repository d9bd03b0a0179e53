"""The roles, as each declares itself in `station/roles`."""

from __future__ import annotations

import inspect
from collections.abc import Iterator

from reference_keys import HEAD, key_rows
from tables import code, first_sentence, table

from station.roles.role import Limit, Quantity, Role
from station.roles.role import roles as all_roles
from station.roles.role import safe_states as all_safe_states


def roles() -> str:
    """Return a section for each role."""
    return "\n".join("".join(section(one)) for one in all_roles().values())


def section(role: Role) -> Iterator[str]:
    """Yield what a role declares."""
    yield f"## {role.name}\n\n"
    yield f"{inspect.cleandoc(role.protocol.__doc__ or '')}\n\n"
    yield f"Protocol {code(role.protocol.__name__)}; in a bench file "
    yield ", ".join(code(name) for name in role.instances) + ".\n\n"
    yield table(("verb", "does"), verb_rows(role))
    attributes = [name for name in role.attributes if name != "place"]
    if attributes:
        yield f"\nAttributes: {', '.join(map(code, attributes))}.\n"
    if role.limits:
        yield "\n" + table(("limit", "kept in", "must be given", "meaning"), limit_rows(role))
    if role.settings is not None:
        yield "\n" + table(("setting", *HEAD[1:]), key_rows(role.settings, {}))
    if role.quantities:
        yield "\n" + table(
            ("quantity", "state or unit", "looked at every", "magnitude"), quantity_rows(role)
        )
    if role.safe_state is None:
        yield "\nIt cannot harm.\n"
    else:
        yield f"\nSafe state: {role.safe_state.brought_to}. "
        yield f"Proven by: {role.safe_state.proven_by}.\n"


def verb_rows(role: Role) -> list[tuple[str, str]]:
    """Return each verb with its parameters, their types, and the first line of its docstring."""
    return [
        (code(f"{name}{signature_of(role, name)}"), described(role, name)) for name in role.verbs
    ]


def signature_of(role: Role, verb: str) -> str:
    """Return a verb's parameters and what it returns, with their types as the Protocol has them."""
    signature = inspect.signature(getattr(role.protocol, verb))
    _, *given = signature.parameters.values()
    return str(signature.replace(parameters=given)).replace("'", "")


def described(role: Role, verb: str) -> str:
    """Return the first line of a verb's docstring."""
    return first_sentence(getattr(role.protocol, verb).__doc__)


def limit_rows(role: Role) -> list[tuple[str, str, str, str]]:
    """Return the limits that a bench file may give."""

    def row(name: str, limit: Limit) -> tuple[str, str, str, str]:
        return code(f"limits.{name}"), limit.unit, "yes" if limit.needed else "", limit.meaning

    return [row(name, limit) for name, limit in role.limits.items()]


def quantity_rows(role: Role) -> list[tuple[str, str, str, str]]:
    """Return what an interlock may watch."""

    def row(name: str, kind: Quantity) -> tuple[str, str, str, str]:
        what = " or ".join(code(state) for state in kind.states) or kind.unit
        often = f"{kind.period_s:g} s" + (" while energised" if kind.while_on else "")
        return code(name), what, often, "yes" if kind.magnitude else ""

    return [row(name, kind) for name, kind in role.quantities.items()]


def safe_states() -> str:
    """Return the table of safe states."""
    rows = [
        (code(name), state.brought_to, state.proven_by) for name, state in all_safe_states().items()
    ]
    return table(("role", "brought to", "proven by"), rows)
