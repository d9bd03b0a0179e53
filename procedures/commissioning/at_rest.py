"""Coils are off and axes at rest, and read back so, before a person is asked for a hand."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from station.errors import InstrumentError
from station.method.duration import on_the_way
from station.procedure import Prompt
from station.roles import DirectCurrentSupply, MadeSafe, RotaryStage, Turntable

if TYPE_CHECKING:
    from station.method.run import Run

WITHIN_S, USUALLY_S = 30.0, 1.0


def ask_at_rest(run: Run, prompt: Prompt) -> None:
    """Make all that turns or carries a coil's current safe, then ask for a hand.

    Of the instruments that the run has opened. Raises InstrumentError where one is not safe: the
    person is not asked.
    """
    bring_to_rest(run)
    run.ask(prompt)


def bring_to_rest(run: Run) -> None:
    """Make all that turns or carries a coil's current safe; InstrumentError where one is not."""
    run.read(partial(make_all_safe, run), takes=on_the_way(USUALLY_S))


def make_all_safe(run: Run) -> None:
    """Make safe what the run has opened, one after the other, and read that back."""
    for name, instrument in run.instruments.items():
        if not isinstance(instrument, Turntable | RotaryStage | DirectCurrentSupply):
            continue
        harmful = run.role(name, MadeSafe)
        harmful.make_safe(run.now_s + WITHIN_S)
        reading = harmful.read_safety()
        if not reading.safe:
            raise InstrumentError(
                name,
                "bring it to rest before a person is asked for a hand",
                f"it reads back {reading.read_back}",
                "keep away from it and switch it off by hand",
            )
