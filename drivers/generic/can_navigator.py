"""The fibre-optic navigator on CAN, decoded by its message file `config/dbc/navigator.dbc`.

An output is three messages that bear the same counter and follow one another: `NAV_HEADING`
(counter, heading, pitch), `NAV_ROLL` (counter, roll, status) and `NAV_TEMPERATURES` (counter, the
three gyros). Angles are in steps of 0.0001 deg, temperatures of 0.01 degC.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from drivers.generic.navigator import InertialNavigator, Output, Request
from drivers.transport.can_messages import CanMessages, Parts
from station.roles import Place

ANSWERS: Mapping[str, str] = {
    "acknowledgement": "NAV_ACK",
    "status": "NAV_STATUS",
    "identity": "NAV_IDENTITY",
}
OUTPUT = ("NAV_HEADING", "NAV_ROLL", "NAV_TEMPERATURES")
"""The messages of an output, in the order in which they come."""


class CanNavigatorLine:
    """The navigator's messages on a CAN bus."""

    def __init__(self, place: Place) -> None:
        self.answers = self._messages = CanMessages(place, "navigator", ANSWERS, OUTPUT)

    def send(self, request: Request) -> None:
        """Put a command on the bus."""
        values = {
            "command": request.command,
            "rate": request.rate_Hz,
            "request_id": request.number,
            "latitude": request.latitude_deg,
        }
        self._messages.send("NAV_COMMAND", values)

    def outputs(self) -> list[Output]:
        """Return the complete outputs that came since the last call."""
        return [output(one) for one in self._messages.outputs()]

    def newest(self) -> Output | None:
        """Return the last complete output that nobody has taken yet, and keep it."""
        found = self._messages.newest()
        return None if found is None else output(found)

    def close(self) -> None:
        """Close the connection."""
        self._messages.close()


def output(parts: Parts) -> Output:
    """Return an output in its units."""
    (counter, heading, pitch), (_, roll, status), (_, x, y, z) = parts.values
    return Output(int(counter), heading, pitch, roll, x, y, z, int(status), parts.arrival_s)


class CanNavigator(InertialNavigator):
    """A navigator that outputs heading, attitude and the temperatures of its gyros on a CAN bus."""

    identifies_on: ClassVar[str] = "socketcand"
    """Where a scan of served instruments may ask `identify`; a bus gives no `*IDN?` to go by."""

    def __init__(self, place: Place) -> None:
        super().__init__(place, CanNavigatorLine(place))
