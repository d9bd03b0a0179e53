"""The keys of plan, bench file and dataset, read from the models that check them."""

from __future__ import annotations

import importlib
import types
import typing
from collections.abc import Iterator
from typing import Any, Literal, Union, get_args, get_origin

from meanings import BENCH, CONDITIONS, DATASET, PARAMETERS, PLAN
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from tables import code, first_sentence, table

from station import registry
from station.dataset_reading import DatasetHeader
from station.driver_checks import keys_of, settings_of
from station.fields import Unit, key_of
from station.files.plan import PlanHeader
from station.instruments.bench import bench_file
from station.instruments.calibration import UNIT_OF_QUANTITY
from station.procedure import Procedure, procedure_of
from station.roles.role import instances
from station.roles.sources import TITLE
from station.units import expectation, format_quantity

HEAD = ("key", "what is written", "default", "meaning")
NAMES = {str: "text", int: "whole number", float: "number", bool: "`true` or `false`"}
BOUNDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


def plan_keys() -> str:
    """Return the keys of a plan."""
    return key_table(PlanHeader, PLAN)


def bench_keys() -> str:
    """Return the keys of a bench file, and the names of its instruments."""
    quantities = [(code(name), unit) for name, unit in UNIT_OF_QUANTITY.items()]
    return (
        key_table(bench_file(), BENCH)
        + "\n## Instances\n\nThe name of an instrument is one of "
        + ", ".join(code(name) for name in instances())
        + ". [Roles](roles.md) has the limits that each needs and the settings that it takes.\n"
        + "\n## Quantities of a calibration record\n\n"
        + table(("quantity", "kept in"), quantities)
    )


def dataset_keys() -> str:
    """Return the keys of a dataset, and the conditions and columns of each procedure."""
    parts = [key_table(DatasetHeader, DATASET)]
    for procedure in built_in():
        if procedure.conditions is not None:
            meanings = CONDITIONS.get(procedure.name, {})
            parts.append(f"\n## Conditions of {procedure.name}\n\n")
            parts.append(key_table(procedure.conditions(), meanings))
    return "".join(parts)


def built_in() -> Iterator[Procedure]:
    """Yield the procedures that come with the station."""
    yield from map(procedure_of, registry.own_names(registry.PROCEDURES))


def procedures() -> str:
    """Return a section for each procedure: parameters, results, steps, prompts."""
    parts = []
    for one in built_in():
        results = [
            (code(name), ", ".join(kind.axes) or "none", code(kind.unit))
            for name, kind in one.results.items()
        ]
        steps = [(step.number, step.title) for step in one.steps]
        parts += [
            f"## {one.name}\n\n{one.title}. Source: {one.source}.\n\n### Parameters\n\n",
            key_table(one.parameters, PARAMETERS.get(one.name, {})),
            "\n### Results\n\n",
            table(("name", "axes", "unit"), results),
            "\n### Steps\n\n",
            table(("number", "title"), steps),
            "\n### What its numbers do not say\n\n",
            *(f"- {text}\n" for text in one.assumptions),
            "\n",
        ]
    return "".join(parts)


def drivers() -> str:
    """Return the drivers with what their docstrings say, and the settings of each."""
    rows, settings = [], []
    simulated = set(registry.own_names(registry.SIMULATORS))
    for name in registry.own_names(registry.DRIVERS):
        driver = registry.load(registry.DRIVERS, name)
        module = importlib.import_module(driver.__module__)
        about = " ".join((driver.__doc__ or "").partition(TITLE)[0].split())
        has = "yes" if name in simulated else "no"
        wired = {one: f" (by `settings.{key}`)" for one, key in driver.wired_by.items()}
        reads = ", ".join(code(one) + wired.get(one, "") for one in driver.quantities)
        rows.append((code(name), first_sentence(module.__doc__), about, reads or "none", has))
        keyed = {row[0]: row for row in key_rows(settings_of(driver), {})}
        settings += [(code(name), *keyed[code(key)]) for key in keys_of(settings_of(driver))]
    head = ("driver", "instrument", "how it works, and its limits", "reads", "simulator")
    return (
        table(head, rows)
        + "\n## Settings of each driver\n\nA driver that is not named here has none.\n\n"
        + table(("driver", *HEAD), settings)
    )


def key_table(model: type[BaseModel], meanings: dict[str, str]) -> str:
    """Return the table of a model's keys, those of models within it included."""
    return table(HEAD, key_rows(model, meanings))


def key_rows(model: type[BaseModel], meanings: dict[str, str]) -> list[tuple[str, ...]]:
    """Return the rows of a table of a model's keys."""
    return [
        (code(path), written(*kind), default, field.description or meanings.get(path, ""))
        for path, kind, default, field in keys(model)
    ]


Kind = tuple[Any, tuple[Any, ...]]


def keys(model: type[BaseModel], before: str = "") -> Iterator[tuple[str, Kind, str, FieldInfo]]:
    """Yield each key's path, its type with metadata, its default as text, and its field."""
    for name, field in model.model_fields.items():
        path = before + key_of(model, name)
        kind = (field.annotation, tuple(field.metadata))
        yield path, kind, default_of(field), field
        for inner, mark in models_in(field.annotation):
            yield from keys(inner, f"{path}{mark}.")


def models_in(annotation: Any) -> Iterator[tuple[type[BaseModel], str]]:
    """Yield the models within an annotation, with the mark of the list or mapping they stand in."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, ""
    inner = get_args(annotation)
    origin = get_origin(annotation)
    mark = "[]" if origin in (tuple, list) else ".NAME" if origin is dict else ""
    for part in inner:
        for model, deeper in models_in(part):
            yield model, mark + deeper


def default_of(field: FieldInfo) -> str:
    """Return a default as it is written in YAML, "required" without one."""
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    unit = unit_in(field.annotation, field.metadata)
    if value is None or value in ({}, ()) or isinstance(value, BaseModel):
        return ""
    quantity = unit is not None and unit.symbol != "1"
    if isinstance(value, tuple):
        each = [format_quantity(one, unit.symbol) if quantity else str(one) for one in value]
        return code(f"[{', '.join(each)}]")
    if quantity:
        return code(format_quantity(value, unit.symbol))
    return code(str(value).lower() if isinstance(value, bool) else value)


def unit_in(annotation: Any, metadata: typing.Sequence[Any]) -> Unit | None:
    """Return the unit of an annotation with metadata."""
    for part in (*metadata, *get_args(annotation)):
        if isinstance(part, Unit):
            return part
        found = unit_in(part, getattr(part, "metadata", ())) if get_args(part) else None
        if found is not None:
            return found
        nested = getattr(part, "metadata", None)
        if nested and not isinstance(part, type):
            found = unit_in(None, nested)
            if found is not None:
                return found
    return None


def written(annotation: Any, metadata: tuple[Any, ...]) -> str:
    """Say in words what is written for an annotation with metadata."""
    flat = list(flattened(metadata))
    limits = "".join(
        f", {word} {getattr(one, name):g}"
        for one in flat
        for name, word in BOUNDS.items()
        if isinstance(getattr(one, name, None), int | float)
    )
    units = [one for one in flat if isinstance(one, Unit)]
    if units:
        symbol, expected = (
            units[0].symbol,
            expectation(units[0].symbol, difference=units[0].difference),
        )
        return f"{expected}{limits}" + (f" {symbol}" if limits and symbol != "1" else "")
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is typing.Annotated:
        return written(inner[0], (*inner[1:], *metadata))
    if origin in (Union, types.UnionType):
        parts = [part for part in inner if part is not types.NoneType]
        return " or ".join(written(part, metadata) for part in parts)
    if origin is Literal:
        return " or ".join(code(value) for value in inner)
    if origin is dict:
        holds = written(inner[1], ())
        return "a mapping" if inner[1] is Any else f"a mapping, each {holds}"
    if origin in (tuple, list):
        return f"a list, each {written(inner[0], ())}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "a mapping"
    return NAMES.get(annotation, getattr(annotation, "__name__", "any")) + limits


def flattened(metadata: typing.Iterable[Any]) -> Iterator[Any]:
    """Yield metadata, what a `Field` within holds in its place."""
    for one in metadata:
        if isinstance(one, FieldInfo):
            yield from flattened(one.metadata)
        else:
            yield one
