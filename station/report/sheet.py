"""A page of text and tables before it is drawn: what HTML and PDF are both made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from station.report.numbers import is_numeric_column, typeset
from station.report.typesetting import with_signs
from station.texts import IN_ENGLISH, Texts, tag

PRINTED = (
    "DRAFT",
    "DRAFT: not to be issued",
    "Draft: this document is not to be issued, because",
    "Accreditation:",
    "Contents",
    "Page {page} of {pages}",
    "date and signature",
)
"""What stands on the paper itself."""


@dataclass(frozen=True)
class Block:
    """One of: pairs of name and text, a table, sentences, a picture; with a sentence below it.

    `image` is a PNG. `numeric` tells for each column whether it is set flush right.
    """

    kind: str
    title: str = ""
    caption: str = ""
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    numeric: tuple[bool, ...] = ()
    image: bytes = b""

    def translated(self, texts: Callable[[str], str]) -> Block:
        """Return the block in other words; numbers stay as they are."""
        return replace(
            self,
            title=texts(self.title),
            caption=texts(self.caption),
            columns=tuple(map(texts, self.columns)),
            rows=tuple(tuple(map(texts, row)) for row in self.rows),
        )


@dataclass(frozen=True)
class Section:
    """A heading and what stands below it."""

    title: str
    blocks: tuple[Block, ...]

    def translated(self, texts: Callable[[str], str]) -> Section:
        """Return the section in other words."""
        return Section(texts(self.title), tuple(block.translated(texts) for block in self.blocks))


@dataclass(frozen=True)
class Sheet:
    """A whole document. `number` stands on every page; `drafts` says why it is a draft only."""

    kind: str
    title: str
    number: str
    laboratory: str
    address: str
    accreditation: str
    sections: tuple[Section, ...]
    drafts: tuple[str, ...] = ()
    contents: bool = False
    texts: Texts = IN_ENGLISH

    def translated(self, texts: Texts) -> Sheet:
        """Return the sheet in other languages; what has no translation stays in English."""
        return replace(
            self,
            kind=texts(self.kind),
            title=texts(self.title),
            drafts=tuple(map(texts, self.drafts)),
            sections=tuple(part.translated(texts) for part in self.sections),
            texts=texts,
        )

    def to_data(self) -> dict[str, Any]:
        """Return the sheet as plain data, units typeset; a picture is the name of its file."""
        sections = tuple(part.translated(with_signs) for part in self.sections)
        data = asdict(replace(self, texts=IN_ENGLISH, sections=sections))
        data["texts"] = {text: self.texts(text) for text in PRINTED}
        data["language"], _, region = tag(self.texts.languages[0]).partition("-")
        data["region"] = region.lower() or None
        names = iter(self.pictures())
        for section in data["sections"]:
            for block in section["blocks"]:
                block["image"] = next(names) if block["image"] else ""
        return data

    def pictures(self) -> dict[str, bytes]:
        """Return the pictures by the name of their file, in their order."""
        blocks = [block for part in self.sections for block in part.blocks if block.image]
        return {f"picture-{number}.png": block.image for number, block in enumerate(blocks)}


def pairs(rows: Sequence[tuple[str, str]]) -> Block:
    """Return names with their texts; what has no text is left out."""
    return Block("pairs", rows=tuple((name, text) for name, text in rows if text))


def sentences(texts: Sequence[str]) -> Block:
    """Return sentences, one below the other."""
    return Block("list", rows=tuple((text,) for text in texts))


def grid(
    columns: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "", title: str = ""
) -> Block:
    """Return a table; a column of numbers is set flush right, its numbers as they are printed."""
    numeric = tuple(is_numeric_column([row[n] for row in rows]) for n in range(len(columns)))
    set_rows = tuple(
        tuple(typeset(text) if number else text for text, number in zip(row, numeric, strict=True))
        for row in rows
    )
    return Block("table", title, caption, tuple(columns), set_rows, numeric)
