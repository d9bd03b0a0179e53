"""Settings that outlast a run in an instrument: met, set, and put back at the end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from station.errors import InstrumentError


class Met(NamedTuple):
    """A setting as it was met, and how it is read and written."""

    was: str
    read: Callable[[], str]
    write: Callable[[str], None]


class KeptSettings:
    """What an instrument keeps after a run, by the name of each setting.

    `note` has an event written to the run's log: `instrument-settings` for each that is met,
    `settings-stay` for what could not be put back.
    """

    def __init__(self, note: Callable[..., None]) -> None:
        self._note = note
        self._met: dict[str, Met] = {}

    def set(
        self, name: str, value: str, read: Callable[[], str], write: Callable[[str], None]
    ) -> None:
        """Set what outlasts the run to `value`.

        `read` returns the present setting as a text that `write` takes again, and `write` proves
        what it does; InstrumentError of either is passed on.
        """
        if self.meet(name, value, read, write) != value:
            write(value)

    def meet(
        self, name: str, value: str, read: Callable[[], str], write: Callable[[str], None]
    ) -> str | None:
        """Remember what is there before its driver sets it to `value`; None where it is known."""
        if name in self._met:
            return None
        was = read()
        self._note("instrument-settings", setting=name, was=was, set=value)
        self._met[name] = Met(was, read, write)
        return was

    def put_back(self) -> None:
        """Put every setting back as it was met, the last one first; never raises.

        After one that fails the others are not tried: whoever waits, waits for one deadline.
        """
        stay: dict[str, Any] = {}
        why = ""
        for name, met in reversed(self._met.items()):
            try:
                if not why and met.read() != met.was:
                    met.write(met.was)
            except InstrumentError as error:
                why = str(error)
            if why:
                stay[name] = met.was
        self._met.clear()
        if stay:
            self._note("settings-stay", was=stay, message=why)
