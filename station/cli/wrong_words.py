"""A command line that cannot be read: what was probably meant comes first, then what there is."""

from __future__ import annotations

import re
from typing import Any

from station.cli.groups import GROUPS
from station.files.faults import listed, nearest

VERB = re.compile(r"No such command '(.*?)'\.(?: Did you mean .*)?", re.DOTALL)
CHOICE = re.compile(r"(?:Value error, )?('(.*)' is not one of ('.*')\.)", re.DOTALL)
EXTRA = "Got unexpected extra argument(s)"
MEANT = "Did you mean {}?"


def say_what_was_meant(error: Any) -> None:
    """Put what was meant into the message of an error of the library that reads the line."""
    if option := getattr(error, "option_name", None):
        near = nearest(option, error.possibilities or ())
        error.possibilities = None
        error.message += f"\n{MEANT.format(near)}" if near else ""
    elif error.message.startswith(EXTRA):
        error.message = error.message.replace("argument(s)", "arguments")
    elif verb := VERB.fullmatch(error.message):
        verbs = [name for group in GROUPS.values() for name in group]
        near = nearest(verb[1], verbs)
        more = MEANT.format(f"'{near}'") if near else f"there are {listed(verbs)}"
        error.message = f"No such command '{verb[1]}'.\n{more}"
    elif choice := CHOICE.fullmatch(error.message):
        near = nearest(choice[2], choice[3].strip("'").split("', '"))
        error.message = f"{MEANT.format(repr(near))}\n{choice[1]}" if near else choice[1]
