"""The data of a YAML file, where each piece of it stands, and how data is written as YAML."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from station.files.faults import Fault, dotted

Where = tuple[str | int, ...]
TOP = "top level"


@dataclass(frozen=True)
class Mark:
    """A place in a file; line and column count from 1.

    `file` is given where the document was put together from several files, `var` where the value
    stands in a var and was filled in from there.
    """

    line: int
    column: int
    file: str | None = None
    var: str | None = None


@dataclass(frozen=True)
class Document:
    """The data of a YAML file and where each piece stands.

    `positions` maps the path of each value to its place, `key_positions` to that of its key;
    `scalars` maps the path of each scalar to its characters as written.
    """

    data: dict[str, Any]
    path: Path
    text: str
    positions: dict[Where, Mark] = field(default_factory=dict)
    key_positions: dict[Where, Mark] = field(default_factory=dict)
    scalars: dict[Where, str] = field(default_factory=dict)

    def fault(
        self, where: Where, what: str, hint: str | None = None, *, at_key: bool = False
    ) -> Fault:
        """Return a fault at a path; a path that is not there is placed at what would hold it."""
        mark = self.key_positions.get(where) if at_key else None
        present = where
        while mark is None:
            mark = self.positions.get(present)
            if mark is None and not present:
                mark = Mark(1, 1)
            present = present[:-1]
        place = dotted(where) or TOP
        return Fault(mark.file or str(self.path), mark.line, mark.column, place, what, hint)

    def at(self, where: Where) -> Any:
        """Return the value at a path; KeyError or IndexError when there is none."""
        value: Any = self.data
        for part in where:
            value = value[part]
        return value

    def stamped(self) -> Document:
        """Return a copy that may be changed, in which every place names its file."""

        def stamp(marks: dict[Where, Mark]) -> dict[Where, Mark]:
            file = str(self.path)
            return {
                where: mark if mark.file else replace(mark, file=file)
                for where, mark in marks.items()
            }

        return Document(
            deepcopy(self.data),
            self.path,
            self.text,
            stamp(self.positions),
            stamp(self.key_positions),
            dict(self.scalars),
        )

    def graft(
        self,
        where: Where,
        source: Document,
        at: Where,
        moved: Callable[[Mark], Mark] = lambda mark: mark,
    ) -> None:
        """Put what stands at `at` of a stamped document in place of what stands at `where`.

        The place of the key stays what it is; `moved` changes the places that come along.
        """
        value = deepcopy(source.at(at))
        holder: Any = self.at(where[:-1])
        key: Any = where[-1]
        if isinstance(holder, list) or key in holder:
            for path in paths_below(holder[key], where):
                self.positions.pop(path, None)
                self.scalars.pop(path, None)
                if path != where:
                    self.key_positions.pop(path, None)
        holder[key] = value
        depth = len(at)
        for path in list(paths_below(value, at)):
            here = where + path[depth:]
            if path in source.positions:
                self.positions[here] = moved(source.positions[path])
            if path in source.key_positions and path != at:
                self.key_positions[here] = moved(source.key_positions[path])
            if path in source.scalars:
                self.scalars[here] = source.scalars[path]

    def prune(self, where: Where) -> None:
        """Forget the places of everything at and below a path, but not that of its key."""
        depth = len(where)
        for marks in (self.positions, self.scalars):
            for path in [path for path in marks if path[:depth] == where]:
                del marks[path]
        for path in [path for path in self.key_positions if path[:depth] == where]:
            if len(path) > depth:
                del self.key_positions[path]

    def remove(self, key: str) -> None:
        """Take a key of the top level out."""
        if self.data.pop(key, None) is not None or (key,) in self.positions:
            self.prune((key,))
            self.key_positions.pop((key,), None)


class FromDocument:
    """What a document without a fault holds."""

    document: Document

    @property
    def path(self) -> Path:
        """The file."""
        return self.document.path

    @property
    def text(self) -> str:
        """The file as it was given."""
        return self.document.text

    def fault(self, where: Where, what: str, hint: str | None = None) -> Fault:
        """Return a fault at a place of the file, such as `("parameters", "amplitude")`."""
        return self.document.fault(where, what, hint)


def leaves(value: Any, where: Where = ()) -> Iterator[tuple[Where, Any]]:
    """Yield each scalar and each empty mapping or list of data with its path."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from leaves(inner, (*where, key))
    elif isinstance(value, list) and value:
        for number, inner in enumerate(value):
            yield from leaves(inner, (*where, number))
    else:
        yield where, value


def paths_below(value: Any, where: Where) -> Iterator[Where]:
    """Yield the path of a value and of everything in it."""
    yield where
    pairs: Iterable[tuple[Any, Any]] = ()
    if isinstance(value, dict):
        pairs = value.items()
    elif isinstance(value, list):
        pairs = enumerate(value)
    for key, inner in pairs:
        yield from paths_below(inner, (*where, key))


_NULL = re.compile(r"(?:~|null|Null|NULL|)")
_BOOLEANS = dict.fromkeys(("true", "True", "TRUE"), True) | dict.fromkeys(
    ("false", "False", "FALSE"), False
)
_INTEGER = re.compile(r"[-+]?[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEXADECIMAL = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NOT_A_NUMBER = re.compile(r"\.(?:nan|NaN|NAN)")


def plain_scalar(text: str) -> str | int | float | bool | None:
    """Return what an unquoted word means in YAML 1.2."""
    if _NULL.fullmatch(text):
        return None
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    for pattern, base in ((_INTEGER, 10), (_OCTAL, 8), (_HEXADECIMAL, 16)):
        if pattern.fullmatch(text) and len(text) < 100:
            return int(text.replace("0o", "").replace("0x", ""), base)
    if _FLOAT.fullmatch(text):
        return float(text)
    infinite = _INFINITY.fullmatch(text)
    if infinite:
        return float(f"{infinite.group(1)}inf")
    return float("nan") if _NOT_A_NUMBER.fullmatch(text) else text


_NEVER_WRAPPED = 1_000_000


class _Dumper(yaml.SafeDumper):
    """Quotes every text that YAML 1.2 or 1.1 would take for something else."""

    def ignore_aliases(self, data: object) -> bool:
        """Write equal values out each time; anchors are refused on reading."""
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    plain = plain_scalar(text) == text and text.isascii() and text.isprintable()
    style = None if plain else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def yaml_text(data: dict[str, Any]) -> str:
    """Return plain data as YAML text, keys in the order given, each scalar on a line of its own."""
    text: str = yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_NEVER_WRAPPED
    )
    return text
