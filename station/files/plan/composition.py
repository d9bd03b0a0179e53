"""Put a plan together: the file, the plans it extends, what `--set` changes, and its `vars`.

`extends: other-plan` is a plan that says only in what it differs from another: mappings merge,
everything else replaces, also a list as a whole; a base may extend a base of its own. A fault in
`--set key=value` is placed at `--set:2:12`: the second `--set`, twelfth character. `${name}` stands
in the place of a whole value.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from station.files.faults import Fault, FaultList, dotted, listed, nearest, not_there
from station.files.lookup import PLANS, available, find, is_there
from station.files.yaml.document import Document, Mark, Where, leaves, plain_scalar
from station.files.yaml.reading import lookalikes, read_yaml, read_yaml_text

EXTENDS = "extends"
RELEASED = "released"
_SUFFIX = ".yaml"


def layers_of(plan: Document) -> list[Document]:
    """Return the files of a plan: itself, the plan that it extends, that one's base, and so on.

    Raises FaultList for a base that is not there, cannot be read, or closes a circle.
    """
    layers = [plan]
    while EXTENDS in layers[-1].data:
        path = base_path(layers[-1])
        known = [layer.path.resolve() for layer in layers]
        if path.resolve() in known:
            circle = [*layers[known.index(path.resolve()) :], layers[known.index(path.resolve())]]
            way = " extends ".join(layer.path.name for layer in circle)
            what = f"the plans extend each other in a circle: {way}"
            raise FaultList([layers[-1].fault((EXTENDS,), what)])
        layers.append(_read_base(path))
    return layers


def _read_base(path: Path) -> Document:
    try:
        status = path.stat()
    except OSError:
        return read_yaml(path)  # says why in a sentence
    return _read_once(path, path.resolve(), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=32)
def _read_once(path: Path, whole_path: Path, changed_ns: int, size: int) -> Document:
    """Read a base once for all the plans that extend it; nothing changes the document."""
    return read_yaml(path)


def base_path(plan: Document) -> Path:
    """Return the file that a plan extends: a path from the plan's folder, or a plan's name.

    Raises FaultList at the line of `extends`.
    """
    name = plan.data[EXTENDS]
    if not isinstance(name, str) or not name.strip():
        what = "must be the name of another plan, or its path seen from this file"
        raise FaultList([plan.fault((EXTENDS,), what)])
    folder = plan.path.parent
    for file in (folder / name, folder / f"{name}{_SUFFIX}"):
        if is_there(file):
            return file
    wanted = name.removesuffix(_SUFFIX)
    named = [known for known, _ in available(PLANS)]
    # A bare name is that of a plan; anything else would be looked for where the command was given.
    if wanted in named:
        return find(PLANS, wanted)
    here = [path.stem for path in sorted(folder.glob(f"*{_SUFFIX}")) if path != plan.path]
    known = list(dict.fromkeys([*here, *named]))
    what = f"there is no plan '{name}', neither as a file seen from this one nor by name"
    fault = not_there(what, Path(wanted).name, known)
    raise FaultList([plan.fault((EXTENDS,), *fault)])


def merged(layers: list[Document]) -> Document:
    """Return one document of a plan's files, the plan itself first; every place names its file."""
    plan = layers[0].stamped()
    result = layers[-1].stamped()
    result = Document(
        result.data, plan.path, plan.text, result.positions, result.key_positions, result.scalars
    )
    result.remove(EXTENDS)
    for layer in reversed(layers[:-1]):
        result.remove(RELEASED)  # of the plan that is extended, not of this one
        over = layer.stamped()
        over.remove(EXTENDS)
        _merge(result, over, ())
    return result


def _merge(result: Document, over: Document, where: Where) -> None:
    """Lay the mapping at a path of `over` on that of `result`."""
    result.positions[where] = over.positions[where]
    below = result.at(where)
    for key, value in over.at(where).items():
        here = (*where, key)
        if isinstance(value, dict) and isinstance(below.get(key), dict):
            _merge(result, over, here)
        else:
            result.graft(here, over, here)
        result.key_positions[here] = over.key_positions[here]


OPTION = "--set"
_OPENS_YAML = "[{\"'"
_KEY = "value: "
EXAMPLE = "parameters.frequency=0.2 Hz"


def override(document: Document, given: Sequence[str]) -> list[Fault]:
    """Change a document as every `--set` says, in their order, and return the faults."""
    faults: list[Fault] = []
    seen: dict[Where, int] = {}
    for number, text in enumerate(given, start=1):
        key, equals, value = text.partition("=")
        where: Where = tuple(key.strip().split("."))
        start = len(key) + 2
        if not equals or not all(where):
            what = f"'{text}' is not key=value; write it like {EXAMPLE}"
            faults.append(Fault(OPTION, number, 1, key.strip() or OPTION, what))
        elif where == (EXTENDS,):
            what = "a plan extends what its file says; write a plan that extends the other"
            faults.append(Fault(OPTION, number, 1, EXTENDS, what))
        elif where in seen:
            what = f"is set twice, first by {OPTION} number {seen[where]}; keep one"
            faults.append(Fault(OPTION, number, 1, dotted(where), what))
        else:
            seen[where] = number
            try:
                read = _value(value, number, start, dotted(where))
            except FaultList as error:
                faults.extend(error.faults)
                continue
            fault = _way(document, where, number)
            if fault is None:
                document.graft(where, read, ("value",))
                document.key_positions[where] = Mark(number, 1, OPTION)
            else:
                faults.append(fault)
    return faults


def identifying(serial: str | None, operator: str | None) -> list[str]:
    """Return the overrides that say which device is measured and by whom, where they are given.

    Each is quoted, so that `42` stays a serial number.
    """
    named = (("dut.serial", serial), ("operator", operator))
    quoted = ((key, text.replace("'", "''")) for key, text in named if text is not None)
    return [f"{key}='{text}'" for key, text in quoted]


def _way(document: Document, where: Where, number: int) -> Fault | None:
    """Make sure that mappings lead to a path; return a fault when something else is in the way."""
    holder: Any = document.data
    for depth, part in enumerate(where[:-1], start=1):
        here = where[:depth]
        if part not in holder:
            holder[part] = {}
            document.positions[here] = document.key_positions[here] = Mark(number, 1, OPTION)
        holder = holder[part]
        if not isinstance(holder, dict):
            what = f"'{dotted(here)}' holds a value and no keys"
            return Fault(OPTION, number, 1, dotted(where), what)
    return None


def _value(text: str, number: int, start: int, where: str) -> Document:
    """Return the value of a `--set` that begins at column `start` as the document `value: …`."""
    stripped = text.strip()
    start += len(text) - len(text.lstrip())
    if stripped.startswith(tuple(_OPENS_YAML)):
        return _yaml_value(stripped, number, start, where)
    wrong = [
        Fault(OPTION, number, start + column - 1, where, what)
        for _, column, what in lookalikes(stripped)
    ]
    if wrong:
        raise FaultList(wrong)
    document = Document({"value": plain_scalar(stripped)}, Path(OPTION), text)
    document.positions["value",] = Mark(number, start, OPTION)
    document.scalars["value",] = stripped
    return document


def _yaml_value(text: str, number: int, start: int, where: str) -> Document:
    """Return a quoted text or a list in brackets, with its places on the command line."""
    shift = start - len(_KEY) - 1
    try:
        document = read_yaml_text(_KEY + text, Path(OPTION))
    except FaultList as error:
        raise FaultList(
            replace(fault, line=number, column=max(fault.column + shift, 1), where=where)
            for fault in error.faults
        ) from None
    value = document.data["value"]
    if isinstance(value, dict) or "\n" in text:
        what = f"set one value, or a list in brackets, with each {OPTION}; keys are joined by dots"
        raise FaultList([Fault(OPTION, number, start, where, what)])
    for marks in (document.positions, document.key_positions):
        marks.update({at: Mark(number, m.column + shift, OPTION) for at, m in marks.items()})
    return document


VARS = "vars"
REFERENCE = re.compile(r"\$\{([^{}]*)\}")
NAME = r"[A-Za-z_][A-Za-z0-9_-]*"


def references(documents: Iterable[Document]) -> set[str]:
    """Return the names of the vars that the documents ask for, whoever gives them."""
    return {
        match.group(1)
        for document in documents
        for written in document.scalars.values()
        if (match := REFERENCE.fullmatch(written))
    }


def fill_in(document: Document, used: set[str]) -> list[Fault]:
    """Put the vars of a document in place of their `${name}`, take `vars` out, return the faults.

    `used` names the vars that any file of the plan asks for: one that nobody asks for is a fault,
    since a misspelt one would change nothing and say nothing. Raises FaultList where `vars` is no
    mapping at all.
    """
    given = document.data.get(VARS, {})
    if not isinstance(given, dict):
        raise FaultList([document.fault((VARS,), "must be a mapping of names and values")])
    faults = [fault for name in given for fault in _var_faults(document, name, used)]
    for where, value in list(leaves(document.data)):
        if where[:1] == (VARS,) or not isinstance(value, str) or "${" not in value:
            continue
        match = REFERENCE.fullmatch(value)
        if match is None:
            what = (
                f"'{value}' holds '${{' within a longer text; a var stands for a whole value: "
                "put all of the text into the var"
            )
            faults.append(document.fault(where, what))
        elif match.group(1) not in given:
            name = match.group(1)
            hint = nearest(name, given)
            what = f"there is no var '{name}'" + ("" if hint else f"; there are {listed(given)}")
            faults.append(document.fault(where, what, hint and f"'${{{hint}}}'"))
        else:
            _put(document, where, match.group(1))
    document.remove(VARS)
    return faults


def _put(document: Document, where: Where, name: str) -> None:
    def stands_in_var(mark: Mark) -> Mark:
        return replace(mark, var=name)

    document.graft(where, document, (VARS, name), stands_in_var)


def _var_faults(document: Document, name: str, used: set[str]) -> Iterable[Fault]:
    where: Where = (VARS, name)
    if not re.fullmatch(NAME, name):
        what = "is no name of a var; a name has letters, digits, '_' and '-'"
        yield document.fault(where, what, at_key=True)
    elif name not in used:
        hint = nearest(name, used)
        what = f"no value of the plan is '${{{name}}}'; use the var or delete it"
        yield document.fault(where, what, hint and f"'{hint}'", at_key=True)
    for place, value in leaves(document.at(where), where):
        if isinstance(value, dict) or any(isinstance(part, str) for part in place[2:]):
            yield document.fault(where, "a var is one value or a list of values, not a mapping")
            return
        if isinstance(value, str) and "${" in value:
            yield document.fault(place, "a var may not ask for another var; write the value out")


@dataclass(frozen=True)
class Composition:
    """A plan with nothing left to fill in, the files it was made from, and what was wrong."""

    document: Document
    bases: tuple[Path, ...]
    faults: list[Fault]


def compose(plan: Document, overrides: Sequence[str] = ()) -> Composition:
    """Return the plan with its bases merged, `--set` applied and vars filled in.

    Every value keeps the place where it stands: its file and line, or the `--set`. `text` and
    `path` stay those of the plan itself. Raises FaultList when a base cannot be read.
    """
    alone = EXTENDS not in plan.data and VARS not in plan.data
    if alone and not overrides and "${" not in plan.text:
        return Composition(plan, (), [])
    layers = layers_of(plan)
    document = merged(layers)
    faults = override(document, overrides)
    faults += fill_in(document, references([*layers, document]))
    return Composition(document, tuple(layer.path for layer in layers[1:]), faults)
