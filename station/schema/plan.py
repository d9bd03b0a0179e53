"""What a plan adds to the schemas of its models: vars, `extends`, and limits of results."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from station.fields import Unit
from station.files.plan.composition import NAME
from station.files.plan.model import BOUNDS, LimitedResult
from station.schema.models import Schema

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
        branches = [or_var(one) for one in schema["anyOf"]]
        flat = [one for branch in branches for one in branch.get("anyOf", [branch])]
        distinct = [one for one in flat if one != VAR]
        return {**schema, "anyOf": [*distinct, VAR] if len(distinct) < len(flat) else flat}
    found = dict(schema)
    if "properties" in found:
        found["properties"] = {name: or_var(one) for name, one in found["properties"].items()}
    for inner in ("items", "additionalProperties"):
        if isinstance(found.get(inner), dict):
            found[inner] = or_var(found[inner])
    if found.get("type") in ("object", "null"):
        return found
    if found.get("type") == "string" and not {"pattern", "enum", "const", "format"} & set(found):
        return found
    around: Schema = {key: found.pop(key) for key in ("description", "default") if key in found}
    return {**around, "anyOf": [found, VAR]}


def without_required(schema: Schema) -> Schema:
    """Return a schema in which mappings may lack keys, as a plan may that extends another.

    An entry of a list lacks nothing: lists are replaced as a whole.
    """
    found = {
        key: value for key, value in schema.items() if key not in ("required", "minProperties")
    }
    if "properties" in found:
        found["properties"] = {
            name: without_required(one) for name, one in found["properties"].items()
        }
    if "anyOf" in found:
        found["anyOf"] = [without_required(one) for one in found["anyOf"]]
    if isinstance(found.get("additionalProperties"), dict):
        found["additionalProperties"] = without_required(found["additionalProperties"])
    return found


def only_required(schema: Schema) -> Schema:
    """Return what `without_required` takes out; an empty mapping when that is nothing."""
    found = {key: schema[key] for key in ("required", "minProperties") if schema.get(key)}
    inner = {name: only_required(one) for name, one in schema.get("properties", {}).items()}
    inner = {name: one for name, one in inner.items() if one}
    if inner:
        found["properties"] = inner
    branches = [only_required(one) for one in schema.get("anyOf", ())]
    if len([one for one in schema.get("anyOf", ()) if one.get("type") == "object"]) == 1:
        # `required` binds mappings only, so it may stand beside the other branch, null.
        found.update(next((one for one in branches if one), {}))
    if isinstance(schema.get("additionalProperties"), dict):
        every = only_required(schema["additionalProperties"])
        if every:
            found["additionalProperties"] = every
    return found


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
