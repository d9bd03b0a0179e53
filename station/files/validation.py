"""Hold the data of a YAML file against a pydantic model; every fault gets its line and column."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from station.fields import UNIT_ERROR, Unit, key_of, unit_in
from station.files.faults import Fault, FaultList, dotted, listed, nearest

if TYPE_CHECKING:
    from station.files.yaml.document import Document

ModelT = TypeVar("ModelT", bound=BaseModel)
Loc = tuple[str | int, ...]
MAX_LOOKED_AT = 200
MISSING, UNKNOWN, QUOTE = "is missing", "is not known here", "'"

_WANTED = {
    "string_type": "text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "date_type": "a date such as 2027-01-31",
    "date_parsing": "a date such as 2027-01-31",
    "date_from_datetime_parsing": "a date such as 2027-01-31",
}
_BOUNDS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


def validate_model(document: Document, model: type[ModelT], at: Loc = ()) -> ModelT:
    """Return the model of the data at a path; raise FaultList with every fault."""
    validated, faults = check_model(document, model, at)
    if validated is None:
        raise FaultList(faults)
    return validated


def check_model(
    document: Document, model: type[ModelT], at: Loc = ()
) -> tuple[ModelT | None, list[Fault]]:
    """Return the model of the data at a path, or None, and the faults.

    A path that is not in the file counts as an empty mapping there.
    """
    data = _at(document.data, at)
    # As JSON a list may become a tuple and text a date, while `strict` still keeps text, numbers
    # and booleans apart.
    text = json.dumps({} if data is _ABSENT or data is None else data)
    try:
        return model.model_validate_json(text, strict=True), []
    except ValidationError as error:
        faults: dict[tuple[object, ...], Fault] = {}
        details = error.errors(include_url=False)
        for detail in details[:MAX_LOOKED_AT]:
            fault = _fault(document, model, at, dict(detail))
            # A union reports each of its branches at the same place; the first says enough.
            where = (fault.where, fault.line, fault.column)
            if not _is_inside_told(document, at, dict(detail), details):
                faults.setdefault(where, fault)
        listed = list(faults.values())
        more = len(details) - MAX_LOOKED_AT
        if more > 0:
            listed.append(document.fault(at, f"has {more} more faults"))
        return None, listed


def without_meant(faults: Iterable[Fault]) -> Iterator[Fault]:
    """Yield faults but for what is missing because its key is written otherwise beside it."""
    told = list(faults)
    meant = {
        f"{fault.where.removesuffix(fault.where.rpartition('.')[2])}{fault.hint.strip(QUOTE)}"
        for fault in told
        if fault.hint and fault.what.startswith(UNKNOWN)
    }
    return (fault for fault in told if fault.what != MISSING or fault.where not in meant)


def _is_inside_told(document: Document, at: Loc, detail: dict[str, Any], details: Any) -> bool:
    """Whether a branch of a union wants no mapping, where another one looks into the mapping."""
    loc, within = detail["loc"], detail["loc"][:-1]
    is_branch = _in_file(document, at, loc) == _in_file(document, at, within)
    if not (is_branch and isinstance(detail["input"], dict) and detail["type"] in _WANTED):
        return False
    return any(
        len(other["loc"]) > len(loc) and other["loc"][: len(within)] == within for other in details
    )


_ABSENT = object()


def _at(data: Any, path: Loc) -> Any:
    for part in path:
        inside = (isinstance(data, dict) and part in data) or (
            isinstance(data, list) and isinstance(part, int) and part < len(data)
        )
        if not inside:
            return _ABSENT
        data = data[part]
    return data


def _fault(document: Document, model: type[BaseModel], at: Loc, detail: dict[str, Any]) -> Fault:
    kind, loc = detail["type"], detail["loc"]
    path = _in_file(document, at, loc)
    if kind == "missing":
        return document.fault((*path, loc[-1]), MISSING)
    if kind == "extra_forbidden":
        known = _keys_at(model, loc[:-1])
        before, colon, _ = str(loc[-1]).partition(":")
        if colon and before in known:
            what = "is not known here; a blank is missing behind the colon"
            return document.fault(path, what, f"'{before}'", at_key=True)
        hint = nearest(str(loc[-1]), known) or _further_out(model, at, loc)
        what = UNKNOWN if hint else f"is not known here; known are {listed(known)}"
        return document.fault(path, what, hint and f"'{hint}'", at_key=True)
    if loc and loc[-1] == "[key]":
        what, hint = _sentence(kind, detail, str(path[-1]))
        return document.fault(path, what, hint, at_key=True)
    key = _key_of_default(model, loc) if loc else None
    if key is not None and path[-1:] != (key,):
        path = (*path, key)
    what, hint = _sentence(kind, detail, document.scalars.get(path, ""), _unit_at(model, loc))
    return document.fault(path, what, hint)


def _in_file(document: Document, at: Loc, loc: Loc) -> Loc:
    """Return the path in the file; pydantic's loc also names branches of unions, and `[key]`."""
    path = at
    for part in loc:
        if (*path, part) in document.positions:
            path = (*path, part)
    return path


def _sentence(
    kind: str, detail: dict[str, Any], written: str, unit: Unit | None = None
) -> tuple[str, str | None]:
    """Return what is wrong in one sentence, and what was probably meant."""
    context = detail.get("ctx", {})
    value = detail["input"]
    shown = _shown(value)
    if kind == UNIT_ERROR:
        return context["what"], context["hint"]
    if kind == "value_error":
        error = context["error"]
        return getattr(error, "what", str(error)), getattr(error, "hint", None)
    if kind in ("literal_error", "enum"):
        choices = _quoted(context["expected"])
        hint = nearest(str(value), choices)
        return f"must be {context['expected']}, not {shown}", hint and f"'{hint}'"
    if kind == "string_type" and isinstance(value, (int, float)):
        return f"must be text, not {shown}", f'"{written}"'
    if kind in _WANTED:
        return f"must be {_WANTED[kind]}, not {shown}", None
    if kind in _BOUNDS:
        name, word = _BOUNDS[kind]
        symbol = "" if unit is None or unit.symbol == "1" else f" {unit.symbol}"
        bound = f"{context[name]:g}{symbol if context[name] else ''}"
        given = f"'{written}'" if symbol and written else shown
        return f"must be {word} {bound}, not {given}", None
    if kind in ("too_short", "string_too_short"):
        what = "may not be empty" if context["min_length"] == 1 else "is too short"
        return what, None
    if kind in ("too_long", "string_too_long"):
        return f"is too long, {context['max_length']} at most", None
    return f"{detail['msg'][:1].lower()}{detail['msg'][1:]}, not {shown}", None


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (dict, list)):
        return "a mapping" if isinstance(value, dict) else "a list"
    return f"'{value}'" if isinstance(value, str) else str(value)


def _quoted(expected: str) -> list[str]:
    """Return the words of pydantic's `'IA', 'NA' or 'LA'`."""
    return expected.split("'")[1::2]


def _key_of_default(model: type[BaseModel], loc: Loc) -> str | None:
    """Return the key of a default that a validator refused: it is not in the file.

    For a default pydantic's loc ends with the attribute instead of the key.
    """
    for inner in _models_at(model, loc[:-1]):
        if loc[-1] in inner.model_fields:
            return key_of(inner, str(loc[-1]))
    return None


def _further_out(model: type[BaseModel], at: Loc, loc: Loc) -> str | None:
    """Return where a key stands that is known nearer to the beginning of the file."""
    for k in reversed(range(len(loc) - 1)):
        if loc[-1] in _keys_at(model, loc[:k]):
            return dotted((*at, *loc[:k], loc[-1]))
    return None


def _keys_at(model: type[BaseModel], loc: Loc) -> list[str]:
    """Return the keys that are known at a place in a model."""
    for inner in _models_at(model, loc):
        return [key_of(inner, name) for name in inner.model_fields]
    return []


def _unit_at(model: type[BaseModel], loc: Loc) -> Unit | None:
    """Return the unit of a field: a bound is a number in it, whatever unit was written."""
    for inner in _models_at(model, loc[:-1]):
        for name, field in inner.model_fields.items():
            if loc[-1] in (name, key_of(inner, name)):
                return unit_in((field.annotation, *field.metadata))
    return None


def _models_at(annotation: Any, loc: Loc) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if not loc:
            yield annotation
        for name, field in annotation.model_fields.items():
            if loc and key_of(annotation, name) == loc[0]:
                yield from _models_at(field.annotation, loc[1:])
        return
    container = getattr(annotation, "__origin__", None) in (list, tuple, dict)
    for inner in get_args(annotation):
        # Where a union has a model, pydantic's loc names it.
        named = container or (bool(loc) and loc[0] == getattr(inner, "__name__", None))
        yield from _models_at(inner, loc[1:] if named else loc)
