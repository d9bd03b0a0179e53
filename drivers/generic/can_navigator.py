"""The fibre-optic navigator on CAN, decoded by its message file `config/dbc/navigator.dbc`.

An output is three messages that bear the same counter and follow one another: `NAV_HEADING`
(counter, heading, pitch), `NAV_ROLL` (counter, roll, status) and `NAV_TEMPERATURES` (counter, the
three gyros). Angles are in steps of 0.0001 deg, temperatures of 0.01 degC.

Commands and their sources:
    NAV_COMMAND - start, stop, identify, report status - this project's message file,
        config/dbc/navigator.dbc - confirmed
    NAV_ACK, NAV_STATUS, NAV_IDENTITY - what became of a command, and what it asks for - this
        project's message file, config/dbc/navigator.dbc - confirmed
    NAV_HEADING, NAV_ROLL, NAV_TEMPERATURES - an output - this project's message file,
        config/dbc/navigator.dbc - confirmed
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from drivers.generic.navigator import InertialNavigator, Output
from drivers.transport.can_messages import CanMessages, Parts
from station.roles import Place

ANSWERS: Mapping[str, str] = {
    "acknowledgement": "NAV_ACK",
    "status": "NAV_STATUS",
    "identity": "NAV_IDENTITY",
}
OUTPUT = ("NAV_HEADING", "NAV_ROLL", "NAV_TEMPERATURES")
"""The messages of an output, in the order in which they come."""


class CanNavigator(InertialNavigator):
    """A navigator that outputs heading, attitude and the temperatures of its gyros on a CAN bus."""

    identifies_on: ClassVar[str] = "socketcand"
    """Where a scan of served instruments may ask `identify`; a bus gives no `*IDN?` to go by."""

    def __init__(self, place: Place) -> None:
        self._line = CanMessages(place, "navigator", ANSWERS, OUTPUT)
        super().__init__(place, self._line)

    def _send(self, command: str, number: int, values: Mapping[str, float]) -> None:
        signals = {
            "command": command,
            "rate": values.get("rate_Hz", 0.0),
            "request_id": number,
            "latitude": values.get("latitude_deg", 0.0),
        }
        self._line.send("NAV_COMMAND", signals)

    def _outputs(self) -> list[Output]:
        return [output(parts) for parts in self._line.outputs()]

    def _newest(self) -> Output | None:
        newest = self._line.newest()
        return None if newest is None else output(newest)


def output(parts: Parts) -> Output:
    """Return an output in its units."""
    (counter, heading, pitch), (_, roll, status), (_, x, y, z) = parts.values
    return Output(int(counter), heading, pitch, roll, x, y, z, int(status), parts.arrival_s)
