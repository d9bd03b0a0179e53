"""A draft of a bench file from a scan: what is known is written, what is not is left to fill in."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from station import registry
from station.driver_checks import settings_of
from station.fields import key_of
from station.files.yaml.document import plain_scalar
from station.instruments.scan import Seen
from station.roles.base import MadeSafe
from station.roles.role import instances, role_of, roles, roles_of, safe_states
from station.safety.bounds import COIL

FILL_IN = "FILL IN"
DRAFT_LEVEL = "1 A"
HEAD = f"""\
# A draft from `station scan`. It says who answered where, and nothing more: which coil hangs on
# which supply, what may never be exceeded and what was calibrated is for you to write, at every
# {FILL_IN}. Then `station validate PLAN --bench THIS-FILE` names what is still missing.
bench: 1
name: draft
"""
CALIBRATION = f"""\
    # {FILL_IN}, from the certificate; without it results carry no uncertainty of this instrument:
    # calibration:
    #   certificate: NUMBER
    #   date: YYYY-MM-DD
    #   due: YYYY-MM-DD
    #   uncertainty:
    #     - {{quantity: …, up_to: …, relative: …, absolute: …, coverage_factor: 2}}
"""


def draft(seen: Iterable[Seen]) -> str:
    """Return the text of a bench file; whatever no driver recognises stands in comments."""
    free = list(instances())
    entries, rest, safe = [], [], []
    for one in seen:
        if one.driver is None:
            rest.append(f"#   {one.address}: {one.said}\n")
            continue
        alike = drivers_alike(one.driver)
        places = ((name, place) for name in alike for place in free_places(name, free))
        name, instance = next(places, (one.driver, None))
        if instance is None:
            what = f"{one.said} ({one.driver}); every place for it is taken"
            rest.append(f"#   {one.address}: {what}\n")
            continue
        free.remove(instance)
        driver = registry.load(registry.DRIVERS, name)
        others = [other for other in alike if other != name]
        entries.append("".join(entry_lines(instance, replace(one, driver=name), driver, others)))
        if issubclass(driver, MadeSafe) and role_of(instance) not in safe:
            safe.append(role_of(instance))
    text = HEAD
    text += "\ninstruments:\n" + "\n".join(entries) if entries else "\ninstruments: {}\n"
    if rest:
        text += "\n# Also there, without a driver or a place:\n" + "".join(rest)
    coils = [one for one in instances() if role_of(one) == COIL and one not in free]
    if coils:
        text += f"\n# {FILL_IN}: what ends a run. Set each level just above its coil's limit of\n"
        text += f"# current; until then {DRAFT_LEVEL} ends it.\ninterlocks:\n"
        text += "".join(map(interlock_line, coils))
    if not safe:
        return text + "\nsafe_state: []\n"
    order = [name for name in safe_states() if name in safe]
    steps = "".join(f"  - {{role: {name}, within: 30 s}}\n" for name in order)
    return (
        text
        + f"\n# {FILL_IN}: the order in which the bench comes to rest, and how fast.\n"
        + (f"safe_state:\n{steps}")
    )


def interlock_line(coil: str) -> str:
    """Return the line of an interlock on a coil's current, at a level that is safe and too low."""
    name = coil.replace(f"{COIL}.", "coil-")
    when = f"{{instrument: {coil}, quantity: current, above: {DRAFT_LEVEL}}}"
    return f"  - {{name: {name}-current, when: {when}, grace: 0.4 s}}\n"


def drivers_alike(name: str) -> list[str]:
    """Return a driver, and after it those that recognise the same model for another use."""
    loaded = registry.loaded(registry.DRIVERS)
    patterns = {one: getattr(driver, "recognises", one) for one, driver in loaded}
    return [name, *(one for one in patterns if one != name and patterns[one] == patterns[name])]


def free_places(driver: str, free: Iterable[str]) -> list[str]:
    """Return the places on the bench that a driver can take."""
    fills = roles_of(registry.load(registry.DRIVERS, driver))
    return [place for place in free if role_of(place) in fills]


def entry_lines(
    instance: str, seen: Seen, driver: type, others: Sequence[str] = ()
) -> Iterator[str]:
    """Yield the lines of one instrument; `others` are drivers that it may be meant for, too."""
    role = roles()[role_of(instance)]
    yield f"  {instance}:\n"
    if role.members:
        places = ", ".join(role.instances)
        yield f"    # {FILL_IN}: one of {places}? They were given in the order found.\n"
    yield f"    # said: {seen.said}\n"
    if others:
        yield f"    # {FILL_IN}: or {', '.join(others)}? Which use is this unit's?\n"
    yield f"    driver: {seen.driver}\n"
    yield f"    address: {scalar(seen.address)}\n"
    if seen.serial:
        yield f"    serial: {scalar(seen.serial)}\n"
    else:
        yield f"    # {FILL_IN}: serial: NUMBER, so that no other unit is taken for this one\n"
    models = [one for one in (role.settings, settings_of(driver)) if one is not None]
    fields = {
        key_of(one, name): field for one in models for name, field in one.model_fields.items()
    }
    if fields:
        needed = ", ".join(f"{key}: …" for key, field in fields.items() if field.is_required())
        yield f"    # {FILL_IN}: settings: {{{needed or '…'}}}\n"
        yield from (f"    #   {key}: {field.description}\n" for key, field in fields.items())
    if role.needed_limits:
        units = {name: role.limits[name].unit for name in role.needed_limits}
        needed = ", ".join(f"{name}: … {unit}" for name, unit in units.items())
        yield f"    # {FILL_IN}: limits: {{{needed}}}\n"
    yield CALIBRATION


def scalar(text: str) -> str:
    """Return a text as a YAML scalar that our reading gives back as the same text."""
    return text if plain_scalar(text) == text and ": " not in text else json.dumps(text)
