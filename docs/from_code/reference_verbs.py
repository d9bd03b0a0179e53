"""The verbs, exit codes and units, read from the program itself."""

from __future__ import annotations

import inspect
from typing import Any

import typer
from tables import code, first_sentence, table

from station import errors
from station.cli.app import app
from station.units import UNITS, dimension_of, expectation

EXIT_MEANINGS = {
    "EXIT_DONE": "done, and within limits where limits were asked for",
    "EXIT_OUTSIDE_LIMIT": "done, and a result is outside a limit",
    "EXIT_WRONG_INPUT": "wrong usage, plan, bench file or data",
    "EXIT_FAULT": "a fault of an instrument or of the station, "
    "a safe state that could not be verified, or a wrong excitation of the device",
    "EXIT_ABORTED": "ended by a person",
    "EXIT_INTERLOCK": "an interlock tripped, or one that did waits for `station acknowledge`",
    "EXIT_UNDETERMINED": "a quantity that has a limit is undetermined, undecidable or not returned",
}


def verbs() -> str:
    """Return a section for each verb: its own help."""
    group: Any = typer.main.get_command(app)
    sections = []
    for name, command in sorted(group.commands.items()):
        if not command.hidden:
            context = command.context_class(command, info_name=f"station {name}")
            sections.append(f"## station {name}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(sections)


def exit_codes() -> str:
    """Return the table of exit codes with the errors that end in each."""
    classes = [
        one
        for _, one in inspect.getmembers(errors, inspect.isclass)
        if issubclass(one, errors.StationError)
    ]
    rows = []
    for name, number in inspect.getmembers(errors, lambda one: isinstance(one, int)):
        if not name.startswith("EXIT_"):
            continue
        why = [first_sentence(one.__doc__) for one in classes if own_code(one) == number]
        rows.append((code(number), EXIT_MEANINGS[name], " ".join(why)))
    rows.sort()
    return table(("code", "meaning", "errors that end so"), rows)


def own_code(error: type) -> int | None:
    """Return the exit code of an error class; None for the class that stands for all."""
    return None if error is errors.StationError else int(getattr(error, "exit_code", -1))


def units() -> str:
    """Return the closed list of units by dimension."""
    grouped: dict[str, list[str]] = {}
    for unit in UNITS:
        grouped.setdefault(dimension_of(unit), []).append(unit)
    rows = [
        (expectation(members[0]).partition(" such as ")[0].removeprefix("an ").removeprefix("a "),
         ", ".join(code(unit) for unit in members),
         code(expectation(members[0]).partition(" such as ")[2].strip("'")))
        for members in grouped.values()
    ]  # fmt: skip
    return table(("quantity", "units", "written"), rows)
