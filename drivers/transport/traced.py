"""A line whose bytes and faults are told to the place's tracer, where somebody listens."""

from __future__ import annotations

from station.errors import InstrumentError
from station.roles import Place


class TracedLine:
    """What every line does alike."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._clock = place.clock
        self._trace = place.trace

    def _traced(self, direction: str, data: bytes) -> None:
        if self._trace is not None:
            self._trace(direction, data)

    def _fault(
        self,
        attempted: str,
        came_back: str,
        do_now: str,
        kind: type[InstrumentError] = InstrumentError,
    ) -> InstrumentError:
        self._traced("!", f"{attempted}: {came_back}".encode())
        return kind(self._place.name, attempted, came_back, do_now)

    def _nobody_answers(
        self, why: object, do_now: str = "switch the instrument on, check its cable"
    ) -> InstrumentError:
        return self._fault(
            f"open {self._place.address}",
            f"nobody answers there ({why})",
            f"{do_now} and the address in the bench file",
        )
