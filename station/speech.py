"""The language of this terminal: what people read there passes here once, and is translated.

What programs read passes by: documents of `--json`, files, exit codes. So does what is recorded.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

ENGLISH = "en"
ENVIRONMENT = ("LC_ALL", "LC_MESSAGES", "LANG")
"""The first of them that is set names the language, as `zh_CN.UTF-8` does."""
BLANKS = re.compile("( {2,})")
"""What stands between two columns."""
FAULT = re.compile(r"(\S.*?:\d+:\d+: [^:]+: )(.+)")
"""The place of a fault in a file, for people and editors, and what is wrong there."""
WARNED = re.compile(r"(WARNING:) (\S+:\d+:\d+: .+)")
"""A warning of a fault in a file."""
WORD = re.compile(r" *[\u2e80-\u9fff] *[\u3000-\u303f\uff00-\uffef]? *|[^ \u2e80-\u9fff]+ *| +")
MARKED = re.compile(r"((?:>>|-|#|[✔✘▶·!]) )(.+)")
WORDS = ("done", "abort", "yes", "no")
"""What a person answers, whose words in the language of the terminal mean the same."""


@dataclass
class Terminal:
    """The language in which this process speaks to whoever reads its standard streams."""

    language: str = ENGLISH


HERE = Terminal()


def of_environment(environment: Mapping[str, str] = os.environ) -> str:
    """Return the language of a computer's settings; English where there is no such catalogue."""
    wish = next(filter(None, map(environment.get, ENVIRONMENT)), "")
    language = re.split("[_.@]", wish)[0].lower()
    if language in ("", "c", "posix", ENGLISH):
        return ENGLISH
    from station.texts import languages

    return language if language in languages() else ENGLISH


def said(text: str) -> str:
    """Return what people read in the language of this terminal; each line by itself.

    Columns that two blanks or more divide stay where they are, if they have the room.
    """
    if HERE.language == ENGLISH:
        return text
    return "\n".join(map(_line, text.split("\n")))


def _line(line: str) -> str:
    shown, column = "", 0
    for piece in BLANKS.split(line):
        column += cells(piece)
        shown += " " * max(column - cells(shown), 2) if piece.isspace() else _piece(piece)
    return shown


def _piece(text: str) -> str:
    """Return one sentence, or a cell of a table; what stands around it is kept."""
    from station.texts import Texts

    inner, texts = text.strip(), Texts(HERE.language)
    if parts := WARNED.fullmatch(inner):
        return text.replace(inner, f"{texts(parts[1])} {_piece(parts[2])}")
    for known in (FAULT, MARKED):
        if parts := known.fullmatch(inner):
            return text.replace(inner, parts[1] + _piece(parts[2]))
    other = texts(inner)
    head, colon, tail = inner.rpartition(": ")
    if other == inner and colon:  # a title, and what has it
        other = f"{texts(head)}: {tail}"
    return text.replace(inner, other) if inner else text


def cells(text: str) -> int:
    """Return how many columns of a terminal a text takes: a Chinese sign takes two."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len

    return cell_len(text)


def folded(text: str, width: int, indent: int) -> str:
    """Return a text in lines that take at most `width` columns after an indent.

    They end between two words, a Chinese sign being one; a word that is longer is cut.
    """
    lines = [""]
    for word in WORD.findall(text):
        for part in [word] if cells(word.rstrip()) <= width else word:
            if cells((lines[-1] + part).rstrip()) > width:
                lines.append("")
            lines[-1] += part if lines[-1] else part.lstrip()
    return f"\n{' ' * indent}".join(line.rstrip() for line in lines)


def padded(text: str, width: int) -> str:
    """Return a text in the language of this terminal, as the cell of a column."""
    return _filled(said(text), width)


def in_columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines, each column as wide as its widest cell."""
    widths = [max(map(cells, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(_filled, row, widths)).rstrip() for row in rows]


def _filled(cell: str, width: int) -> str:
    return cell + " " * (width - cells(cell))


def joined(parts: Iterable[str]) -> str:
    """Return parts of a sentence, each in the language of this terminal, as a list."""
    joint = ", " if HERE.language == ENGLISH else said(",")
    return joint.join(map(said, parts))


def show(text: str = "") -> None:
    """Print on standard output what a person reads, at once."""
    print(said(text), flush=True)


def answered(line: str) -> str:
    """Return a typed answer as it is recorded: a word of this language as the English one."""
    if HERE.language == ENGLISH:
        return line
    word = line.strip().rstrip("!.！。").lower()
    return next((english for english in WORDS if word and word == said(english)), line)
