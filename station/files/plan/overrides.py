"""`--set key=value`: a value of a plan changed on the command line.

A fault is placed at `--set:2:12`: the second `--set`, twelfth character.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from station.files.faults import Fault, FaultList, dotted
from station.files.plan.extends import EXTENDS
from station.files.yaml.document import Document, Mark, Where
from station.files.yaml.reading import plain_scalar, read_yaml_text
from station.files.yaml.text import lookalikes

OPTION = "--set"
_OPENS_YAML = "[{\"'"
_KEY = "value: "
EXAMPLE = "parameters.frequency=0.2 Hz"


def override(document: Document, given: Sequence[str]) -> list[Fault]:
    """Change a document as every `--set` says, in their order, and return the faults."""
    faults: list[Fault] = []
    seen: dict[Where, int] = {}
    for number, text in enumerate(given, start=1):
        key, equals, value = text.partition("=")
        where: Where = tuple(key.strip().split("."))
        start = len(key) + 2
        if not equals or not all(where):
            what = f"'{text}' is not key=value; write it like {EXAMPLE}"
            faults.append(Fault(OPTION, number, 1, key.strip() or OPTION, what))
        elif where == (EXTENDS,):
            what = "a plan extends what its file says; write a plan that extends the other"
            faults.append(Fault(OPTION, number, 1, EXTENDS, what))
        elif where in seen:
            what = f"is set twice, first by {OPTION} number {seen[where]}; keep one"
            faults.append(Fault(OPTION, number, 1, dotted(where), what))
        else:
            seen[where] = number
            try:
                read = _value(value, number, start, dotted(where))
            except FaultList as found:
                faults.extend(found.faults)
                continue
            fault = _way(document, where, number)
            if fault is None:
                document.graft(where, read, ("value",))
                document.key_positions[where] = Mark(number, 1, OPTION)
            else:
                faults.append(fault)
    return faults


def _way(document: Document, where: Where, number: int) -> Fault | None:
    """Make sure that mappings lead to a path; return a fault when something else is in the way."""
    holder: Any = document.data
    for depth, part in enumerate(where[:-1], start=1):
        here = where[:depth]
        if part not in holder:
            holder[part] = {}
            document.positions[here] = document.key_positions[here] = Mark(number, 1, OPTION)
        holder = holder[part]
        if not isinstance(holder, dict):
            what = f"'{dotted(here)}' holds a value and no keys"
            return Fault(OPTION, number, 1, dotted(where), what)
    return None


def _value(text: str, number: int, start: int, where: str) -> Document:
    """Return the value of a `--set` that begins at column `start` as the document `value: …`."""
    stripped = text.strip()
    start += len(text) - len(text.lstrip())
    if stripped.startswith(tuple(_OPENS_YAML)):
        return _yaml_value(stripped, number, start, where)
    wrong = [
        Fault(OPTION, number, start + column - 1, where, what)
        for _, column, what in lookalikes(stripped)
    ]
    if wrong:
        raise FaultList(wrong)
    document = Document({"value": plain_scalar(stripped)}, Path(OPTION), text)
    document.positions["value",] = Mark(number, start, OPTION)
    document.scalars["value",] = stripped
    return document


def _yaml_value(text: str, number: int, start: int, where: str) -> Document:
    """Return a quoted text or a list in brackets, with its places on the command line."""
    shift = start - len(_KEY) - 1
    try:
        document = read_yaml_text(_KEY + text, Path(OPTION))
    except FaultList as found:
        raise FaultList(
            replace(fault, line=number, column=max(fault.column + shift, 1), where=where)
            for fault in found.faults
        ) from None
    value = document.data["value"]
    if isinstance(value, dict) or "\n" in text:
        what = f"set one value, or a list in brackets, with each {OPTION}; keys are joined by dots"
        raise FaultList([Fault(OPTION, number, start, where, what)])
    for marks in (document.positions, document.key_positions):
        marks.update({at: Mark(number, m.column + shift, OPTION) for at, m in marks.items()})
    return document
