"""What moves is at rest, and reads back so, before a person is asked for a hand at it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.errors import InstrumentError
from station.procedure import Prompt
from station.roles import MadeSafe

if TYPE_CHECKING:
    from station.runner.run import Run

STANDS_WITHIN_S = 30.0


def ask_at_rest(run: Run, instrument: str, prompt: Prompt) -> None:
    """Make an instrument safe, then ask for a hand at it; InstrumentError where it is not safe."""
    moving = run.role(instrument, MadeSafe)
    moving.make_safe(run.clock.now() + STANDS_WITHIN_S)
    reading = moving.read_safety()
    if not reading.safe:
        raise InstrumentError(
            instrument,
            "bring it to rest before a person reaches for it",
            f"it reads back {reading.read_back}",
            "keep away from it and stop it",
        )
    run.ask(prompt.id, prompt.text)
