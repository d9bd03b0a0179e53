"""The prompts for what a person reads of the room."""

from __future__ import annotations

from collections.abc import Iterator

from station.files.plan import Plan
from station.method.prompts import AskedValue, Prompt


def prompts_of_room(plan: Plan) -> Iterator[Prompt]:
    """Yield a prompt for each condition of the room that the plan names without a value."""
    room = plan.header.room
    for condition in room.conditions() if room is not None else ():
        if condition.value is None:
            yield Prompt(
                condition.prompt_id,
                f"Read the {condition.name} of the room on {condition.read.instrument}.",
                physical=False,
                value=AskedValue(condition.name, condition.unit, condition.low, condition.high),
            )
