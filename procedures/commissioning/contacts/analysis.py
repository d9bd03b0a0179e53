"""What contacts read of what a person did: pure functions of the readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from station.findings import Analysis, Estimate, Flag

from .parameters import CHAIN_ERRORS, DOOR_ERRORS

DONE = ("closed", "open", "closed again")
"""What a person did to the door, in order; each reading should be its first word."""


def analyse_door(read: Mapping[str, str]) -> Analysis:
    """Return how many readings are wrong, and the cause; `read` has one of each of `DONE`."""
    wrong = [done for done in DONE if read[done] != done.split(" ")[0]]
    method = "readings of the contact that are not what the person did"
    estimate = Estimate(DOOR_ERRORS, None, float(len(wrong)), "1", 0.0, None, method)
    return Analysis([estimate], (), _causes(read, wrong))


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


def analyse_chain(opened: Mapping[str, Sequence[str]]) -> Analysis:
    """Return how many contacts of the chain are not seen while they are open, and which.

    `opened`: each contact that was opened to the contacts that read open then. Another one, or one
    that does not close again, has ended the run.
    """
    unseen = [contact for contact, read in opened.items() if contact not in read]
    method = "contacts of the chain that read closed while they were open"
    estimate = Estimate(CHAIN_ERRORS, None, float(len(unseen)), "1", 0.0, None, method)
    return Analysis(
        [estimate],
        (),
        tuple(
            Flag(
                "chain-contact-bridged",
                f"The contact {contact} of the interlock chain reads closed while it is open: it "
                "is bridged, not wired into the chain, or has another name in the bench file. "
                "Energise nothing before that is mended.",
            )
            for contact in unseen
        ),
    )
