"""Step I1 of a commissioning: the chamber's door, opened and closed by hand."""

from __future__ import annotations

from functools import partial

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import InstrumentError
from station.method.run import Run
from station.procedure import Prompt, Step
from station.roles import Driver

from .analysis import DONE
from .chain import chain
from .parameters import CHAMBER, UNIT, ContactParameters

DOOR = "door"
PROMPTS = {
    "closed": Prompt("close-door", "Close the door of the chamber."),
    "open": Prompt("open-door", "Open the door of the chamber."),
    "closed again": Prompt("close-door-again", "Close the door of the chamber again."),
}


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


STEPS = (
    Step("I1", "Chamber: its door's contact follows the door", door),
    Step("I2", "Interlock chain: its contacts, opened by hand on a bench at rest", chain),
)


def state_of_door(chamber: Driver) -> object:
    """Return what a chamber reads of its door; InstrumentError where no door is wired to it."""
    state = chamber.read_quantity(DOOR)
    if state is None:
        raise InstrumentError(
            CHAMBER, "read its door", "no input is wired to it", "state settings.door"
        )
    return state
