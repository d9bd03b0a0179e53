"""A pydantic model as JSON Schema draft-07, values as a person writes them; what a plan adds.

A plan adds vars, `extends`, and limits of results.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from station.fields import Unit, key_of, to_yaml_data, unit_in
from station.files.plan.composition import NAME
from station.files.plan.model import BOUNDS, LimitedResult

Schema = dict[str, Any]

_WORDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


def model_schema(model: type[BaseModel]) -> Schema:
    """Return the schema of a model with everything in its place: no references, no titles."""
    raw = model.model_json_schema()
    definitions: dict[str, Schema] = raw.pop("$defs", {})
    for inner in dict.fromkeys(_models_in(model)):
        _finish(inner, raw if inner is model else definitions[inner.__name__])
    schema: Schema = _plain(raw, definitions)
    return schema


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from _models_in(field.annotation)
    for inner in get_args(annotation):
        yield from _models_in(inner)


def _finish(model: type[BaseModel], schema: Schema) -> None:
    """Write defaults with their units, and bounds, which no pattern holds, in words."""
    for name, field in model.model_fields.items():
        entry = schema["properties"][key_of(model, name)]
        unit = unit_in((field.annotation, *field.metadata))
        default = field.get_default(call_default_factory=True)
        if "default" in entry:
            if isinstance(default, BaseModel):
                given = to_yaml_data(default)
                entry["default"] = {key: value for key, value in given.items() if value is not None}
            elif unit is not None and isinstance(default, float):
                entry["default"] = unit.write(default)
            if entry["default"] in (None, {}, []):
                del entry["default"]
        if unit is not None:
            _bound(entry, field, "" if unit.symbol == "1" else f" {unit.symbol}")


def _bound(entry: Schema, field: FieldInfo, unit: str) -> None:
    bounds = {
        name: value
        for part in _metadata(field)
        for name in _WORDS
        if (value := getattr(part, name, None)) is not None
    }
    limits = [f"{_WORDS[name]} {value:g}{unit}" for name, value in bounds.items()]
    for part in (entry, entry.get("items", {}), *entry.get("anyOf", ())):
        if "pattern" not in part or not limits:
            continue
        part["description"] += "; " + ", ".join(limits)
        if max(bounds.get("gt", -1), bounds.get("ge", -1)) >= 0:
            part["pattern"] = part["pattern"].replace("[+-]?(", r"\+?(", 1)


def _metadata(field: FieldInfo) -> Iterator[Any]:
    """Yield what annotates a field, also below `| None`, where a FieldInfo holds it."""
    for part in (*field.metadata, *_annotations(field.annotation)):
        yield from part.metadata if isinstance(part, FieldInfo) else (part,)


def _annotations(annotation: Any) -> Iterator[Any]:
    yield from getattr(annotation, "__metadata__", ())
    for inner in get_args(annotation):
        if inner is not annotation:
            yield from _annotations(inner)


def _plain(schema: Any, definitions: dict[str, Schema]) -> Any:
    """Return a schema with references written out and pydantic's titles left out."""
    if isinstance(schema, list):
        return [_plain(item, definitions) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        beside = {key: value for key, value in schema.items() if key != "$ref"}
        name = schema["$ref"].rpartition("/")[2]
        return _plain({**definitions[name], **beside}, definitions)
    plain: Schema = {}
    for key, value in schema.items():
        if key == "title" and isinstance(value, str):
            continue
        if key == "properties":
            plain[key] = {name: _plain(inner, definitions) for name, inner in value.items()}
        elif key == "description":
            plain[key] = " ".join(value.split())
        elif key in ("default", "enum", "const"):
            plain[key] = value
        else:
            plain[key] = _plain(value, definitions)
    if "prefixItems" in plain:
        plain["items"] = plain.pop("prefixItems")
    return plain


VAR = {"$ref": "#/definitions/var"}
DEFINITIONS: Schema = {
    "var": {
        "type": "string",
        "pattern": rf"^\$\{{{NAME}\}}$",
        "description": "the value of a var, such as '${drive}'",
    }
}
_SCALAR = ["string", "number", "boolean", "null"]
VARS: Schema = {
    "type": "object",
    "propertyNames": {"pattern": f"^{NAME}$"},
    "additionalProperties": {"type": [*_SCALAR, "array"], "items": {"type": _SCALAR}},
    "description": "Values that stand once and are used as '${name}' in the place of a whole value",
}


def or_var(schema: Schema) -> Schema:
    """Return a schema that takes `${name}` in the place of every value that it holds."""
    if "anyOf" in schema:
        branches = [or_var(branch) for branch in schema["anyOf"]]
        flat = [inner for branch in branches for inner in branch.get("anyOf", [branch])]
        distinct = [branch for branch in flat if branch != VAR]
        return {**schema, "anyOf": [*distinct, VAR] if len(distinct) < len(flat) else flat}
    taking = dict(schema)
    if "properties" in taking:
        taking["properties"] = {name: or_var(inner) for name, inner in taking["properties"].items()}
    for inner in ("items", "additionalProperties"):
        if isinstance(taking.get(inner), dict):
            taking[inner] = or_var(taking[inner])
    if taking.get("type") in ("object", "null"):
        return taking
    if taking.get("type") == "string" and not {"pattern", "enum", "const", "format"} & set(taking):
        return taking
    around: Schema = {key: taking.pop(key) for key in ("description", "default") if key in taking}
    return {**around, "anyOf": [taking, VAR]}


def without_required(schema: Schema) -> Schema:
    """Return a schema in which mappings may lack keys, as a plan may that extends another.

    An entry of a list lacks nothing: lists are replaced as a whole.
    """
    partial = {
        key: value for key, value in schema.items() if key not in ("required", "minProperties")
    }
    if "properties" in partial:
        partial["properties"] = {
            name: without_required(inner) for name, inner in partial["properties"].items()
        }
    if "anyOf" in partial:
        partial["anyOf"] = [without_required(branch) for branch in partial["anyOf"]]
    if isinstance(partial.get("additionalProperties"), dict):
        partial["additionalProperties"] = without_required(partial["additionalProperties"])
    return partial


def only_required(schema: Schema) -> Schema:
    """Return what `without_required` takes out; an empty mapping when that is nothing."""
    required = {key: schema[key] for key in ("required", "minProperties") if schema.get(key)}
    inner = {name: only_required(part) for name, part in schema.get("properties", {}).items()}
    inner = {name: part for name, part in inner.items() if part}
    if inner:
        required["properties"] = inner
    branches = [only_required(branch) for branch in schema.get("anyOf", ())]
    if len([branch for branch in schema.get("anyOf", ()) if branch.get("type") == "object"]) == 1:
        # `required` binds mappings only, so it may stand beside the other branch, null.
        required.update(next((branch for branch in branches if branch), {}))
    if isinstance(schema.get("additionalProperties"), dict):
        every = only_required(schema["additionalProperties"])
        if every:
            required["additionalProperties"] = every
    return required


def limits_schema(results: Mapping[str, LimitedResult]) -> Schema:
    """Return the schema of the limits on a procedure's results, for each in its unit."""
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": {name: _limit(kind) for name, kind in results.items()},
    }


def _limit(kind: LimitedResult) -> Schema:
    quantity = Unit(kind.unit).json_schema()
    bounds: dict[str, Any] = dict.fromkeys(BOUNDS, quantity)
    whole: Schema = {
        "type": "object",
        "additionalProperties": False,
        "minProperties": 1,
        "properties": bounds,
    }
    if not kind.axes:
        return whole
    axes: Schema = {**whole, "properties": dict.fromkeys(kind.axes, whole)}
    return {"anyOf": [whole, axes]}
