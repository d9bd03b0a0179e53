"""What a driver of the inertial navigator does alike on CAN and on RS-422.

The navigator's interface has a supply of its own: it says who it is, and that the navigator behind
it is off, before the device under test is switched on.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from drivers.transport.exchanges import Repeatable
from drivers.transport.streaming import AnswerLine, Commands, StreamingDriver
from station.errors import InputError
from station.roles import Block, Identity, NavigatorStatus, Place

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
        degC = (self.temperature_x_degC, self.temperature_y_degC, self.temperature_z_degC)
        return math.nan if min(degC) <= NO_SENSOR_DEGC + 0.005 else max(degC)


def fault_words(bits: int) -> tuple[str, ...]:
    """Return in words what a status says is wrong."""
    wrong = [1 << number for number in range(16) if bits >> number & 1]
    return tuple(
        FAULTS.get(bit, f"status bit {bit.bit_length() - 1}")
        for bit in wrong
        if bit not in (ALIGNED, ALIGNING)
    )


WHEN_SILENT = "check the supply of the navigator's interface, its cable and the bit rate"
SLOWEST_HZ, FASTEST_HZ = 1.0, 10.0
RATE_STEP_HZ = 0.1


class InertialNavigator(StreamingDriver):
    """The verbs of a navigator, on any line that carries its messages."""

    roles = ("navigator",)
    """It has the verbs of a nine-axis sensor, too, and none of its columns."""
    source = "navigator"
    whose = "gyros'"
    when_quiet = "check that the device under test is on, and the navigator's cable"
    columns: Mapping[str, str] = COLUMNS
    repeatable: ClassVar[Repeatable] = Repeatable("stop", "identify", "status")
    """Not the start, which sets the counter back, nor the alignment, which begins again."""

    def __init__(self, place: Place, answers: AnswerLine) -> None:
        super().__init__(place)
        self._commands = Commands(place, answers, self._send, REFUSALS, WHEN_SILENT)

    @abstractmethod
    def _send(self, command: str, number: int, values: Mapping[str, float]) -> None:
        """Put a command on the line; its values are `rate_Hz` and `latitude_deg`, 0 unless given.

        Answers are `acknowledgement` (`request_id`, `result`, `rate`), `status` (`status`,
        `aligning_for`) and `identity` (`serial_number`, `firmware_major`, `firmware_minor`).
        """

    @abstractmethod
    def _outputs(self) -> list[Output]:
        """Return the complete outputs that came since the last call."""

    @abstractmethod
    def _newest(self) -> Output | None:
        """Return the last complete output that nobody has taken yet, and keep it."""

    def identify(self) -> Identity:
        """Ask the interface for the navigator's identity."""
        return self._commands.identity("FOG navigator")

    def start(self, rate_Hz: float) -> None:
        """Begin to output, 1 Hz to 10 Hz in steps of 0.1 Hz, the counter from 1.

        Raises InputError for another rate, InstrumentError when the navigator is switched off.
        """
        if not (
            SLOWEST_HZ <= rate_Hz <= FASTEST_HZ
            and math.isclose(round(rate_Hz / RATE_STEP_HZ) * RATE_STEP_HZ, rate_Hz)
        ):
            raise InputError(
                f"{self.place.name}: it outputs {SLOWEST_HZ:g} Hz to {FASTEST_HZ:g} Hz in steps "
                f"of {RATE_STEP_HZ:g} Hz, not {rate_Hz:g} Hz; change the plan's navigator rate"
            )
        self.stop()
        self._commands.start_at(rate_Hz, RATE_STEP_HZ, rate_Hz=rate_Hz)
        self._begin_to_hear(1 / rate_Hz)
        self.columns = {**COLUMNS, "counter": f"{COLUMNS['counter']}, every {1 / rate_Hz:.9g} s"}
        self._outputs()

    def stop(self) -> None:
        """End the output; what came before can still be drained."""
        self._streams = False
        self._commands.command("stop")

    def align(self, latitude_deg: float) -> None:
        """Begin to find attitude and heading at a latitude; it must stand still meanwhile.

        Raises InputError for a latitude that is none, InstrumentError when it is switched off.
        """
        if not abs(latitude_deg) <= 90:
            raise InputError(
                f"{self.place.name}: {latitude_deg:g} deg is no latitude; change the plan's"
            )
        self._commands.command("align", latitude_deg=latitude_deg)

    def status(self) -> NavigatorStatus:
        """Ask whether it is aligned, and what is wrong with it."""
        status = self._commands.ask("status", "status", "asked for its status")
        bits = int(status["status"])
        aligning_s = float(status["aligning_for"]) if bits & ALIGNING else None
        return NavigatorStatus(bool(bits & ALIGNED), aligning_s, fault_words(bits))

    def drain(self) -> Block:
        """Return the outputs that came since the last call; one that lacks a part is left out."""
        outputs = self._outputs()
        if outputs:
            self._hear(outputs[-1].arrival_s, outputs[-1].warmest_degC)
        rows = np.array(outputs, dtype=ROW)
        return Block({name: rows[name] for name in COLUMNS}, rows["arrival_s"])

    def _look(self) -> None:
        newest = self._newest()
        if newest is not None:
            self._hear(newest.arrival_s, newest.warmest_degC)
