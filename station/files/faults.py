"""A fault in a file that a person wrote: where it stands, what is wrong, what to write instead."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from station.errors import InputError

MAX_FAULTS = 20
"""So many faults are listed, then how many more there are."""
LONGEST = 600
"""So many characters of a key or a value are shown."""


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong in a file; line and column count from 1."""

    file: str
    line: int
    column: int
    where: str
    what: str
    hint: str | None = None

    @property
    def said(self) -> str:
        """What is wrong and what was probably meant, for whoever knows the place."""
        return meant(self.what, self.hint)

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}"
        return f"{place}: {shortened(self.where)}: {shortened(self.said)}"


class FaultList(InputError):
    """Every fault of one or several files, in the order in which they stand there."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults: tuple[Fault, ...] = tuple(sorted(faults, key=_place))
        super().__init__("\n".join(shown(self.faults)))


def shown(faults: Sequence[Fault]) -> list[str]:
    """Return the lines of the first faults, and one that counts the others."""
    more = len(faults) - MAX_FAULTS
    rest = [f"and {more} more faults"] if more > 0 else []
    return [*(str(fault) for fault in faults[:MAX_FAULTS]), *rest]


def shortened(text: str) -> str:
    """Return a text as a line of a terminal can hold it: its middle left out, no control codes."""
    if len(text) > LONGEST:
        half = LONGEST // 2
        text = f"{text[:half]} … ({len(text)} characters) … {text[-half:]}"
    return printable(text)


def printable(text: str) -> str:
    """Return a text in which each control code is written out."""
    return "".join(char if char.isprintable() else f"\\x{ord(char):02x}" for char in text)


def _place(fault: Fault) -> tuple[str, int, int]:
    return fault.file, fault.line, fault.column


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that was probably meant, or None.

    Case and the kind of dash are forgiven first, then a few wrong letters; `f71` is enough for
    `lakeshore-f71` where nothing else has it.
    """
    if len(word) > LONGEST:
        return None
    words = list(known)
    folded = {_fold(word): word for word in words}
    if _fold(word) in folded:
        return folded[_fold(word)]
    close = get_close_matches(_fold(word), list(folded), n=1, cutoff=0.6)
    if close:
        return folded[close[0]]
    having = [known for known in folded if f"-{_fold(word)}-" in f"-{known}-"]
    return folded[having[0]] if len(having) == 1 else None


def _fold(word: str) -> str:
    return word.casefold().replace("_", "-").replace(" ", "-")


def listed(words: Iterable[str]) -> str:
    """Return words as a person lists them: `a, b, c`, or `none`."""
    return ", ".join(words) or "none"


def meant(what: str, hint: str | None) -> str:
    """Return what is wrong and what was probably meant."""
    return f"{what}; did you mean {hint}" if hint else what


def not_there(
    what: str, name: str, known: Iterable[str], there: str = "there are"
) -> tuple[str, str | None]:
    """Return the sentence `what` of a name that nothing has, and what was probably meant.

    What there is comes after that, or ends the sentence where nothing is near.
    """
    words = list(known)
    hint, there = nearest(name, words), f"{there} {listed(words)}"
    return (what, f"'{hint}'; {there}") if hint else (f"{what}; {there}", None)


def dotted(path: Sequence[str | int]) -> str:
    """Return a path into a file as text: `instruments.coil_supply.x.limits`, `safe_state[2]`.

    Entries of a list count from 1, as a person counts them.
    """
    text = ""
    for part in path:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")
