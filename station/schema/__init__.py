"""JSON Schema (draft-07) of plans, benches and datasets, made from the models that read them.

An editor shows keys, units and choices with it while a person writes. What a schema cannot say
(ranges of quantities, one value against another) `station validate` says.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import distribution
from typing import Any

from station import registry
from station.dataset_reading import DatasetHeader
from station.driver_checks import keys_of, settings_of, settings_of_role
from station.files.plan import PlanHeader
from station.instruments.bench import bench_file
from station.procedure import Procedure
from station.roles.role import BUILT_IN, Role, offered_by, roles, roles_of
from station.schema.models import (
    DEFINITIONS,
    VARS,
    Schema,
    limits_schema,
    model_schema,
    only_required,
    or_var,
    without_required,
)

DRAFT = "http://json-schema.org/draft-07/schema#"
DISTRIBUTION = "inertial-station"


def schema_text(kind: str, *, built_in: bool = False) -> str:
    """Return the schema of a `plan`, `bench` or `dataset` as JSON text.

    `built_in` leaves out the procedures, roles and drivers of other packages.
    """
    schema = KINDS[kind](built_in)
    made = f"station schema {kind}{' --built-in' if built_in else ''}"
    head = {"$schema": DRAFT, "$comment": f"made by: {made}", "title": f"Inertial Station: {kind}"}
    return json.dumps({**head, **schema}, indent=1, ensure_ascii=False) + "\n"


def plan_schema(built_in: bool = False) -> Schema:
    """Return the schema of a plan: parameters and limits follow from the procedure."""
    procedures = _procedures(built_in)
    header = model_schema(PlanHeader)
    header["properties"] |= {"vars": VARS, "extends": {"type": "string", "minLength": 1}}
    header["properties"]["procedure"] |= {"enum": list(procedures)}
    fixed = {key: header["properties"][key] for key in ("plan", "extends", "vars")}
    whole = or_var(without_required(header))
    whole["properties"] |= fixed
    alone = {"not": {"required": ["extends"]}}
    rules: list[Schema] = [{"if": alone, "then": only_required(header)}]
    for name, procedure in procedures.items():
        parameters = model_schema(procedure.parameters)
        inside = {"parameters": parameters, "limits": limits_schema(procedure.results)}
        partial = {key: or_var(without_required(part)) for key, part in inside.items()}
        chosen = _chosen(name)
        rules.append({"if": chosen, "then": {"properties": partial}})
        needed = {key: only_required(part) for key, part in inside.items()}
        complete: Schema = {"properties": {key: part for key, part in needed.items() if part}}
        if parameters.get("required"):
            complete["required"] = ["parameters"]
        rules.append({"if": {"allOf": [chosen, alone]}, "then": complete})
    return {**whole, "definitions": DEFINITIONS, "allOf": rules}


def bench_schema(built_in: bool = False) -> Schema:
    """Return the schema of a bench file."""
    schema = model_schema(bench_file())
    instruments = schema["properties"]["instruments"]
    known = _roles(built_in)
    instances = [name for role in known for name in role.instances]
    instruments["propertyNames"] = {"enum": instances}
    entry = instruments["additionalProperties"]
    limits = entry["properties"]["limits"]["properties"]
    declared = {name for role in known for name in role.limits}
    entry["properties"]["limits"]["properties"] = {
        name: limit for name, limit in limits.items() if name in declared
    }
    entry["properties"]["driver"]["enum"] = list(_names(registry.DRIVERS, built_in))
    # Beside additionalProperties a pattern would take the place of the whole entry.
    needs = {f"^{role.name}(\\.|$)": _needed(role) for role in known}
    instruments["allOf"] = [
        {"patternProperties": {key: need for key, need in needs.items() if need}}
    ]
    offered = entry["properties"]["driver"]["enum"]
    drivers = [
        (name, driver) for name, driver in registry.loaded(registry.DRIVERS) if name in offered
    ]
    entry["allOf"] = [rule for name, driver in drivers for rule in _settings_rules(name, driver)]
    step = schema["properties"]["safe_state"]["items"]
    step["properties"]["instrument"] = {"enum": instances}
    step["properties"]["role"] = {"enum": [role.name for role in known]}
    step["oneOf"] = [{"required": ["instrument"]}, {"required": ["role"]}]
    level = schema["properties"]["interlocks"]["items"]["properties"]["when"]["anyOf"][0]
    watched = sorted({name for role in known for name in role.quantities})
    level["properties"]["quantity"] = {"enum": watched}
    return schema


def dataset_schema(built_in: bool = False) -> Schema:
    """Return the schema of a dataset: its conditions follow from the procedure."""
    schema = model_schema(DatasetHeader)
    procedures = _procedures(built_in)
    schema["properties"]["procedure"]["enum"] = list(procedures)
    rules = [
        {
            "if": _chosen(name),
            "then": {"properties": {"conditions": model_schema(procedure.conditions())}},
        }
        for name, procedure in procedures.items()
        if procedure.conditions is not None
    ]
    return {**schema, "allOf": rules} if rules else schema


KINDS: Mapping[str, Callable[[bool], Schema]] = {
    "plan": plan_schema,
    "bench": bench_schema,
    "dataset": dataset_schema,
}


def _names(group: str, built_in: bool) -> Sequence[str]:
    if not built_in:
        return registry.names(group)
    return sorted(
        entry.name for entry in distribution(DISTRIBUTION).entry_points.select(group=group)
    )


def _procedures(built_in: bool) -> dict[str, Procedure]:
    names = _names(registry.PROCEDURES, built_in)
    return {
        name: procedure for name, procedure in registry.loaded(registry.PROCEDURES) if name in names
    }


def _roles(built_in: bool) -> list[Role]:
    return [*offered_by(BUILT_IN)] if built_in else [*roles().values()]


def _chosen(procedure: str) -> Schema:
    return {"properties": {"procedure": {"const": procedure}}, "required": ["procedure"]}


def _needed(role: Role) -> Schema:
    """Return what the bench file must say of a role before it may be energised."""
    needed: dict[str, Any] = {}
    if role.needed_limits:
        needed["limits"] = {"required": list(role.needed_limits)}
    required = list(needed)
    if role.settings is not None:
        settings = model_schema(role.settings)
        needed["settings"] = {
            key: settings[key] for key in ("required", "properties") if key in settings
        }
        required += ["settings"] if "required" in settings else []
    return {"required": required, "properties": needed} if needed else {}


def _settings_rules(name: str, driver: type) -> Iterator[Schema]:
    """Yield what a driver takes as settings; nothing where they cannot be described."""
    with suppress(Exception):  # whatever the package of a driver makes of them
        yield _settings_rule(name, driver)


def _settings_rule(name: str, driver: type) -> Schema:
    """Return what a driver takes as settings, beside those of the roles that it may fill."""
    model = settings_of(driver)
    settings = model_schema(model)
    filled = [settings_of_role(name) for name in roles_of(driver)]
    common = [keys_of(settings) for settings in filled if settings is not None]
    keys = sorted({*keys_of(model), *(key for keys in common for key in keys)})
    rule: Schema = {
        "properties": {
            "settings": {"propertyNames": {"enum": keys}, "properties": settings["properties"]}
        }
    }
    if "required" in settings:
        rule["required"] = ["settings"]
        rule["properties"]["settings"]["required"] = settings["required"]
    return {"if": {"properties": {"driver": {"const": name}}}, "then": rule}
