"""Changes of a file that make it odd: its values, its lines, its columns, its bytes."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from pathlib import Path

ODD = (
    "1e308 s",
    "-1e308 mT",
    "1e-320 Hz",
    "0 s",
    "0 Hz",
    "0 mT",
    "0 mT/A",
    "-1 s",
    "0",
    "-1",
    "1e999",
    "nan",
    ".nan",
    ".inf",
    "-.inf",
    "1e308",
    "null",
    "~",
    "true",
    "no",
    "''",
    "[]",
    "{}",
    "[[[[]]]]",
    "{a: {b: {c: 1}}}",
    "0x7fffffffffffffff",
    "99999999999999999999999",
    "1e308 deg",
    "1e9 h",
    "1e9 degC",
    "-300 degC",
    "0 K",
    "*alias",
    "&anchor 1",
    "!!python/object:os.system x",
    "!!binary x",
    "!tag 1",
    "'\u202e'",
    "\u00b5",
    "1 \u00b5T",
    "\U0001f600",
    "${x}",
    "${dut}",
    "../../etc/passwd",
    "/",
    ".",
    "con",
    "a" * 5000,
    "1" * 400,
    "'" + "x" * 300 + "'",
    "|\n    text",
    ">-\n    text",
    "- 1",
    "? a",
    "<<: {a: 1}",
    "2027-02-30",
    "0001-01-01",
    "9999-12-31",
    "1 %",
    "1e300 ppm",
    "1e-300 V/g",
    "[1 mT, 2 mT, 1e308 mT]",
    "[IA, IA, IA]",
    "1_000 s",
    "0b1",
    "0o17 s",
    "12:30:00",
    "'\\0'",
)
CELLS = (
    "0",
    "-0",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e300",
    "-1e300",
    "1e-320",
    "1e999",
    "",
    " ",
    "x",
    "1_0",
    "0x10",
    "1,5",
    '"',
    '"a,b"',
    "\x00",
    "9" * 400,
    "1e308",
    "-1",
    "\u0661",
    "1 2",
    "None",
    "z" * 70000,
)


Change = Callable[[random.Random, bytes], bytes]


def lines_of(data: bytes) -> list[bytes]:
    """Return the lines of a file."""
    return data.split(b"\n")


def odd_value(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    places = [n for n, line in enumerate(lines) if b": " in line]
    if places:
        n = rng.choice(places)
        key, _, _ = lines[n].partition(b": ")
        lines[n] = key + b": " + rng.choice(ODD).encode()
    return b"\n".join(lines)


def odd_in_braces(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    places = [n for n, line in enumerate(lines) if b"{" in line and b": " in line]
    if not places:
        return odd_value(rng, data)
    n = rng.choice(places)
    parts = lines[n].split(b", ")
    k = rng.randrange(len(parts))
    key, mark, _ = parts[k].rpartition(b": ")
    end = b"}" if parts[k].rstrip().endswith(b"}") else b""
    parts[k] = key + mark + rng.choice(ODD).encode() + end
    lines[n] = b", ".join(parts)
    return b"\n".join(lines)


def odd_number(rng: random.Random, data: bytes) -> bytes:
    """Change the number of a quantity and keep its unit."""
    words = data.split(b" ")
    places = [n for n, word in enumerate(words) if word[:1].isdigit() and word[-1:].isdigit()]
    if places:
        odd = (
            b"0",
            b"1e308",
            b"-1e308",
            b"1e-308",
            b"1e15",
            b"-1",
            b"1e400",
            b"0.0",
            b"1e5",
            b"5e-324",
        )
        words[rng.choice(places)] = rng.choice(odd)
    return b" ".join(words)


def lost_line(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    del lines[rng.randrange(len(lines))]
    return b"\n".join(lines)


def doubled_line(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    n = rng.randrange(len(lines))
    lines[n:n] = [lines[n]] * rng.choice((1, 2, 50))
    return b"\n".join(lines)


def moved_line(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    lines.insert(rng.randrange(len(lines)), lines.pop(rng.randrange(len(lines))))
    return b"\n".join(lines)


def indented(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    n = rng.randrange(len(lines))
    lines[n] = rng.choice((b" ", b"  ", b"\t", b"    ")) + lines[n]
    return b"\n".join(lines)


def nested(rng: random.Random, data: bytes) -> bytes:
    depth = rng.choice((20, 100, 300, 3000))
    opened, closed = rng.choice(((b"[", b"]"), (b"{a: ", b"}")))
    return data + b"\nnested: " + opened * depth + closed * depth + b"\n"


def indented_deep(rng: random.Random, data: bytes) -> bytes:
    depth = rng.choice((30, 300, 1000))
    return data + b"\n" + b"".join(b" " * n + b"a:\n" for n in range(depth))


def many_keys(rng: random.Random, data: bytes) -> bytes:
    count = rng.choice((30, 1000, 20_000))
    indent = rng.choice((b"", b"  "))
    return data + b"\n" + b"".join(b"%skey_%d: 1\n" % (indent, n) for n in range(count))


def bomb(rng: random.Random, data: bytes) -> bytes:
    lines = [b"a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [b"a%d: &a%d [%s]" % (n, n, b", ".join([b"*a%d" % (n - 1)] * 9)) for n in range(1, 12)]
    return b"\n".join(lines) + b"\n" + (data if rng.random() < 0.5 else b"")


def odd_cell(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    n = rng.randrange(len(lines))
    cells = lines[n].split(b",")
    cells[rng.randrange(len(cells))] = rng.choice(CELLS).encode()
    lines[n] = b",".join(cells)
    return b"\n".join(lines)


def odd_column(rng: random.Random, data: bytes) -> bytes:
    """Give all rows the same cell, or scale a column, or put its rows in another order."""
    lines = [line.split(b",") for line in lines_of(data.rstrip(b"\n"))]
    k = rng.randrange(len(lines[0]))
    way = rng.choice(("same", "zero", "huge", "order", "odd", "tiny"))
    rows = [row for row in lines[1:] if len(row) > k]
    column = [row[k] for row in rows] or [b"0"]
    if way == "order":
        rng.shuffle(column)
    for row, cell in zip(rows, column, strict=False):
        odd = {"same": column[0], "zero": b"0", "huge": cell + b"e300", "tiny": cell + b"e-300"}
        row[k] = odd.get(way, cell)
    if way == "odd" and rows:
        cell = rng.choice(CELLS).encode()
        for row in rows:
            row[k] = cell
    return b"\n".join(b",".join(row) for row in lines) + b"\n"


def all_zero(rng: random.Random, data: bytes) -> bytes:
    """Make every number but those of some columns zero."""
    lines = [line.split(b",") for line in lines_of(data.rstrip(b"\n"))]
    kept = {k for k in range(len(lines[0])) if rng.random() < 0.3}
    for row in lines[1:]:
        row[:] = [
            cell if k in kept or not cell[-1:].isdigit() else b"0" for k, cell in enumerate(row)
        ]
    return b"\n".join(b",".join(row) for row in lines) + b"\n"


def few_rows(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data.rstrip(b"\n"))
    return b"\n".join(lines[: 1 + rng.choice((0, 1, 2, 3, 4, 5, 10, 50))]) + b"\n"


def lost_rows(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data.rstrip(b"\n"))
    share = rng.choice((0.01, 0.2, 0.9))
    return b"\n".join([lines[0], *(one for one in lines[1:] if rng.random() > share)]) + b"\n"


def renamed_column(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    cells = lines[0].split(b",")
    cells[rng.randrange(len(cells))] = rng.choice(
        (b"", b"x", cells[0], b"\xff", b"time", b"y" * 9999)
    )
    lines[0] = b",".join(cells)
    return b"\n".join(lines)


def many_columns(rng: random.Random, data: bytes) -> bytes:
    lines = lines_of(data)
    count = rng.choice((100, 10_000, 1_000_000))
    lines[0] += b"," + b",".join(b"c%d" % n for n in range(count))
    return b"\n".join(lines)


def flipped(rng: random.Random, data: bytes) -> bytes:
    spoiled = bytearray(data or b"\0")
    for _ in range(rng.choice((1, 1, 3, 20))):
        spoiled[rng.randrange(len(spoiled))] ^= 1 << rng.randrange(8)
    return bytes(spoiled)


def inserted(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    piece = rng.choice(
        (
            b"\0",
            b"\xff\xfe",
            b"\r",
            b"\x85",
            b"\xe2\x80\xa8",
            b"\t",
            b"%",
            b"---\n",
            b"...\n",
            b'"',
            b"'",
            b"\xef\xbb\xbf",
            b"\x1b[2J",
            rng.randbytes(40),
            b"#",
            b"\n\n",
        )
    )
    return data[:at] + piece + data[at:]


def cut(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def encoded(rng: random.Random, data: bytes) -> bytes:
    text = data.decode("utf-8", "replace")
    ways = ("utf-16", "utf-32", "utf-8-sig", "latin-1", "crlf", "cr", "empty", "nul", "random")
    match rng.choice(ways):
        case "crlf":
            return data.replace(b"\n", b"\r\n")
        case "cr":
            return data.replace(b"\n", b"\r")
        case "empty":
            return b""
        case "nul":
            return bytes(len(data))
        case "random":
            return rng.randbytes(min(len(data), 5000))
        case way:
            return text.encode(way, "replace")


BYTES: Sequence[Change] = (flipped, inserted, cut, encoded)
YAML: Sequence[Change] = (
    odd_value,
    odd_value,
    odd_value,
    odd_in_braces,
    odd_in_braces,
    odd_number,
    odd_number,
    odd_number,
    lost_line,
    doubled_line,
    moved_line,
    indented,
    nested,
    indented_deep,
    many_keys,
    bomb,
    *BYTES,
)
TABLE: Sequence[Change] = (
    odd_cell,
    odd_cell,
    odd_column,
    odd_column,
    odd_column,
    all_zero,
    few_rows,
    lost_rows,
    renamed_column,
    many_columns,
    doubled_line,
    lost_line,
    *BYTES,
)


def mutated(rng: random.Random, file: Path, changes: Sequence[Change]) -> list[str]:
    """Change a file in one to three ways; return their names."""
    data, names = file.read_bytes(), []
    for _ in range(rng.choice((1, 1, 2, 3))):
        change = rng.choice(changes)
        try:
            data = change(rng, data)
        except (IndexError, ValueError):
            continue  # nothing left to change in this way
        names.append(change.__name__)
    file.write_bytes(data)
    return names
