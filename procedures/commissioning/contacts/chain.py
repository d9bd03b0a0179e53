"""Step I2 of a commissioning: each contact of the interlock chain, opened by hand.

Its interlock goes on to watch: the station excuses that one contact, and only while everything that
can harm reads back as off.
"""

from __future__ import annotations

from procedures.commissioning.at_rest import bring_to_rest
from station.method.duration import on_the_way
from station.method.run import Run
from station.procedure import Prompt
from station.roles.interlock_chain import InterlockChain, SeesContacts

from .parameters import CHAIN, ContactParameters, chain_unit

CLOSES_S = 5.0
"""Until all that see a contact have seen it closed."""


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
