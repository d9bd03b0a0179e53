"""The exceptions by which a Modbus device refuses, in plain words."""

from __future__ import annotations

from station.errors import InstrumentError
from station.roles import Place

NO_REGISTER, DEVICE_FAILURE = 2, 4
REFUSALS = {
    1: (
        "it knows no such function",
        "check that the address in the bench file is this controller's",
    ),
    2: (
        "it has no such register",
        "check that the model and the settings in the bench file are this controller's",
    ),
    3: ("it does not take this value", "compare the value with the controller's own limits"),
    4: (
        "it failed at it, or has no such input or output",
        "compare the modules it is fitted with and the bench file, and look at its front panel",
    ),
    6: ("it is busy", "wait a moment and run again; see that nobody else loads it"),
}
"""By exception code: what it means, what to do now."""


class ModbusRefusal(InstrumentError):
    """A device that answered with an exception; `code` is the exception's."""

    def __init__(self, place: Place, attempted: str, code: int) -> None:
        meaning, do_now = REFUSALS.get(
            code, ("it refused", "look the exception up in the controller's manual")
        )
        super().__init__(place.name, attempted, f"{meaning} (exception {code})", do_now)
        self.code = code
