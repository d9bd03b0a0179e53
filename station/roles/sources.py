"""What a driver says of its commands: where each is documented, and whether that is confirmed.

A row of the section `Commands and their sources:` is `command - what for - source - confirmed`, or
`not confirmed` at its end: not in a primary source, nor in several clients of real units. It may go
on in lines that are indented further.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from typing import NamedTuple

TITLE = "Commands and their sources:"
CONFIRMED, NOT_CONFIRMED = "confirmed", "not confirmed"
SEPARATOR, JOINED = " - ", ", "
INDENT = re.compile(r" *")


class Row(NamedTuple):
    """A command, what it is for, where it is documented, and whether that is confirmed."""

    command: str
    purpose: str
    source: str
    confirmed: str


def not_confirmed(driver: type) -> Iterator[str]:
    """Yield the commands of a driver that are not confirmed, each by itself."""
    for row in rows_of(driver):
        if row.confirmed == NOT_CONFIRMED:
            yield from row.command.split(JOINED)


def rows_of(driver: type) -> list[Row]:
    """Return what the docstrings of a driver and of what it is made of say; ValueError for a
    row that is none."""
    texts = [text for text in docstrings(driver) if TITLE in text]
    return list(dict.fromkeys(row for text in texts for row in section(text, driver.__name__)))


def docstrings(driver: type) -> Iterator[str]:
    """Yield the docstrings of a driver's classes and of their modules."""
    for part in driver.__mro__:
        yield inspect.cleandoc(part.__doc__ or "")
    for name in dict.fromkeys(part.__module__ for part in driver.__mro__):
        yield inspect.cleandoc(sys.modules[name].__doc__ or "")


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
        if len(parts) != len(Row._fields) or parts[-1] not in (CONFIRMED, NOT_CONFIRMED):
            raise ValueError(f"{where}: {entry!r} is no 'command - for - source - confirmed'")
        yield Row(*parts)
