"""Readings that are proven to be answers to their own questions.

A line may be out of step: a stray line, a lost or doubled answer, a device that is some
answers behind. Then each answer looks like one, and belongs to another question. Where a reading
decides whether something is at rest, an identity is asked before, between and after the readings:
no other question has that answer, so none of them can have moved.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

from drivers.transport.retry import TRIES
from station.errors import InstrumentError
from station.roles import Place


class ProvableLine(Protocol):
    """A line that can tell whether it is in step."""

    doubts: int
    """How often something was found that nobody had asked for."""

    def echoes_identity(self) -> bool:
        """Whether the answer to who is there is the identity."""
        ...

    def resynchronise(self) -> None:
        """Have the next exchange begin on a line that is opened anew and quiet."""
        ...


class Proof:
    """The proof that one line's answers are those to the questions asked."""

    def __init__(self, place: Place, line: ProvableLine) -> None:
        self._place, self._line = place, line

    def in_step(self) -> bool:
        """Whether the line answers who is there with the identity, now; never raises."""
        with suppress(InstrumentError):
            return self._line.echoes_identity()
        return False

    def of(self, *readings: Callable[[], Any]) -> list[Any]:
        """Return what the readings bring, with two identities before and one after each of them.

        All are asked again, three times at most, where one of the identities is none or something
        came that was not asked for. Raises InstrumentError where that brings no proof.
        """
        failed: InstrumentError | None = None
        for _ in range(TRIES):
            found, doubts, failed = [], self._line.doubts, None
            try:
                # Twice, so that a line two answers behind meets an identity where a reading is due.
                in_step = self._line.echoes_identity() and self._line.echoes_identity()
                for read in readings if in_step else ():
                    found.append(read())
                    in_step = in_step and self._line.echoes_identity()
            except InstrumentError as error:
                in_step, failed = False, error
            if in_step and self._line.doubts == doubts:
                return found
            with suppress(InstrumentError):
                self._line.resynchronise()
        if failed is not None:
            raise failed
        raise InstrumentError(
            self._place.name,
            "asked who it is between readings, to prove that each is the answer to its question",
            "it answered with something else each time, so nothing that it reads back counts",
            "look at its display, switch it off by hand where it is on, then switch it off and on",
        )
