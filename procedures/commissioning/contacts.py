"""I1, I2: the contacts of the chamber's door and of the interlock chain follow the hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from station.errors import InstrumentError
from station.fields import StrictModel, Unit
from station.findings import Analysis, Estimate, Flag, InputQuantity
from station.method.duration import on_the_way
from station.method.run import Run
from station.procedure import Prompt, Step
from station.roles import Driver, InterlockChain
from station.roles.interlock_chain import SeesContacts

from .part import Figure, Part, ask_at_rest, bring_to_rest

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

DOOR_ERRORS = Figure("door_contact_errors", limit=0.0)
CHAIN_ERRORS = Figure("chain_contact_errors", limit=0.0)
CHAMBER, CHAIN, DOOR = "thermal_chamber", "interlock_chain", "door"
UNIT = "door contact"
DONE = ("closed", "open", "closed again")
"""What a person did to the door, in order; each reading should be its first word."""
PROMPTS = {
    "closed": Prompt("close-door", "Close the door of the chamber."),
    "open": Prompt("open-door", "Open the door of the chamber."),
    "closed again": Prompt("close-door-again", "Close the door of the chamber again."),
}
CLOSES_S = 5.0
"""Until all that see a contact have seen it closed."""


class ContactParameters(StrictModel):
    """What the engineer chooses; `station commission` takes both lists from the bench file."""

    door: bool = True
    chain: tuple[str, ...] = ()
    settle_s: Annotated[float, Unit("s"), Field(ge=0, le=60)] = 1.0


def chain_unit(contact: str) -> str:
    """Return the unit of work of a contact of the chain."""
    return f"chain contact {contact}"


def door(run: Run) -> None:
    """I1: everything is at rest; a person moves the door, the contact is read."""
    parameters: ContactParameters = run.parameters.contacts
    for unit in run.unfinished([UNIT] if parameters.door else [], pauses=False):
        chamber = run.role(CHAMBER, Driver)
        with run.unit(unit) as details:
            for done in DONE:
                ask_at_rest(run, PROMPTS[done])
                run.wait(parameters.settle_s, PROMPTS[done].text)
                details[done] = run.read(partial(state_of_door, chamber))


def state_of_door(chamber: Driver) -> object:
    """Return what a chamber reads of its door; InstrumentError where no door is wired to it."""
    state = chamber.read_quantity(DOOR)
    if state is None:
        raise InstrumentError(
            CHAMBER, "read its door", "no input is wired to it", "state settings.door"
        )
    return state


def chain_prompts(contact: str) -> tuple[Prompt, Prompt]:
    """Return what a person does to a contact, opening it and closing it."""
    name = contact.replace(" ", "-")
    return (
        Prompt(f"open-contact-{name}", f"Open the contact {contact} of the interlock chain."),
        Prompt(f"close-contact-{name}", f"Close the contact {contact} of the interlock chain."),
    )


def seen_by(contact: str, instruments: tuple[str, ...]) -> dict[str, str]:
    """Return the instruments that see a contact, each to the name that it gives it.

    A chain that is shared by instruments names the instrument before its contact.
    """
    owner, _, own = contact.partition(" ")
    return {CHAIN: contact, **({owner: own} if owner in instruments else {})}


def chain(run: Run) -> None:
    """I2: a person opens and closes each contact; the chain is read."""
    parameters: ContactParameters = run.parameters.contacts
    for contact in run.unfinished(parameters.chain, chain_unit, pauses=False):
        reader, seer = run.role(CHAIN, InterlockChain), run.role(CHAIN, SeesContacts)
        opens, closes = chain_prompts(contact)
        with run.unit(chain_unit(contact)) as details:
            bring_to_rest(run)
            shared = run.read(lambda: tuple(run.bench.instruments[CHAIN].shares), assumed=())
            with run.testing_contact(contact, seen_by(contact, shared)):
                run.ask_again(opens)
                run.wait(parameters.settle_s, opens.text)
                details["opened"] = list(run.read(seer.open_contacts, assumed=()))
                run.ask_again(closes)
                run.wait(parameters.settle_s, closes.text)
            details["closed"] = run.read(reader.is_closed, takes=on_the_way(CLOSES_S))


@dataclass(frozen=True)
class ContactDataset:
    """What was read: of the door after each of `DONE`; of the chain with each contact opened.

    Both are None where the plan leaves them out.
    """

    door: Mapping[str, str] | None
    opened: Mapping[str, Sequence[str]] | None


def units(parameters: ContactParameters) -> Iterator[str]:
    """Yield the units of work of a plan."""
    yield from [UNIT] if parameters.door else []
    yield from map(chain_unit, parameters.chain)


def dataset(folder: RunFolder, parameters: ContactParameters, bench: Bench) -> ContactDataset:
    """Return what the contacts of a run read."""
    details = folder.finished_units()
    door = {done: str(details[UNIT][done]) for done in DONE} if parameters.door else None
    opened = {name: details[chain_unit(name)]["opened"] for name in parameters.chain}
    return ContactDataset(door, opened or None)


def analyse(data: ContactDataset, inputs: Sequence[InputQuantity] = ()) -> Analysis:
    """Return how many readings were wrong, and the causes."""
    parts = [] if data.door is None else [analyse_door(data.door)]
    parts += [] if data.opened is None else [analyse_chain(data.opened)]
    estimates = [estimate for estimate, _ in parts]
    return Analysis(estimates, (), tuple(flag for _, flags in parts for flag in flags))


def analyse_door(read: Mapping[str, str]) -> tuple[Estimate, list[Flag]]:
    """Return how many readings are wrong, and the cause; `read` has one of each of `DONE`."""
    wrong = [done for done in DONE if read[done] != done.split(" ")[0]]
    method = "readings of the contact that are not what the person did"
    return DOOR_ERRORS.measured(float(len(wrong)), 0.0, method), _causes(read, wrong)


def _causes(read: Mapping[str, str], wrong: list[str]) -> list[Flag]:
    states = [read[done] for done in DONE]
    if not wrong:
        return []
    if len(wrong) == len(DONE):
        message = (
            "The contact of the chamber's door is inverted: it reads open while the door is "
            "closed, and closed while it is open. Change the wiring, or the level of the input."
        )
        return [Flag("door-contact-inverted", message)]
    if len(set(states)) == 1:
        message = (
            f"The contact of the chamber's door reads {states[0]} whatever the door does: it is "
            "not connected, or another input is stated in the bench file."
        )
        return [Flag("door-contact-stuck", message)]
    readings = ", ".join(f"door {done}, read {read[done]}" for done in DONE)
    message = (
        f"The contact of the chamber's door did not follow it ({readings}): adjust it, and try "
        "again."
    )
    return [Flag("door-contact-loose", message)]


def analyse_chain(opened: Mapping[str, Sequence[str]]) -> tuple[Estimate, list[Flag]]:
    """Return how many contacts of the chain are not seen while they are open, and which.

    `opened`: each contact that was opened to the contacts that read open then. Another one, or one
    that does not close again, has ended the run.
    """
    unseen = [contact for contact, read in opened.items() if contact not in read]
    method = "contacts of the chain that read closed while they were open"
    flags = [
        Flag(
            "chain-contact-bridged",
            f"The contact {contact} of the interlock chain reads closed while it is open: it is "
            "bridged, not wired into the chain, or has another name in the bench file. Energise "
            "nothing before that is mended.",
        )
        for contact in unseen
    ]
    return CHAIN_ERRORS.measured(float(len(unseen)), 0.0, method), flags


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


def has_contacts(bench: Bench) -> bool:
    """Return whether a bench has a contact that a person can open."""
    return door_is_free(bench) or bool(chain_contacts(bench))


def fits(bench: Bench) -> Iterator[str]:
    """Yield which contacts a bench has."""
    yield f"parameters.contacts.door={str(door_is_free(bench)).lower()}"
    contacts = chain_contacts(bench)
    yield f"parameters.contacts.chain=[{', '.join(contacts)}]"
    if not door_is_free(bench):
        yield f"limits.{DOOR_ERRORS.name}=null"
    if not contacts:
        yield f"limits.{CHAIN_ERRORS.name}=null"


def measured_axes(parameters: ContactParameters) -> Mapping[str, tuple[str, ...]]:
    """Return no axes for what a plan leaves out."""
    left_out = [*([] if parameters.door else [DOOR_ERRORS.name])]
    left_out += [] if parameters.chain else [CHAIN_ERRORS.name]
    return dict.fromkeys(left_out, ())


PART = Part(
    name="contacts",
    steps=(
        Step("I1", "Chamber: its door's contact follows the door", door),
        Step("I2", "Interlock chain: its contacts, opened by hand on a bench at rest", chain),
    ),
    figures=(DOOR_ERRORS, CHAIN_ERRORS),
    needs=(),
    has=has_contacts,
    units=units,
    dataset=dataset,
    analyse=analyse,
    fits=fits,
    measured_axes=measured_axes,
)
