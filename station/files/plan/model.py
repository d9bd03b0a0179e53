"""A test plan: a procedure with its parameters, the device under test, limits, decision rule."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

from pydantic import BaseModel, Field, field_validator

from station.decision import Limit, Rule
from station.errors import InputError
from station.fields import StrictModel, to_yaml_data
from station.files.faults import Fault, FaultList, listed, nearest, not_there
from station.files.plan.composition import compose
from station.files.plan.room import Room
from station.files.validation import check_model
from station.files.yaml.document import Document, FromDocument, leaves
from station.files.yaml.reading import read_yaml
from station.units import UnitError, parse_as

BOUNDS = ("min", "max", "max_abs")

LimitsByAxis = dict[tuple[str, str | None], Limit]
Where = tuple[str | int, ...]


class LimitedResult(Protocol):
    """What is known of a result before it is measured."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Its axes; none for a result without axes."""
        ...

    @property
    def unit(self) -> str:
        """Its unit."""
        ...


def read_limits(
    document: Document, results: Mapping[str, LimitedResult]
) -> tuple[LimitsByAxis, list[Fault]]:
    """Return the limits of a plan by (result, axis), in the unit of each result, and the faults.

    `{magnetic_sensitivity: {max_abs: 0.1 deg/h/mT}}` holds for every axis,
    `{magnetic_sensitivity: {IA: {min: …, max: …}}}` for one, `{magnetic_sensitivity: null}` takes
    away the limit of a plan that is extended. The axis of a result without axes is None.
    """
    limits: LimitsByAxis = {}
    faults: list[Fault] = []
    given = document.data.get("limits")
    for name, entry in given.items() if isinstance(given, dict) else ():
        where: Where = ("limits", name)
        if entry is None:  # takes the limit of the plan that is extended away
            continue
        if name not in results:
            hint = nearest(name, results)
            what = "is no result of this procedure"
            if not hint:
                what += f"; its results are {listed(results)}"
            faults.append(document.fault(where, what, hint and f"'{hint}'", at_key=True))
            continue
        kind = results[name]
        for axes, place, bounds in _bounds(entry, where, kind, document, faults):
            limit = _limit(bounds, place, kind.unit, document, faults)
            if limit is not None:
                limits.update({(name, axis): limit for axis in axes})
    return limits, faults


def _bounds(
    entry: Any, where: Where, kind: LimitedResult, document: Document, faults: list[Fault]
) -> Iterator[tuple[tuple[str | None, ...], Where, Any]]:
    """Yield the axes that bounds hold for, the place of the bounds in the plan, and the bounds."""
    if not isinstance(entry, dict) or not entry:
        what = f"must be a mapping of {listed(BOUNDS)}"
        faults.append(document.fault(where, what + (", or of axes" if kind.axes else "")))
        return
    axes = [key for key in entry if key in kind.axes]
    if axes:
        known: tuple[str, ...] = kind.axes
        for axis in axes:
            yield (axis,), (*where, axis), entry[axis]
    else:
        known = (*BOUNDS, *kind.axes)
        whole = {key: value for key, value in entry.items() if key in BOUNDS}
        if whole:
            yield kind.axes or (None,), where, whole
    for key in entry:
        if key in known:
            continue
        if axes and key in BOUNDS:
            what = "stands beside axes; give bounds to the whole result or to each axis"
            faults.append(document.fault((*where, key), what, at_key=True))
            continue
        hint = nearest(key, known)
        what = "is not known here" + ("" if hint else f"; known are {listed(known)}")
        faults.append(document.fault((*where, key), what, hint and f"'{hint}'", at_key=True))


def _limit(
    bounds: Any, where: Where, unit: str, document: Document, faults: list[Fault]
) -> Limit | None:
    before = len(faults)
    if not isinstance(bounds, dict) or not bounds:
        faults.append(document.fault(where, f"must be a mapping of {listed(BOUNDS)}"))
        return None
    numbers: dict[str, float] = {}
    for name, text in bounds.items():
        here = (*where, name)
        if name not in BOUNDS:
            hint = nearest(name, BOUNDS)
            what = "is not known here" + ("" if hint else f"; known are {listed(BOUNDS)}")
            faults.append(document.fault(here, what, hint and f"'{hint}'", at_key=True))
            continue
        try:
            numbers[name] = parse_as(text, unit)
        except UnitError as error:
            faults.append(document.fault(here, error.what, error.hint))
    if "max_abs" in numbers and ("min" in bounds or "max" in bounds):
        what = "limits the magnitude; give it alone, or min and max"
        faults.append(document.fault((*where, "max_abs"), what, at_key=True))
    if numbers.get("max_abs", 0.0) < 0:
        faults.append(document.fault((*where, "max_abs"), "a magnitude cannot be below zero"))
    if "min" in numbers and "max" in numbers and numbers["min"] > numbers["max"]:
        what = f"is above max ({bounds['max']}); exchange them"
        faults.append(document.fault((*where, "min"), what))
    return None if len(faults) > before else Limit(**numbers)


Words = Annotated[str, Field(min_length=1)]
LONGEST = "30 d"
"""A plan that takes more bench time is refused; what lasts longer is several plans."""
MAX_S = parse_as(LONGEST, "s")
MAX_SERIAL = 100
NOT_IN_FILE_NAMES = '/\\:*?"<>|'


class Dut(StrictModel):
    """The device under test."""

    model: Words
    serial: Words
    manufacturer: Words | None = None
    received: dt.date | None = None
    condition: Words | None = None
    notes: str | None = None

    @field_validator("serial")
    @classmethod
    def names_a_folder(cls, serial: str) -> str:
        """Refuse what no folder name can hold: the run folder is named after the serial number."""
        wrong = [char for char in serial if char in NOT_IN_FILE_NAMES or not char.isprintable()]
        if wrong:
            raise ValueError(f"names the run folder and may not hold {wrong[0]!r}")
        if len(serial) > MAX_SERIAL:
            raise ValueError(
                f"names the run folder and has {len(serial)} characters; {MAX_SERIAL} at most"
            )
        return serial


class Customer(StrictModel):
    """Who ordered the measurement, as a certificate names them."""

    name: Words
    address: Words


class PlanHeader(StrictModel):
    """The keys of a plan; the procedure's own model reads `parameters`."""

    plan: Literal[1]
    procedure: Words
    title: str | None = None
    operator: str | None = None
    released: bool = False
    check_standard: bool = False
    dut: Dut
    customer: Customer | None = None
    room: Room | None = None
    parameters: dict[str, Any] = Field(default_factory=dict)
    limits: dict[str, Any] = Field(default_factory=dict)
    decision_rule: Rule = "simple"
    references: dict[str, str] = Field(default_factory=dict)
    deviations: tuple[Words, ...] = ()
    # Both are gone from a plan that is put together; they stand here to be known.
    extends: Words | None = None
    vars: dict[str, Any] = Field(default_factory=dict)


class PlannedProcedure(Protocol):
    """What a plan must know of a procedure."""

    @property
    def parameters(self) -> type[BaseModel]:
        """The model of its parameters."""
        ...

    @property
    def results(self) -> Mapping[str, LimitedResult]:
        """Its results, with axes and unit."""
        ...


class KnownProcedures(Protocol):
    """The procedures by name; one is loaded when it is asked for."""

    def __contains__(self, name: object) -> bool: ...

    def __iter__(self) -> Iterator[str]: ...

    def __getitem__(self, name: str, /) -> PlannedProcedure: ...


@dataclass(frozen=True)
class Plan(FromDocument):
    """A plan that has no fault; `parameters` is the procedure's own model.

    `document` is the plan put together, `bases` the files it extends, `overrides` each `--set`.
    """

    header: PlanHeader
    parameters: Any
    limits: LimitsByAxis
    document: Document
    bases: tuple[Path, ...] = ()
    overrides: tuple[str, ...] = ()

    @property
    def procedure(self) -> str:
        """The procedure's name."""
        return self.header.procedure

    @property
    def title(self) -> str | None:
        """What the plan calls itself."""
        return self.header.title

    @property
    def operator(self) -> str | None:
        """Who runs it, when the plan says so."""
        return self.header.operator

    @property
    def dut(self) -> Dut:
        """The device under test."""
        return self.header.dut

    @property
    def decision_rule(self) -> Rule:
        """The rule by which results are held against their limits."""
        return self.header.decision_rule

    def limits_by_axis(self) -> LimitsByAxis:
        """Return the limits by result name and axis, each in its result's unit."""
        return dict(self.limits)

    def to_yaml_data(self) -> dict[str, Any]:
        """Return the plan with every default written out, as data for YAML; it stands alone."""
        data = {**to_yaml_data(self.header), "parameters": to_yaml_data(self.parameters)}
        return {key: value for key, value in data.items() if key not in ("extends", "vars")}


def read_plan(path: Path, procedures: KnownProcedures, overrides: Sequence[str] = ()) -> Plan:
    """Read a plan file; raise FaultList with the faults of all its parts at once.

    `overrides` are those of `--set`, such as `parameters.frequency=0.2 Hz`.
    """
    return plan_of(read_yaml(path), procedures, overrides)


def times_too_long(document: Document) -> Iterator[Fault]:
    """Yield a fault for each time in the parameters that no plan can last."""
    for where, value in leaves(document.data.get("parameters"), ("parameters",)):
        with suppress(UnitError):  # no time, or a fault of its own
            if isinstance(value, str) and parse_as(value, "s") > MAX_S:
                yield document.fault(
                    where, f"'{value}' is too long: a plan takes {LONGEST} at most"
                )


def plan_of(given: Document, procedures: KnownProcedures, overrides: Sequence[str] = ()) -> Plan:
    """Return the plan that a document holds; raise FaultList with every fault."""
    composition = compose(given, overrides)
    document = composition.document
    header, faults = check_model(document, PlanHeader)
    name = document.data.get("procedure")
    parameters: BaseModel | None = None
    limits: LimitsByAxis = {}
    if isinstance(name, str) and name in procedures:
        try:
            procedure = procedures[name]
        except InputError as error:
            raise FaultList([*faults, document.fault(("procedure",), str(error))]) from error
        faults += times_too_long(document)
        if isinstance(document.data.get("parameters", {}), dict):
            at = ("parameters",)
            parameters, more = check_model(document, procedure.parameters, at)
            faults += more
        limits, more = read_limits(document, procedure.results)
        faults += more
    elif isinstance(name, str) and name:
        fault = not_there(f"there is no procedure '{name}'", name, procedures)
        faults.append(document.fault(("procedure",), *fault))
    # What could not be filled in is no fault of its own kind as well.
    known = {(fault.file, fault.line, fault.column) for fault in composition.faults}
    faults = [fault for fault in faults if (fault.file, fault.line, fault.column) not in known]
    faults += composition.faults
    if header is None or parameters is None or faults:
        raise FaultList(faults)
    return Plan(header, parameters, limits, document, composition.bases, tuple(overrides))
