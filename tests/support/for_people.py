"""What a person may read: sentences, never a traceback or the name of a class of a library."""

from __future__ import annotations

import re

TRACE = (
    re.compile(r"Traceback \(most recent call last\)"),
    re.compile(r"File \"[^\"\n]+\", line \d+"),
    re.compile(r"\b[A-Z]\w*(?:Error|Exception|Warning|Interrupt|Exit)\b"),
    re.compile(r"<(?:class|function|module|built-in) "),
)
"""The third is a class of errors by what such classes are called: `LinAlgError`, `KeyError`."""
SHOWN = 200
SCRIPTS = re.compile(r"<(script|style)\b.*?</\1>", re.DOTALL)
"""What of a page nobody reads."""


def traces_in(text: str) -> list[str]:
    """Return what of a text is no sentence for a person, each with some of what is around it."""
    return [
        text[max(match.start() - SHOWN, 0) : match.end() + SHOWN]
        for pattern in TRACE
        for match in pattern.finditer(text)
    ]


def need_sentences(text: str, of: object) -> None:
    """Raise AssertionError where a text that a person reads holds a trace of the program."""
    found = traces_in(text)
    assert not found, f"{of} says:\n{found[0]}"
