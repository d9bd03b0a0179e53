"""What stands for the temperature of a device that streams: its newest output, while it streams."""

from __future__ import annotations

import math

from station.errors import InstrumentError
from station.roles import Place

SHORTEST_SILENCE_S = 3.0
SILENT_INTERVALS = 3


class StreamWatch:
    """When a stream was last heard, and the temperature that it told.

    `whose` temperature it is and what an `output` is called stand in what is said of a fault;
    `when_silent` is what to do then.
    """

    def __init__(self, place: Place, whose: str, output: str, when_silent: str) -> None:
        self._place = place
        self._whose, self._output, self._when_silent = whose, output, when_silent
        self.runs = False
        self._heard_s = 0.0
        self._silent_after_s = SHORTEST_SILENCE_S
        self._temperature_degC: float | None = None

    def begin(self, interval_s: float) -> None:
        """Take note that outputs begin, one every interval."""
        self._silent_after_s = max(SHORTEST_SILENCE_S, SILENT_INTERVALS * interval_s)
        self._heard_s, self._temperature_degC = self._place.clock.now(), None
        self.runs = True

    def end(self) -> None:
        """Take note that no output is expected any more."""
        self.runs = False

    def hear(self, arrival_s: float, temperature_degC: float | None) -> None:
        """Take note of the newest output: NaN where a sensor is missing, None where it has none."""
        self._heard_s = max(self._heard_s, arrival_s)
        if temperature_degC is None:
            return
        self._temperature_degC = temperature_degC
        if not math.isnan(temperature_degC):
            self._place.publish("temperature", temperature_degC, "degC")

    def temperature_degC(self) -> float | None:
        """Return the temperature of the newest output; None while none has told it.

        Raises InstrumentError when none has come for a while, or a sensor is missing.
        """
        attempted = f"looked for the {self._whose} temperature"
        silent_s = self._place.clock.now() - self._heard_s
        if silent_s > self._silent_after_s:
            raise InstrumentError(
                self._place.name,
                attempted,
                f"no {self._output} came for {silent_s:.3g} s",
                self._when_silent,
            )
        if self._temperature_degC is not None and math.isnan(self._temperature_degC):
            raise InstrumentError(
                self._place.name,
                attempted,
                f"the {self._output}s say that a sensor is missing",
                "check the sensor's cable, or take that interlock out of the bench file",
            )
        return self._temperature_degC
