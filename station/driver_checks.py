"""What a bench file says, held against what its drivers declare: settings and quantities.

A driver declares its settings in `Settings`, and what can be watched of it in `quantities` and
`wired_by`; a role declares the settings that procedures read, whatever the model.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any

from pydantic import BaseModel, create_model

from station import registry
from station.errors import QuantityNotRead, reason_of
from station.fields import StrictModel, key_of
from station.files.faults import Fault, listed, not_there
from station.files.validation import MISSING, check_model
from station.files.yaml.document import Document, Where
from station.roles.base import EXCHANGE_DEADLINE_S, MAX_DEADLINE_S, TRIES, Shares
from station.roles.role import quantities_of, role, role_of, roles_of
from station.safety.bounds import listing, mapping, quantity
from station.safety.interlocks.conditions import STACKS
from station.safety.interlocks.reading import CHAIN, interlocks_in
from station.safety.safe_state import DEFAULT_WITHIN_S

CAN_SCHEMES = ("can://", "socketcand://")


def settings_of(driver: object) -> type[BaseModel]:
    """Return the model of a driver's own settings; one that declares none accepts none."""
    declared = getattr(driver, "Settings", None)
    if isinstance(declared, type) and issubclass(declared, BaseModel):
        return declared
    return StrictModel


def modbus_unit(entry: Mapping[str, Any]) -> int | None:
    """Return which device of a Modbus line an entry means; None where its driver speaks no Modbus.

    Devices of different numbers are on one line.
    """
    with suppress(Exception):  # a driver that cannot be loaded is told by `driver_faults`
        own = settings_of(registry.load(registry.DRIVERS, entry["driver"])).model_fields
        unit = mapping(entry.get("settings")).get("unit", own["unit"].default)
        return unit if isinstance(unit, int) else None
    return None


def settings_of_role(instance: str) -> type[BaseModel] | None:
    """Return the settings that procedures read of an instance, None where its role has none."""
    declared = role(role_of(instance))
    return None if declared is None else declared.settings


def known_settings(name: str, entry: Any) -> set[str]:
    """Return the settings that an instrument's driver and its role take."""
    keys = set(keys_of(settings_of_role(name) or StrictModel))
    with suppress(Exception):  # why a driver cannot be loaded is said by `driver_faults`
        keys |= set(keys_of(settings_of(registry.load(registry.DRIVERS, entry["driver"]))))
    return keys


def keys_of(model: type[BaseModel]) -> list[str]:
    """Return the keys of a model, those that it adds to another one first."""
    before = [len(base.model_fields) for base in model.__mro__[1:] if issubclass(base, BaseModel)]
    keys = [key_of(model, name) for name in model.model_fields]
    return [*keys[before[0] :], *keys[: before[0]]]


def driver_faults(document: Document) -> Iterator[Fault]:
    """Yield each fault of a setting, by role and by driver, and each quantity that is not read.

    Drivers are loaded for it; a name that no driver has is left to other checks.
    """
    instruments = mapping(mapping(document.data).get("instruments"))
    drivers: dict[str, Any] = {}
    for name, entry in instruments.items():
        driver = mapping(entry).get("driver")
        if driver not in registry.names(registry.DRIVERS):
            yield from _common_faults(document, name, StrictModel)
            continue
        try:
            loaded = registry.load(registry.DRIVERS, driver)
        except Exception as error:  # whatever keeps it from being checked keeps it from being used
            yield from _common_faults(document, name, StrictModel)
            yield document.fault(("instruments", name, "driver"), str(error))
            continue
        try:
            own = [*_common_faults(document, name, settings_of(loaded))]
            own += _own_faults(document, name, loaded)
        except Exception as error:  # whatever the package of a driver makes of its settings
            why = reason_of(error)
            what = f"the settings of the driver '{driver}' cannot be checked ({why}); repair it"
            yield document.fault(("instruments", name, "driver"), what)
            continue
        drivers[name] = loaded
        yield from own
    for place, name, watched in _watched(document, instruments):
        if name in drivers and watched in quantities_of(name):
            try:
                given = mapping(mapping(instruments[name]).get("settings"))
                QuantityNotRead.refuse(name, drivers[name], watched, given)
            except QuantityNotRead as error:
                yield document.fault(place, str(error))
    for name, loaded in drivers.items():
        yield from _deadline_faults(document, name, loaded)


def _deadline_faults(document: Document, name: str, driver: object) -> Iterator[Fault]:
    """Yield what the deadline of an instrument's exchanges is too short or too long for.

    Whoever watches a level, or brings to rest, tries three times.
    """
    entry = mapping(document.data["instruments"][name])
    own_s = getattr(driver, "deadline_s", EXCHANGE_DEADLINE_S)
    kinds_s = getattr(driver, "deadlines", {}).values()
    given_s = quantity(entry, "deadline", "s")
    where: Where = ("instruments", name, "driver" if given_s is None else "deadline")
    if (longest_s := max(own_s, *kinds_s, 0.0)) > MAX_DEADLINE_S:
        yield document.fault(
            ("instruments", name, "driver"),
            f"the driver '{entry['driver']}' gives an exchange {longest_s:g} s, at most are "
            f"{MAX_DEADLINE_S:g} s; let it start, poll and fetch what takes longer",
        )
    if given_s is not None and given_s < own_s:
        yield document.fault(
            where,
            f"{given_s:g} s is shorter than what the driver '{entry['driver']}' gives each "
            f"exchange, {own_s:g} s; write more, or leave it out",
        )
    deadline_s = max(given_s or 0.0, own_s)
    if deadline_s == EXCHANGE_DEADLINE_S:
        return
    tries_s, tries = TRIES * deadline_s, f"{TRIES} tries of {deadline_s:g} s at {name}"
    for interlock, grace_s in _graces(document, name):
        if tries_s > grace_s:
            yield document.fault(
                where,
                f"{tries} take {tries_s:g} s, longer than the grace of the interlock "
                f"'{interlock}', {grace_s:g} s: for so long nobody would watch; write grace: "
                f"{tries_s:g} s there, or a shorter deadline",
            )
    if tries_s > (within_s := _within_s(document, name)):
        yield document.fault(
            where,
            f"{tries} take {tries_s:g} s, longer than its time in safe_state, {within_s:g} s; "
            f"write within: {tries_s:g} s there, or a shorter deadline",
        )


def _graces(document: Document, name: str) -> Iterator[tuple[str, float]]:
    """Yield each interlock that looks at an instrument, and its grace in s."""
    named = set()
    for entry, condition in interlocks_in(document):
        watched = {instrument for instrument, _ in condition.watched}
        named |= watched
        if name in watched:
            yield str(entry.get("name")), quantity(entry, "grace", "s") or 0.0
    if name == CHAIN and CHAIN not in named:
        yield "interlock-chain", 0.0


def _within_s(document: Document, name: str) -> float:
    """Return the time in s that an instrument has to come to rest."""
    for entry in listing(document.data.get("safe_state")):
        step = mapping(entry)
        if (step.get("instrument") or step.get("role")) in (name, role_of(name)):
            return quantity(step, "within", "s") or DEFAULT_WITHIN_S
    return DEFAULT_WITHIN_S


def role_faults(document: Document) -> Iterator[Fault]:
    """Yield a fault for each driver that cannot fill the role of its place."""
    for name, entry in mapping(mapping(document.data).get("instruments")).items():
        driver, wanted = mapping(entry).get("driver"), role(role_of(name))
        if wanted is None or driver not in registry.names(registry.DRIVERS):
            continue
        with suppress(Exception):  # why it cannot be loaded or looked at is said by `driver_faults`
            loaded = registry.load(registry.DRIVERS, driver)
            fills = roles_of(loaded)
            if wanted.name not in fills:
                why = listed(wanted.missing_verbs(loaded)) if not fills else ", ".join(fills)
                can = f"it can be {why}" if fills else why
                what = f"the driver '{driver}' cannot be a {wanted.name}; {can}"
                yield document.fault(("instruments", name, "driver"), what)


def line_faults(document: Document) -> Iterator[Fault]:
    """Yield a fault for each instrument that nothing leads to, or that others do not lead to.

    On a simulated bench a simulator leads there, or an operator is asked; what has an address of
    its own is served by somebody else.
    """
    simulated = isinstance(mapping(document.data).get("simulation"), dict)
    instruments = mapping(mapping(document.data).get("instruments"))
    loaded: dict[str, Any] = {}
    for name, entry in instruments.items():
        with suppress(Exception):  # why it cannot be loaded is said by `driver_faults`
            loaded[name] = registry.load(registry.DRIVERS, mapping(entry)["driver"])
    filled = {name for name, driver in loaded.items() if role_of(name) in roles_of(driver)}
    for name, driver in loaded.items():
        entry, where = mapping(instruments[name]), ("instruments", name)
        served = entry["driver"] in registry.names(registry.SIMULATORS)
        shares: Shares | None = getattr(driver, "shares", None)
        if shares is not None:
            shared = [other for other in listing(entry.get("shares")) if other in filled]
            why = shares.why_not({other: loaded[other] for other in shared})
            if why and (shared or not entry.get("shares")):
                yield document.fault((*where, "shares"), f"{why}; {shares.do_now}")
            if shared and entry.get("address"):
                what = "has no effect beside `shares`; keep what the instrument is reached by"
                yield document.fault((*where, "address"), what)
        elif served and entry.get("shares"):
            what = "its driver has a line of its own; write its `address` in place of `shares`"
            yield document.fault((*where, "shares"), what)
        own = not entry.get("shares") and not (shares is not None and shares.needed)
        if entry.get("address") or not own or not simulated:
            continue  # on a real bench the run says which addresses its plan lacks
        if served and entry.get("simulator") is None:
            what = "is missing; a simulated bench needs it, an empty mapping too"
            yield document.fault((*where, "simulator"), what)
        elif not served and not hasattr(driver, "prompts"):
            what = (
                f"the driver '{entry['driver']}' has no simulator, and this bench is simulated; "
                "offer one under its name in the group station.simulators, or take the instrument "
                "out"
            )
            yield document.fault((*where, "driver"), what)


def _common_faults(document: Document, name: str, own: type[BaseModel]) -> Iterator[Fault]:
    """Yield each fault of the settings of a role, beside the `own` ones of the driver."""
    common = settings_of_role(name)
    if common is not None and isinstance(document.data["instruments"][name], dict):
        model, needed_by = side_by_side(common, own), f"a {role_of(name)}"
        yield from _settings_faults(document, name, model, keys_of(common), needed_by)


@cache
def side_by_side(common: type[BaseModel], own: type[BaseModel]) -> type[BaseModel]:
    """Return a model of both, the driver's own first, so that the role's see them.

    How many axes a table has is the driver's to say, and which of them is which the role's.
    """
    if issubclass(own, common) or issubclass(common, own):
        return own if issubclass(own, common) else common
    return create_model("Settings", __base__=(common, own))


def _own_faults(document: Document, name: str, driver: object) -> Iterator[Fault]:
    model = settings_of(driver)
    common = keys_of(settings_of_role(name) or StrictModel)
    own = [key for key in keys_of(model) if key not in common]
    known = [*own, *common]
    for key in mapping(mapping(document.data["instruments"][name]).get("settings")):
        if key not in known and (declared := role(role_of(name))):  # else its name is the fault
            what = f"there is no setting '{key}'"
            if key in declared.limits:
                where = ("instruments", name, "settings", key)
                yield document.fault(where, what, f"'limits.{key}'", at_key=True)
                continue
            fault = not_there(what, str(key), known, "this driver knows")
            yield document.fault(("instruments", name, "settings", key), *fault, at_key=True)
    yield from _settings_faults(document, name, model, own, "this driver")
    yield from _address_faults(document, name, getattr(driver, "on_can", None))
    for wrong in wrong_units(driver, name):
        yield document.fault(("instruments", name, "driver"), wrong)


def _address_faults(document: Document, name: str, on_can: bool | None) -> Iterator[Fault]:
    """Yield a fault for an address on CAN of a driver that is not, or the other way round."""
    address = mapping(document.data["instruments"][name]).get("address")
    if on_can is None or not isinstance(address, str):
        return
    if address.strip().lower().startswith(CAN_SCHEMES) != on_can:
        wanted = "over CAN: `can://…` or `socketcand://…`" if on_can else "by VISA, not over CAN"
        what = f"'{address}' is no address of this driver: its instrument is reached {wanted}"
        yield document.fault(("instruments", name, "address"), what)


def wrong_units(driver: object, instance: str) -> Iterator[str]:
    """Yield a sentence for each quantity that a driver publishes otherwise than its role has it.

    An interlock compares the number with a limit in the unit of the role.
    """
    watched = quantities_of(instance)
    for _, read in inspect.getmembers(driver if isinstance(driver, type) else type(driver)):
        quantity, unit, states = getattr(read, "publishes", None) or ("", "", None)
        if quantity not in watched:
            continue
        kind = watched[quantity]
        has = " or ".join(sorted(states)) if states else unit or "no unit"
        wanted = " or ".join(sorted(kind.states)) or kind.unit
        if kind.states and not states and not unit:
            continue  # the method returns the word itself
        if has != wanted:
            yield (
                f"the driver publishes '{quantity}' in {has}, a {role_of(instance)} has it in "
                f"{wanted}; convert it in the driver's {read.__name__}"
            )


def _settings_faults(
    document: Document, name: str, model: type[BaseModel], keys: Collection[str], needed_by: str
) -> Iterator[Fault]:
    """Yield each fault of these keys by a model of settings; others are left to other models."""
    given = mapping(document.data["instruments"][name]).get("settings", {})
    if not isinstance(given, dict):
        return
    where: Where = ("instruments", name, "settings")
    start = len(f"instruments.{name}.settings.")
    for fault in check_model(document, model, where)[1]:
        if re.split(r"[.\[]", fault.where[start:])[0] in keys:
            missing = fault.what == MISSING
            yield replace(fault, what=f"{MISSING}; {needed_by} needs it") if missing else fault


def _watched(
    document: Document, instruments: Mapping[Any, Any]
) -> Iterator[tuple[Where, str, str]]:
    """Yield each place of a bench file that has a quantity watched, its instrument, its name."""
    for _, condition in interlocks_in(document):
        for leaf in condition.leaves(*STACKS):
            yield (*leaf.place, "quantity"), leaf.instrument, leaf.quantity
    if CHAIN in instruments:  # watched whether an interlock names it or not
        yield ("instruments", CHAIN, "driver"), CHAIN, "chain"
