"""Read YAML strictly, and keep the line and column of everything.

PyYAML splits the text; what a plain word means is decided here by YAML 1.2: `1e-3` is a number,
`NO`, `yes` and `on` are words, `010` is ten, `12:30` and dates are words. A key that stands twice,
an anchor, an alias, a merge key and a tag are faults: a plan says what it means in one place.

Tabs and the full-width punctuation of an East Asian keyboard look like the right thing and make
YAML complain about something else, so they are looked for before YAML sees the text. Quoted text,
comments and block text (`|`, `>`) may hold anything.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from yaml.resolver import Resolver

from station.files.faults import Fault, FaultList, dotted
from station.files.lookup import is_missing
from station.files.yaml.document import TOP, Document, Mark, Where, plain_scalar

_LOOKALIKES = {
    "：": "a full-width colon; write ':' and a blank",
    "，": "a full-width comma; write ','",
    "、": "an ideographic comma; write ','",
    "【": "a full-width bracket; write '['",
    "】": "a full-width bracket; write ']'",
    "［": "a full-width bracket; write '['",
    "］": "a full-width bracket; write ']'",
    "｛": "a full-width brace; write '{'",
    "｝": "a full-width brace; write '}'",
    "“": "a typographic quotation mark; write '\"'",
    "”": "a typographic quotation mark; write '\"'",
    "‘": 'a typographic quotation mark; write "\'"',
    "’": 'a typographic quotation mark; write "\'"',
    "＂": "a full-width quotation mark; write '\"'",
    "＇": 'a full-width quotation mark; write "\'"',
    "＃": "a full-width number sign; write '#'",
    "－": "a full-width minus; write '-'",
    "．": "a full-width point; write '.'",
    "\u3000": "an ideographic blank; write an ordinary blank",
    "\u00a0": "a no-break blank; write an ordinary blank",
}
_LOOKALIKES |= {chr(0xFF10 + n): f"a full-width digit; write '{n}'" for n in range(10)}

_SUSPECT = re.compile(f"[\t{''.join(_LOOKALIKES)}]")
_BLOCK_START = re.compile(r"(?:^|[:\-]\s+)[|>][+-]?\d?[+-]?\s*(?:#.*)?$")
_OPENS_SCALAR = frozenset(":-[{,?：，【")


def lookalikes(text: str) -> Iterator[tuple[int, int, str]]:
    """Yield line, column (from 1) and a sentence for each tab or lookalike outside quotes."""
    if not _SUSPECT.search(text):
        return
    quote = ""
    block_indent = -1
    for line_number, line in enumerate(text.splitlines(), start=1):
        indent = len(line) - len(line.lstrip(" "))
        if block_indent >= 0 and (not line.strip() or indent > block_indent):
            continue
        block_indent = -1
        if not quote and not line.strip(" \t"):
            continue
        seen_tab = False
        before = ""
        column = 0
        while column < len(line):
            char = line[column]
            column += 1
            if quote:
                if char == "\\" and quote == '"':
                    column += 1
                elif char == quote:
                    quote = ""
                    before = char
                continue
            if char == "#" and (column == 1 or line[column - 2] in " \t"):
                break
            if char in "\"'" and (not before or before in _OPENS_SCALAR):
                quote = char
            elif char == "\t" and not seen_tab:
                seen_tab = True
                where = "the indentation holds a tab" if not before else "the line holds a tab"
                yield line_number, column, f"{where}; write blanks"
            elif char in _LOOKALIKES:
                advice = f"{_LOOKALIKES[char]}, or put the text in quotes"
                yield line_number, column, f"'{char}' is {advice}"
            if char not in " \t\u3000\u00a0":
                before = char
        if not quote and _BLOCK_START.search(line):
            block_indent = indent


__all__ = [
    "Document",
    "Fault",
    "FaultList",
    "Mark",
    "read_yaml",
    "read_yaml_text",
]

# The core schema of YAML 1.2, section 10.3.2, in the order in which it is tried.
MAX_BYTES = 500_000
"""What people write has some kB; beyond this the file is not what it is taken for."""
DEEPEST = 40


class _Composer(Composer, Resolver):
    """The tree of nodes from a parser's events, with no opinion on what a word means."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  (PyYAML's own name and kind)

    def __init__(self, file: str) -> None:
        Composer.__init__(self)
        Resolver.__init__(self)
        self.file = file
        self.refused: list[Fault] = []
        self.depth = 0

    def compose_node(self, parent: Node | None, index: int) -> Node | None:
        """Compose a node; note what we refuse and go on as if it were not there."""
        event: Any = self.peek_event()  # type: ignore[attr-defined]
        if self.depth >= DEEPEST:
            self._refuse(event, f"the keys are nested more than {DEEPEST} deep")
            raise FaultList(self.refused)
        if isinstance(event, yaml.AliasEvent):
            self.get_event()  # type: ignore[attr-defined]
            self._refuse(event, f"'*{event.anchor}' is an alias; write the value out")
            mark: Any = event.start_mark
            return ScalarNode("", "", mark, mark, style="'")
        if event.anchor is not None:
            self._refuse(event, f"'&{event.anchor}' is an anchor; leave it out")
            event.anchor = None
        # "!" alone says "text" and is what PyYAML reports for no tag in some releases.
        if getattr(event, "tag", None) not in (None, "!"):
            tag = event.tag.replace("tag:yaml.org,2002:", "!!")
            self._refuse(event, f"'{tag}' is a tag; leave it out, quotes make text of a word")
            event.tag = None
        self.depth += 1
        node: Node | None = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def _refuse(self, event: Any, what: str) -> None:
        mark = event.start_mark
        self.refused.append(Fault(self.file, mark.line + 1, mark.column + 1, "YAML", what))


class _Loader(_Composer, yaml.SafeLoader):
    """From PyYAML's own parser, whose complaints are those that `_PLAINER` words."""

    def __init__(self, text: str, file: str) -> None:
        yaml.SafeLoader.__init__(self, text)
        _Composer.__init__(self, file)


if yaml.__with_libyaml__:

    class _FastLoader(_Composer, yaml.CSafeLoader):
        """From libyaml's parser."""

        def __init__(self, text: str, file: str) -> None:
            yaml.CSafeLoader.__init__(self, text)
            _Composer.__init__(self, file)


def _composed(text: str, file: str) -> tuple[Node | None, list[Fault]]:
    """Compose a text by libyaml, ten times as fast, and by PyYAML's own parser where it has faults.

    Raises yaml.YAMLError, RecursionError, and FaultList where the keys are nested too deeply.
    """
    if yaml.__with_libyaml__:
        with suppress(yaml.YAMLError, RecursionError, FaultList):
            fast = _FastLoader(text, file)
            node = fast.get_single_node()
            if not fast.refused:
                return node, []
    loader = _Loader(text, file)
    return loader.get_single_node(), loader.refused


class _Builder:
    """Turns the tree of nodes into data, places and faults."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.faults: list[Fault] = []

    def value(self, node: Node, path: Where) -> Any:
        self.document.positions[path] = _mark(node)
        if isinstance(node, MappingNode):
            return self.mapping(node, path)
        if isinstance(node, SequenceNode):
            return [self.value(item, (*path, n)) for n, item in enumerate(node.value)]
        assert isinstance(node, ScalarNode)
        self.document.scalars[path] = node.value
        return plain_scalar(node.value) if not node.style else node.value

    def mapping(self, node: MappingNode, path: Where) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            mark = _mark(key_node)
            if not isinstance(key_node, ScalarNode) or not key_node.value:
                self.fault(mark, path, "a key must be a word")
                continue
            key = key_node.value
            if key == "<<" and not key_node.style:
                self.fault(mark, path, "'<<' merges mappings; write the keys out")
                continue
            here = (*path, key)
            if key in data:
                first = self.document.key_positions[here].line
                self.fault(mark, here, f"the key stands twice, first in line {first}; keep one")
                continue
            self.document.key_positions[here] = mark
            data[key] = self.value(value_node, here)
        return data

    def fault(self, mark: Mark, path: Where, what: str) -> None:
        where = dotted(path) or TOP
        self.faults.append(Fault(str(self.document.path), mark.line, mark.column, where, what))


def _mark(node: Node) -> Mark:
    return Mark(node.start_mark.line + 1, node.start_mark.column + 1)


def read_text(path: Path, most_bytes: int | None = None) -> str:
    """Return the text of a file in UTF-8, with or without byte order mark; raises FaultList."""
    try:
        if not path.is_dir() and path.exists() and not path.is_file():
            raise OSError(errno.EINVAL, "it is a pipe or a device, not a file")
        with path.open("rb") as file:
            raw = file.read() if most_bytes is None else file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # a name that holds a NUL is a ValueError
        what = f"the file cannot be read: {getattr(error, 'strerror', None) or error}"
        if is_missing(path):
            what = "the path does not exist"
        raise FaultList([Fault(str(path), 1, 1, "file", what)]) from None
    if most_bytes is not None and len(raw) > most_bytes:
        what = f"the file has more than {most_bytes // 1000} kB; it is no plan, bench or dataset"
        raise FaultList([Fault(str(path), 1, 1, "file", what)])
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        column = len(before[before.rfind(b"\n") + 1 :].decode("utf-8", "replace")) + 1
        what = f"byte 0x{raw[error.start]:02x} is not UTF-8; save the file as UTF-8"
        line = before.count(b"\n") + 1
        raise FaultList([Fault(str(path), line, column, "file", what)]) from None


def read_yaml(path: Path) -> Document:
    """Read a YAML file whose top level is a mapping; UTF-8, with or without byte order mark.

    Raises FaultList with everything that is wrong with the file as YAML.
    """
    return read_yaml_text(read_text(path, MAX_BYTES), path)


def read_yaml_text(text: str, path: Path) -> Document:
    """Read YAML from text as `read_yaml` does; `path` names it in faults."""
    file = str(path)
    alike = [Fault(file, line, column, "YAML", what) for line, column, what in lookalikes(text)]
    if alike:
        raise FaultList(alike)
    try:
        node, refused = _composed(text, file)
    except yaml.MarkedYAMLError as error:
        raise FaultList([_syntax_fault(error, file, text)]) from None
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        what = f"the character {error.character:#06x} may not stand in a text file; delete it"
        raise FaultList([Fault(file, line, column, "YAML", what)]) from None
    except RecursionError:
        raise FaultList([Fault(file, 1, 1, "YAML", "the brackets are nested too deeply")]) from None
    if node is None:
        what = "the file is empty, or all of it is comment"
        raise FaultList([Fault(file, 1, 1, "file", what)])
    document = Document({}, path, text)
    builder = _Builder(document)
    data = builder.value(node, ())
    faults = [*refused, *builder.faults]
    if not isinstance(data, dict):
        mark = _mark(node)
        what = "the file must consist of 'key: value' lines"
        faults.append(Fault(file, mark.line, mark.column, TOP, what))
    if faults:
        raise FaultList(faults)
    document.data.update(data)
    return document


_PLAINER = (
    ("mapping values are not allowed", "': ' is unexpected here: the line above lacks its ': ', "
     "this line has two, or its indentation differs; text that holds ': ' needs quotes"),
    ("could not find expected ':'", "the line has no ': ' after its key"),
    ("found another document", "'---' begins a second document; keep one"),
    ("expected ',' or ']'", "a list in brackets is not closed, or a ',' is missing"),
    ("expected ',' or '}'", "a mapping in braces is not closed, or a ',' is missing"),
    ("expected <block end>", "the line is indented differently from its neighbours, or a quoted "
     "text is followed by more text"),
    ("unexpected end of stream", "a quoted text is not closed"),
    ("found unexpected ':'", "there is a ':' within a word; put the text in quotes"),
    ("cannot start any token", "text may not begin with this character; put it in quotes"),
    ("unknown escape character", "'\\' has a meaning in double quotes; use single quotes"),
    ("sequence entries are not allowed", "a list begins behind its key; begin it on the next line"),
)  # fmt: skip


def _syntax_fault(error: yaml.MarkedYAMLError, file: str, text: str) -> Fault:
    problem = error.problem or str(error.context)
    mark = error.problem_mark or error.context_mark
    if mark is not None and text.splitlines()[mark.line : mark.line + 1]:
        before = text.splitlines()[mark.line][: mark.column]
        if before.endswith("$"):
            what = "'${…}' within brackets or braces needs quotes, such as \"${name}\""
            return Fault(file, mark.line + 1, mark.column, "YAML", what)
    what = next((plain for advice, plain in _PLAINER if advice in problem), problem)
    # An unclosed quote or bracket is noticed far behind the place where it was opened.
    if error.context_mark is not None and ("not closed" in what or "no ': '" in what):
        mark = error.context_mark
    line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
    return Fault(file, line, column, "YAML", what)
