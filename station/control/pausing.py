"""What an instrument does while a run is paused, or why it cannot be left alone now."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from station.errors import InstrumentError, PauseRefused
from station.safety.safe_state import MadeSafe


@runtime_checkable
class Pausable(Protocol):
    """An instrument that can wait for any time and then go on with the next unit of work."""

    def pause(self) -> str:
        """Come to a state that may last for days and return its name: `holds 20 degC`.

        What the next unit of work does not set again itself must stay as it is. Raises
        PauseRefused, or InstrumentError, with the reason.
        """
        ...


@dataclass
class Words:
    """What each instrument said to a pause: what it does meanwhile, or why it refuses."""

    acknowledged: dict[str, str] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


def ask_devices(instruments: Mapping[str, object]) -> Words:
    """Ask every opened instrument that can harm whether it can be left alone now.

    One without a verb for that must read back as safe; these are asked first, and no other after
    one that refuses, so that none is changed for a pause that does not come.
    """
    words = Words()
    for name, instrument in instruments.items():
        if isinstance(instrument, MadeSafe) and not isinstance(instrument, Pausable):
            ask_for_rest(name, instrument, words)
    if not words.refused:
        for name, instrument in instruments.items():
            if isinstance(instrument, Pausable):
                try:
                    words.acknowledged[name] = instrument.pause()
                except (PauseRefused, InstrumentError) as error:
                    words.refused[name] = str(error)
                    break
    return words


def ask_for_rest(name: str, instrument: MadeSafe, words: Words) -> None:
    """Let the read-back of an instrument's safe state be its word."""
    try:
        reading = instrument.read_safety()
    except InstrumentError as error:
        words.refused[name] = str(error)
        return
    if reading.safe:
        words.acknowledged[name] = reading.read_back
    else:
        words.refused[name] = f"it is not at rest: {reading.read_back}"
