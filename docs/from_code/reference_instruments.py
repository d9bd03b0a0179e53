"""What each driver sends, where that is documented, and whether its simulator knows it.

A row of the section `Commands and their sources:` is `command - what for - source - confirmed`, or
`not confirmed` at its end: not in a primary source, nor in several clients of real units. It may go
on in lines that are indented further.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from typing import NamedTuple

from simulated import answered
from tables import code, first_sentence, table

from station import registry

TITLE = "Commands and their sources:"
HEAD = ("command", "for", "source", "confirmed")
WORDS = ("confirmed", "not confirmed")
SEPARATOR = " - "
INDENT = re.compile(r" *")


class Row(NamedTuple):
    """A command, what it is for, where it is documented, and whether that is confirmed."""

    command: str
    purpose: str
    source: str
    confirmed: str


def instruments() -> str:
    """Return a section for each driver of the station's own."""
    parts = []
    for name, driver in own_drivers().items():
        module = importlib.import_module(driver.__module__)
        parts.append(f"## {name}\n\n{first_sentence(module.__doc__)}\n\n")
        rows = [
            (code(one.command), *one[1:], answered(name, one.command)) for one in rows_of(driver)
        ]
        parts.append(table((*HEAD, "simulator"), rows) + "\n")
    return "".join(parts)


def own_drivers() -> dict[str, type]:
    """Return the drivers that come with the station, by name."""
    loaded = {
        name: registry.load(registry.DRIVERS, name) for name in registry.names(registry.DRIVERS)
    }
    return {name: one for name, one in loaded.items() if one.__module__.startswith("drivers.")}


def rows_of(driver: type) -> list[Row]:
    """Return what the docstrings of a driver and of what it is made of say; ValueError for a
    row that is none."""
    texts = [text for text in docstrings(driver) if TITLE in text]
    return list(dict.fromkeys(row for text in texts for row in section(text, driver.__name__)))


def docstrings(driver: type) -> Iterator[str]:
    """Yield the docstrings of a driver's classes and of their modules."""
    modules = [one for one in driver.__mro__ if one.__module__.startswith("drivers.")]
    for one in modules:
        yield inspect.cleandoc(one.__doc__ or "")
    for name in dict.fromkeys(one.__module__ for one in modules):
        yield inspect.cleandoc(importlib.import_module(name).__doc__ or "")


def section(text: str, where: str) -> Iterator[Row]:
    """Yield the rows of a docstring's section; ValueError for one that is none."""
    lines = text.partition(TITLE)[2].splitlines()[1:]
    entries: list[str] = []
    margin = None
    for line in lines:
        indent = len(INDENT.match(line)[0])  # type: ignore[index]  # it matches everything
        if not line.strip():
            continue
        if indent == 0:
            break
        margin = indent if margin is None else margin
        if indent == margin:
            entries.append(line.strip())
        else:
            entries[-1] += f" {line.strip()}"
    for entry in entries:
        parts = entry.split(SEPARATOR)
        if len(parts) != len(Row._fields) or parts[-1] not in WORDS:
            raise ValueError(f"{where}: {entry!r} is no 'command - for - source - confirmed'")
        yield Row(*parts)
