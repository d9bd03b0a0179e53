"""A bench: the instruments with their addresses, limits, calibrations, and the safe state."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, ValidationInfo, create_model, field_validator

from station.driver_checks import (
    CAN_SCHEMES,
    driver_faults,
    known_settings,
    line_faults,
    modbus_unit,
    role_faults,
)
from station.fields import Second, StrictModel, Unit, key_of, to_yaml_data
from station.files.faults import Fault, FaultList, listed, nearest, not_there
from station.files.statements import statements_of_bench
from station.files.validation import UNKNOWN, check_model, without_meant
from station.files.yaml.document import Document, FromDocument, Where
from station.files.yaml.reading import read_yaml
from station.findings import InputQuantity
from station.instruments.addresses import forms_of, why_unknown
from station.instruments.calibration import Calibration, Number
from station.instruments.coil_geometry import CoilGeometry
from station.instruments.commissioned import Commissioned
from station.instruments.laboratory import Laboratory
from station.roles.base import MAX_DEADLINE_S
from station.roles.role import instances, limits, role, role_of
from station.safety.bounds import bound_faults, mapping
from station.safety.interlocks.reading import (
    Interlock,
    InterlockEntry,
    interlock_faults,
    interlocks_of,
)

Words = Annotated[str, Field(min_length=1)]
ModelT = TypeVar("ModelT", bound=StrictModel)


class InstrumentLimits(StrictModel):
    """What an instrument may never exceed on this bench; each is left out where it means nothing.

    `zero_current` is the largest measured current that counts as zero, `rms_current` the largest
    effective current, `heating` the power that a coil may turn into heat for as long as a plan
    likes.
    """

    @field_validator("*")
    @classmethod
    def high_above_low(cls, high: float | None, info: ValidationInfo) -> float | None:
        """Refuse a range that ends before it begins."""
        low = info.data.get((info.field_name or "").replace("_high_", "_low_"))
        if low is not None and high is not None and high <= low:
            raise ValueError(f"must be above the low limit, {low:g}")
        return high


class Instrument(StrictModel):
    """One instrument of a bench; its driver reads `settings`, its simulator `simulator`.

    `shares` names instruments over whose lines this one is reached: it has none of its own.
    `deadline` is what each exchange may take, where that is longer than the driver states.
    """

    driver: Words
    address: Words | None = None
    shares: tuple[Words, ...] = ()
    serial: Words | None = None
    deadline_s: Annotated[Second, Field(gt=0, le=MAX_DEADLINE_S)] | None = None
    settings: dict[str, Any] = Field(default_factory=dict)
    given_limits: InstrumentLimits = Field(default=InstrumentLimits(), alias="limits")
    calibration: Calibration | None = None
    simulator: dict[str, Any] | None = None

    @cached_property
    def limits(self) -> Mapping[str, float]:
        """The limits that are given, by key: A, V, A/s, W, mT, deg/s, deg/s^2, deg, degC."""
        named = {
            key_of(type(self.given_limits), name): getattr(self.given_limits, name)
            for name in type(self.given_limits).model_fields
        }
        return {name: value for name, value in named.items() if value is not None}


class SafeStep(StrictModel):
    """One step of the safe state: an instrument, or all of a role, brought to rest in time."""

    instrument: Words | None = None
    role: Words | None = None
    within_s: Annotated[Second, Field(gt=0)]


class Notify(StrictModel):
    """Who is informed at a prompt and at the end: a program with its arguments, no shell."""

    command: Annotated[tuple[Words, ...], Field(min_length=1)]


class BenchFile(StrictModel):
    """The keys of a bench file."""

    bench: Literal[1]
    name: Words
    title: str | None = None
    laboratory: Laboratory | None = None
    simulation: dict[str, Any] | None = None
    instruments: Annotated[dict[str, Instrument], Field(min_length=1)]
    safe_state: tuple[SafeStep, ...]
    interlocks: tuple[InterlockEntry, ...] = ()
    coil_geometry: CoilGeometry | None = None
    commissioned: Commissioned | None = None
    notify: Notify | None = None


@lru_cache
def bench_file() -> type[BenchFile]:
    """Return the model of a bench file with the limits that the installed roles declare."""
    fields: dict[str, Any] = {
        name + Unit(limit.unit).suffix: (
            Annotated[float, Unit(limit.unit), Field(gt=None if limit.signed else 0)] | None,
            None,
        )
        for name, limit in limits().items()
    }
    all_limits = _extended(InstrumentLimits, **fields)
    given = (all_limits, Field(default=all_limits(), alias="limits"))
    instruments: Any = dict[str, _extended(Instrument, given_limits=given)]  # type: ignore[misc]
    return _extended(BenchFile, instruments=(Annotated[instruments, Field(min_length=1)], ...))


def _extended(model: type[ModelT], **fields: Any) -> type[ModelT]:
    """Return a model with further fields, or with others in their place, and the same words."""
    return create_model(model.__name__, __base__=model, __doc__=model.__doc__, **fields)


@dataclass(frozen=True)
class Bench(FromDocument):
    """A bench whose file has no fault."""

    file: BenchFile
    document: Document

    @property
    def name(self) -> str:
        """The name of the bench."""
        return self.file.name

    @property
    def title(self) -> str | None:
        """What the bench calls itself."""
        return self.file.title

    @property
    def simulation(self) -> Mapping[str, Any] | None:
        """The simulated world, handed to the simulator as it is; None on a real bench."""
        return self.file.simulation

    @property
    def is_simulated(self) -> bool:
        """Whether it has a simulated world, or keeps the truth of a simulator of an instrument."""
        kept = (entry.simulator for entry in self.instruments.values())
        return self.simulation is not None or any(truth is not None for truth in kept)

    @property
    def instruments(self) -> Mapping[str, Instrument]:
        """The instruments by instance, in the file's order."""
        return self.file.instruments

    @property
    def coil_geometry(self) -> CoilGeometry | None:
        """Where coils, probe and device are; None where the laboratory does not say."""
        return self.file.coil_geometry

    @property
    def commissioned(self) -> Commissioned | None:
        """What its commissioning measured; None where it was not commissioned."""
        return self.file.commissioned

    @cached_property
    def interlocks(self) -> tuple[Interlock, ...]:
        """The interlocks, in the file's order, and that of the chain."""
        return interlocks_of(self.file.interlocks, self.instruments)

    @property
    def data(self) -> Mapping[str, Any]:
        """The file's data as given, quantities as text."""
        return self.document.data

    def record(self, name: str) -> Calibration | None:
        """Return the calibration record of an instrument, None where there is none."""
        entry = self.instruments.get(name)
        return None if entry is None else entry.calibration

    def statements(self, name: str) -> list[tuple[str, str]]:
        """Return what an instrument's record states: `uncertainty` or `correction`, quantity."""
        record = self.record(name)
        if record is None:
            return []
        quantities = [("uncertainty", entry.quantity) for entry in record.uncertainty]
        quantities += [("correction", entry.quantity) for entry in record.corrections]
        return list(dict.fromkeys(quantities))

    def corrected(self, name: str, quantity: str, value: Number, unit: str) -> Number:
        """Return readings of an instrument as its record corrects them: numbers or an array."""
        record = self.record(name)
        return value if record is None else record.corrected(quantity, value, unit)

    def stated(self, name: str, quantity: str, at: float, unit: str) -> tuple[float, str] | None:
        """Return the standard uncertainty of a value, in its unit, and what states it.

        None where the instrument's record states none.
        """
        record = self.record(name)
        if record is None or not record.covers(quantity, at, unit):
            return None
        return record.standard_uncertainty(quantity, at, unit), record.source

    def stated_input(
        self,
        stated: tuple[str, str, float, str],
        name: str,
        about: str,
        *,
        relative: bool = False,
        factor: float = 1.0,
        unit: str | None = None,
    ) -> Iterator[InputQuantity]:
        """Yield the type B input that a calibration record gives an analysis.

        `stated` is instrument, quantity, value and unit, as for `stated()`. The input is the
        stated uncertainty, over the value where it is `relative`, times `factor`, in `unit`; a
        record that states none makes it one that is not stated.
        """
        _, _, value, own_unit = stated
        given = "1" if relative else unit or own_unit
        u, source = self.stated(*stated) or (None, "")
        if u is not None:
            u = u / value if relative else factor * u
        yield InputQuantity.if_stated(name, about, u, given, source)

    @property
    def attached(self) -> dict[str, tuple[str, str]] | None:
        """The instruments of a real bench, address to model and serial; None of a simulated one."""
        if self.simulation is not None:
            return None
        return {
            entry.address: ("", entry.serial or "")
            for entry in self.instruments.values()
            if entry.address
        }

    def safe_order(self) -> list[tuple[str, float]]:
        """Return the steps of the safe state: an instance or a role, and the seconds it has."""
        return [
            (step.instrument or step.role or "", step.within_s) for step in self.file.safe_state
        ]

    def to_yaml_data(self) -> dict[str, Any]:
        """Return the bench with every default written out, as data for YAML."""
        return to_yaml_data(self.file)


def read_bench(path: Path, drivers: Collection[str]) -> Bench:
    """Read a bench file that is to be used; `drivers` are the known names.

    Raise FaultList with every fault, also those of its use (`faults_of_use`).
    """
    return bench_of(read_yaml(path), drivers, bounded=True)


def bench_of(
    document: Document, drivers: Collection[str] | None = None, *, bounded: bool = False
) -> Bench:
    """Return the bench that a document holds; raise FaultList with every fault.

    Where it is not `bounded`, as of a run that is only read again, it need not be of use. Without
    `drivers`, the known names, those in the document may be of packages that are not installed.
    """
    file, faults = check_model(document, bench_file())
    instruments = document.data.get("instruments")
    if isinstance(instruments, dict):
        for name, entry in instruments.items():
            faults += _instrument_faults(document, name, entry, drivers)
        named = [*instruments, *_meant(instruments).values()]
        faults = [_deeper(document, fault) for fault in without_meant(faults)]
        faults += _safe_state_faults(document, named)
        faults += interlock_faults(document, named)
        if bounded:
            faults += faults_of_use(document)
    if file is None or faults:
        raise FaultList(faults)
    return Bench(file, document)


def faults_of_use(document: Document) -> Iterator[Fault]:
    """Yield what keeps a bench file from being used: beyond a bound, or not known to a driver."""
    yield from _limit_faults(document)
    yield from bound_faults(document)
    yield from driver_faults(document)
    yield from role_faults(document)
    yield from line_faults(document)
    yield from _address_faults(document)
    yield from statements_of_bench(document)


def _meant(instruments: Iterable[str]) -> dict[str, str]:
    """Return by each name that no instrument may have the one that was probably meant.

    What the rest of the file says of that one is no fault of its own.
    """
    known = instances()
    near = {name: _nearest_instance(name) for name in instruments if name not in known}
    return {name: meant for name, meant in near.items() if meant}


def _nearest_instance(name: str) -> str | None:
    """Return the instance that was probably meant; the first of a role that has several."""
    declared = role(name)
    return declared.instances[0] if declared else nearest(name, instances())


def _deeper(document: Document, fault: Fault) -> Fault:
    """Return the fault of an instrument's key that belongs into its settings or limits with that.

    The model of a bench file does not know what drivers take.
    """
    instruments = mapping(document.data.get("instruments"))
    for name, entry in instruments.items():
        key = fault.where.removeprefix(f"instruments.{name}.")
        if key not in mapping(entry) or not fault.what.startswith(UNKNOWN):
            continue
        if key in limits():
            return replace(fault, what=UNKNOWN, hint=f"'limits.{key}'")
        if key in known_settings(name, entry):
            return replace(fault, what=UNKNOWN, hint=f"'settings.{key}'")
    return fault


def _instrument_faults(
    document: Document, name: str, entry: Any, drivers: Collection[str] | None
) -> Iterator[Fault]:
    where: Where = ("instruments", name)
    known = instances()
    if name not in known:
        hint = _nearest_instance(name)
        what = "is no instrument that a procedure asks for"
        what += "" if hint else f"; known are {listed(known)}"
        yield document.fault(where, what, hint and f"'{hint}'", at_key=True)
    if not isinstance(entry, dict):
        return
    driver = entry.get("driver")
    if drivers is not None and isinstance(driver, str) and driver and driver not in drivers:
        fault = not_there(f"there is no driver '{driver}'", driver, drivers)
        yield document.fault((*where, "driver"), *fault)
    yield from _shares_faults(document, name, entry.get("shares"))
    given, declared = entry.get("limits", {}), role(role_of(name))
    wrong = {nearest(str(key), limits()) for key in mapping(given) if key not in limits()}
    for limit in declared.needed_limits if declared else ():
        if isinstance(given, dict) and given.get(limit) is None and limit not in wrong:
            yield document.fault(
                (*where, "limits", limit), f"is missing; a {role_of(name)} needs it"
            )


def _limit_faults(document: Document) -> Iterator[Fault]:
    """Yield a fault for each limit that instruments of another role have: nothing would hold it.

    A bench that is written out has every limit, those that are not given as null.
    """
    for name, entry in document.data["instruments"].items():
        given, declared = mapping(mapping(entry).get("limits")), role(role_of(name))
        known = declared.limits if declared else limits()
        for key, value in given.items():
            if value is not None and key in limits() and key not in known:
                fault = not_there(f"is no limit of a {role_of(name)}", key, known, "it has")
                yield document.fault(("instruments", name, "limits", key), *fault, at_key=True)


def _address_faults(document: Document) -> Iterator[Fault]:
    """Yield a fault for each address of no known kind, or that an instrument before has.

    Two names for one supply drive it twice. No host name is looked up for it.
    """
    known: dict[str, list[tuple[str, str, int | None]]] = {}
    for name, entry in document.data["instruments"].items():
        address = entry.get("address") if isinstance(entry, dict) else None
        if not isinstance(address, str) or not address:
            continue
        where: Where = ("instruments", name, "address")
        if wrong := why_unknown(address):
            yield document.fault(where, wrong)
            continue
        if address.strip().lower().startswith(CAN_SCHEMES):
            continue  # several instruments are on one bus
        unit, forms = modbus_unit(entry), sorted(forms_of(address, resolve=False))
        for other, spelled, other_unit in [at for form in forms for at in known.get(form, [])]:
            if unit is None or other_unit is None or unit == other_unit:
                yield document.fault(
                    where,
                    f"is the address of {other}, too, written there '{spelled}'; give each "
                    "instrument its own, or name what it is reached over in `shares`",
                )
                break
        for form in forms:
            known.setdefault(form, []).append((name, address, unit))


def _shares_faults(document: Document, name: str, shares: Any) -> Iterator[Fault]:
    """Yield each name in `shares` that is no other instrument with a line of its own."""
    instruments = document.data["instruments"]
    meant = _meant(instruments).values()
    for number, shared in enumerate(shares if isinstance(shares, list) else ()):
        where: Where = ("instruments", name, "shares", number)
        others = [other for other in instruments if other != name]
        if shared in meant:
            continue
        if shared not in others:
            hint = nearest(str(shared), others)
            what = f"this bench has no other instrument '{shared}'"
            yield document.fault(where, what, hint and f"'{hint}'")
        elif isinstance(instruments[shared], dict) and instruments[shared].get("shares"):
            yield document.fault(where, f"'{shared}' has no line of its own; name what it shares")


def _safe_state_faults(document: Document, instances: list[str]) -> Iterator[Fault]:
    steps = document.data.get("safe_state")
    roles = list(dict.fromkeys(role_of(name) for name in instances))
    named: set[str] = set()
    for number, step in enumerate(steps if isinstance(steps, list) else ()):
        if not isinstance(step, dict):
            continue
        where: Where = ("safe_state", number)
        given = [key for key in ("instrument", "role") if isinstance(step.get(key), str)]
        if len(given) != 1:
            yield document.fault(where, "must name one instrument, or one role")
            continue
        name, known = step[given[0]], instances if given == ["instrument"] else roles
        if name not in known:
            hint = nearest(name, known)
            what = f"this bench has no {given[0]} '{name}'"
            what += "" if hint else f"; it has {listed(known)}"
            yield document.fault((*where, given[0]), what, hint and f"'{hint}'")
        elif name in named:
            yield document.fault((*where, given[0]), f"'{name}' was named before; keep one step")
        named.add(name)
