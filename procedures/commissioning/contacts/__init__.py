"""The part of the contacts: the chamber's door is read as it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station.procedure import Later

from .parameters import RESULTS
from .steps import CHAIN, CHAMBER, DOOR, STEPS, instruments, prompts, work

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a door is wired to the chamber, and no interlock ends a run that opens it."""
    chamber = bench.instruments.get(CHAMBER)
    if chamber is None or not chamber.settings.get(DOOR):
        return False
    watched = {pair for one in bench.interlocks for pair in one.when.watched}
    return not watched & {(CHAMBER, DOOR), (CHAMBER, CHAIN)}


CONTACT_PART = Part(
    name="contacts",
    steps=STEPS,
    results=RESULTS,
    instruments=instruments,
    work=work,
    prompts=prompts,
    findings=Later(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
)
