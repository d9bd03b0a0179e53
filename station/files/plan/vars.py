"""`vars:` of a plan, and `${name}` in the place of a whole value."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

from station.files.faults import Fault, FaultList, listed, nearest
from station.files.yaml.document import Document, Mark, Where, leaves

VARS = "vars"
REFERENCE = re.compile(r"\$\{([^{}]*)\}")
NAME = r"[A-Za-z_][A-Za-z0-9_-]*"


def references(documents: Iterable[Document]) -> set[str]:
    """Return the names of the vars that the documents ask for, whoever gives them."""
    return {
        found.group(1)
        for document in documents
        for written in document.scalars.values()
        if (found := REFERENCE.fullmatch(written))
    }


def fill_in(document: Document, used: set[str]) -> list[Fault]:
    """Put the vars of a document in place of their `${name}`, take `vars` out, return the faults.

    `used` names the vars that any file of the plan asks for: one that nobody asks for is a fault,
    since a misspelt one would change nothing and say nothing. Raises FaultList where `vars` is no
    mapping at all.
    """
    given = document.data.get(VARS, {})
    if not isinstance(given, dict):
        raise FaultList([document.fault((VARS,), "must be a mapping of names and values")])
    faults = [fault for name in given for fault in _var_faults(document, name, used)]
    for where, value in list(leaves(document.data)):
        if where[:1] == (VARS,) or not isinstance(value, str) or "${" not in value:
            continue
        found = REFERENCE.fullmatch(value)
        if found is None:
            what = (
                f"'{value}' holds '${{' within a longer text; a var stands for a whole value: "
                "put all of the text into the var"
            )
            faults.append(document.fault(where, what))
        elif found.group(1) not in given:
            name = found.group(1)
            hint = nearest(name, given)
            what = f"there is no var '{name}'" + ("" if hint else f"; there are {listed(given)}")
            faults.append(document.fault(where, what, hint and f"'${{{hint}}}'"))
        else:
            _put(document, where, found.group(1))
    document.remove(VARS)
    return faults


def _put(document: Document, where: Where, name: str) -> None:
    def stands_in_var(mark: Mark) -> Mark:
        return replace(mark, var=name)

    document.graft(where, document, (VARS, name), stands_in_var)


def _var_faults(document: Document, name: str, used: set[str]) -> Iterable[Fault]:
    where: Where = (VARS, name)
    if not re.fullmatch(NAME, name):
        what = "is no name of a var; a name has letters, digits, '_' and '-'"
        yield document.fault(where, what, at_key=True)
    elif name not in used:
        hint = nearest(name, used)
        what = f"no value of the plan is '${{{name}}}'; use the var or delete it"
        yield document.fault(where, what, hint and f"'{hint}'", at_key=True)
    for place, value in leaves(document.at(where), where):
        if isinstance(value, dict) or any(isinstance(part, str) for part in place[2:]):
            yield document.fault(where, "a var is one value or a list of values, not a mapping")
            return
        if isinstance(value, str) and "${" in value:
            yield document.fault(place, "a var may not ask for another var; write the value out")
