"""A pydantic model as JSON Schema draft-07, in which values look as a person writes them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from station.fields import key_of, to_yaml_data, unit_in

Schema = dict[str, Any]

_WORDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


def model_schema(model: type[BaseModel]) -> Schema:
    """Return the schema of a model with everything in its place: no references, no titles."""
    raw = model.model_json_schema()
    definitions: dict[str, Schema] = raw.pop("$defs", {})
    for found in dict.fromkeys(_models_in(model)):
        _finish(found, raw if found is model else definitions[found.__name__])
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
                entry["default"] = {key: one for key, one in given.items() if one is not None}
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
    said = [f"{_WORDS[name]} {value:g}{unit}" for name, value in bounds.items()]
    for part in (entry, entry.get("items", {}), *entry.get("anyOf", ())):
        if "pattern" not in part or not said:
            continue
        part["description"] += "; " + ", ".join(said)
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
        return [_plain(one, definitions) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        beside = {key: value for key, value in schema.items() if key != "$ref"}
        name = schema["$ref"].rpartition("/")[2]
        return _plain({**definitions[name], **beside}, definitions)
    found: Schema = {}
    for key, value in schema.items():
        if key == "title" and isinstance(value, str):
            continue
        if key == "properties":
            found[key] = {name: _plain(one, definitions) for name, one in value.items()}
        elif key == "description":
            found[key] = " ".join(value.split())
        elif key in ("default", "enum", "const"):
            found[key] = value
        else:
            found[key] = _plain(value, definitions)
    if "prefixItems" in found:
        found["items"] = found.pop("prefixItems")
    return found
