"""The part of the contacts: the chamber's door and the interlock chain are read as they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station.procedure import LazyImport

from .parameters import CHAIN, CHAIN_ERRORS, CHAMBER, DOOR_ERRORS, RESULTS, ContactParameters
from .steps import DOOR, STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def door_is_wired(bench: Bench) -> bool:
    """Return whether a door's contact is wired to the chamber."""
    chamber = bench.instruments.get(CHAMBER)
    return chamber is not None and bool(chamber.settings.get(DOOR))


def door_is_free(bench: Bench) -> bool:
    """Return whether the chamber's door has a contact that no interlock watches."""
    watched = {pair for interlock in bench.interlocks for pair in interlock.when.watched}
    free = not watched & {(CHAMBER, DOOR), (CHAMBER, "chain")}
    return door_is_wired(bench) and free and CHAMBER not in shares(bench)


def shares(bench: Bench) -> tuple[str, ...]:
    """Return the instruments whose contacts make the bench's chain."""
    return tuple(bench.instruments[CHAIN].shares) if CHAIN in bench.instruments else ()


def chain_contacts(bench: Bench) -> tuple[str, ...]:
    """Return the contacts of the chain that a person can open.

    Those that the bench file names, and the chamber's door where the chain is shared with it. Not a
    table's interlock: its controller keeps a break, and its axes lose their zero.
    """
    if CHAIN not in bench.instruments:
        return ()
    named = tuple(bench.instruments[CHAIN].settings.get("contacts", ()))
    shared = door_is_wired(bench) and CHAMBER in shares(bench)
    return (*named, *((f"{CHAMBER} {DOOR}",) if shared else ()))


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has a contact that a person can open."""
    return door_is_free(bench) or bool(chain_contacts(bench))


def fits(bench: Bench) -> Iterator[str]:
    """Yield which contacts a bench has."""
    yield f"parameters.contacts.door={str(door_is_free(bench)).lower()}"
    contacts = chain_contacts(bench)
    yield f"parameters.contacts.chain=[{', '.join(contacts)}]"
    if not door_is_free(bench):
        yield f"limits.{DOOR_ERRORS}=null"
    if not contacts:
        yield f"limits.{CHAIN_ERRORS}=null"


def measured_axes(parameters: ContactParameters) -> Mapping[str, tuple[str, ...]]:
    """Return no axes for what a plan leaves out."""
    left_out = [*([] if parameters.door else [DOOR_ERRORS])]
    left_out += [] if parameters.chain else [CHAIN_ERRORS]
    return dict.fromkeys(left_out, ())


CONTACT_PART = Part(
    name="contacts",
    steps=STEPS,
    results=RESULTS,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
    fits=fits,
    measured_axes=measured_axes,
)
