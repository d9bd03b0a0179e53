"""The messages of the inertial navigator, whichever line carries them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from drivers.transport.acknowledged import AnswerLine

NO_SENSOR_DEGC = -327.68
ALIGNED, ALIGNING = 1, 2
FAULTS: Mapping[int, str] = {
    1 << 8: "switched off",
    1 << 9: "alignment failed",
    1 << 10: "a gyro failed its own test",
}
"""Words of the fault bits of a status; another bit is named by its number."""

REFUSALS: Mapping[str, str] = {
    "unknown_command": "check that the navigator's firmware and this driver belong together",
    "bad_rate": "ask for 1 Hz to 10 Hz",
    "bad_latitude": "ask for a latitude between -90 deg and 90 deg",
    "already_running": "see that nobody else uses the navigator, then start again",
    "bad_length": "check the line, then start again",
    "unit_off": "switch the device under test on, then start again",
}
"""By the word with which a command is refused: what to do now."""

RESULTS = ("ok", *REFUSALS)
COMMANDS: Mapping[str, int] = {"start": 1, "stop": 2, "identify": 3, "status": 4, "align": 5}

COLUMNS: Mapping[str, str] = {
    "counter": "1, the navigator's 16-bit number of the output",
    "heading_deg": "deg, from north towards east, 0 to 360",
    "pitch_deg": "deg, nose up positive",
    "roll_deg": "deg, right side down positive",
    "temperature_x_degC": "degC, of the gyro whose input axis is x, forward",
    "temperature_y_degC": "degC, of the gyro whose input axis is y, right",
    "temperature_z_degC": "degC, of the gyro whose input axis is z, down",
    "status": "1, bits: 0 aligned, 1 aligning, 8 switched off, 9 alignment failed, 10 gyro failed",
}
ROW = np.dtype(
    [
        (name, np.uint16 if name in ("counter", "status") else np.float64)
        for name in (*COLUMNS, "arrival_s")
    ]
)


class Output(NamedTuple):
    """One output of the navigator, in the order of the columns, and when it had come, s."""

    counter: int
    heading_deg: float
    pitch_deg: float
    roll_deg: float
    temperature_x_degC: float
    temperature_y_degC: float
    temperature_z_degC: float
    status: int
    arrival_s: float

    @property
    def warmest_degC(self) -> float:
        """The temperature of the warmest gyro; NaN where a sensor is missing."""
        found = (self.temperature_x_degC, self.temperature_y_degC, self.temperature_z_degC)
        return math.nan if min(found) <= NO_SENSOR_DEGC + 0.005 else max(found)


class Request(NamedTuple):
    """A command as it goes to the navigator."""

    command: str
    number: int
    rate_Hz: float = 0.0
    latitude_deg: float = 0.0


class NavigatorLine(Protocol):
    """The messages of a navigator on one kind of line.

    Answers are `acknowledgement` (`request_id`, `result`, `rate`), `status` (`status`,
    `aligning_for`) and `identity` (`serial_number`, `firmware_major`, `firmware_minor`). All raise
    InstrumentError when the line is gone, or for a message that is none of the navigator's.
    """

    @property
    def answers(self) -> AnswerLine:
        """The instrument's answers."""
        ...

    def send(self, request: Request) -> None:
        """Put a command on the line."""
        ...

    def outputs(self) -> list[Output]:
        """Return the complete outputs that came since the last call."""
        ...

    def newest(self) -> Output | None:
        """Return the last complete output that nobody has taken yet, and keep it."""
        ...

    def close(self) -> None:
        """Give the line back."""
        ...


def fault_words(bits: int) -> tuple[str, ...]:
    """Return in words what a status says is wrong."""
    wrong = [1 << number for number in range(16) if bits >> number & 1]
    return tuple(
        FAULTS.get(bit, f"status bit {bit.bit_length() - 1}")
        for bit in wrong
        if bit not in (ALIGNED, ALIGNING)
    )
