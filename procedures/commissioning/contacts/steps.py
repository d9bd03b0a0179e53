"""Step I1 of a commissioning: the chamber's door, opened and closed by hand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import InstrumentError
from station.method.work import Work
from station.procedure import Prompt, Step
from station.roles import Driver

from .analysis import DONE
from .chain import chain, chain_prompts
from .parameters import CHAIN, CHAMBER, UNIT, ContactParameters, chain_unit

if TYPE_CHECKING:
    from station.method.run import Run

DOOR = "door"
PROMPTS = {
    "closed": Prompt("close-door", "Close the door of the chamber."),
    "open": Prompt("open-door", "Open the door of the chamber."),
    "closed again": Prompt("close-door-again", "Close the door of the chamber again."),
}


def prompts(parameters: ContactParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    of_door = tuple(PROMPTS[done] for done in DONE) if parameters.door else ()
    return (*of_door, *(prompt for name in parameters.chain for prompt in chain_prompts(name)))


def instruments(parameters: ContactParameters) -> tuple[str, ...]:
    """Return the instruments whose contacts are looked at."""
    return (
        *((CHAMBER,) if parameters.door else ()),
        *((CHAIN,) if parameters.chain else ()),
    )


def work(parameters: ContactParameters) -> Iterator[Work]:
    """Yield the looks at door and chain: nothing is commanded."""
    if parameters.door:
        yield Work("I1", UNIT, duration_s=parameters.settle_s * len(DONE))
    for contact in parameters.chain:
        yield Work("I2", chain_unit(contact), duration_s=2.0 * parameters.settle_s)


def door(run: Run) -> None:
    """I1: everything is at rest; a person moves the door, the contact is read."""
    parameters: ContactParameters = run.parameters.contacts
    if not parameters.door or run.is_finished(UNIT):
        return
    chamber = run.role(CHAMBER, Driver)
    with run.unit(UNIT) as details:
        for done in DONE:
            prompt = PROMPTS[done]
            ask_at_rest(run, prompt)
            run.wait(parameters.settle_s, prompt.text)
            state = chamber.read_quantity(DOOR)
            if state is None:
                raise InstrumentError(
                    CHAMBER, "read its door", "no input is wired to it", "state settings.door"
                )
            details[done] = state


STEPS = (
    Step("I1", "Chamber: its door's contact follows the door", door),
    Step("I2", "Interlock chain: its contacts, opened by hand on a bench at rest", chain),
)
