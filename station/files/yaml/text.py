"""Look through the text of a YAML file for what a keyboard or an editor does to it.

Tabs and the full-width punctuation of an East Asian keyboard look like the right thing and make
YAML complain about something else, so they are found before YAML sees the text. Quoted text,
comments and block text (`|`, `>`) may hold anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

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

_BLOCK_START = re.compile(r"(?:^|[:\-]\s+)[|>][+-]?\d?[+-]?\s*(?:#.*)?$")
_OPENS_SCALAR = frozenset(":-[{,?：，【")


def lookalikes(text: str) -> Iterator[tuple[int, int, str]]:
    """Yield line, column (from 1) and a sentence for each tab or lookalike outside quotes."""
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
                said = f"{_LOOKALIKES[char]}, or put the text in quotes"
                yield line_number, column, f"'{char}' is {said}"
            if char not in " \t\u3000\u00a0":
                before = char
        if not quote and _BLOCK_START.search(line):
            block_indent = indent
