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
from .parameters import UNIT, ContactParameters

if TYPE_CHECKING:
    from station.runner.run import Run

CHAMBER = "thermal_chamber"
DOOR, CHAIN = "door", "chain"
PROMPTS = {
    "closed": Prompt("close-door", "Close the door of the chamber."),
    "open": Prompt("open-door", "Open the door of the chamber."),
    "closed again": Prompt("close-door-again", "Close the door of the chamber again."),
}


def prompts(parameters: ContactParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return tuple(PROMPTS[done] for done in DONE)


def instruments(parameters: ContactParameters) -> tuple[str, ...]:
    """Return the instruments whose contacts are looked at."""
    return (CHAMBER,)


def work(parameters: ContactParameters) -> Iterator[Work]:
    """Yield the looks at the door: nothing is commanded."""
    yield Work("I1", UNIT, duration_s=parameters.settle_s * len(DONE))


def door(run: Run) -> None:
    """I1: everything is at rest; a person moves the door, the contact is read."""
    if run.is_finished(UNIT):
        return
    parameters: ContactParameters = run.parameters.contacts
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


STEPS = (Step("I1", "Chamber: its door's contact follows the door", door),)
