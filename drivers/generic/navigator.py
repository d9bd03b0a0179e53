"""What a driver of the inertial navigator does alike on CAN and on RS-422.

The navigator's interface has a supply of its own: it says who it is, and that the navigator behind
it is off, before the device under test is switched on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from drivers.generic.navigator_messages import (
    ALIGNED,
    ALIGNING,
    COLUMNS,
    REFUSALS,
    ROW,
    NavigatorLine,
    Request,
    fault_words,
)
from drivers.stream_watch import StreamWatch
from drivers.transport.acknowledged import Commands
from drivers.transport.retry import Repeatable
from station.errors import InputError
from station.roles import Block, Driver, Identity, NavigatorStatus, Place

WHEN_SILENT = "check the supply of the navigator's interface, its cable and the bit rate"
SLOWEST_HZ, FASTEST_HZ = 1.0, 10.0
RATE_STEP_HZ = 0.1


class InertialNavigator(Driver):
    """The verbs of a navigator, on any line that carries its messages."""

    roles = ("navigator",)
    """It has the verbs of a nine-axis sensor, too, and none of its columns."""
    source = "navigator"
    columns: Mapping[str, str] = COLUMNS
    repeatable: ClassVar[Repeatable] = Repeatable("stop", "identify", "status")
    """Not the start, which sets the counter back, nor the alignment, which begins again."""

    def __init__(self, place: Place, line: NavigatorLine) -> None:
        self.place = place
        self._line = line
        self._commands = Commands(place, line.answers, self._send, REFUSALS, WHEN_SILENT)
        self._watch = StreamWatch(
            place,
            "gyros'",
            "output",
            "check that the device under test is on, and the navigator's cable",
        )

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
        self._watch.begin(1 / rate_Hz)
        self.columns = {**COLUMNS, "counter": f"{COLUMNS['counter']}, every {1 / rate_Hz:.9g} s"}
        self._line.outputs()

    def stop(self) -> None:
        """End the output; what came before can still be drained."""
        self._watch.end()
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
        told = self._commands.ask("status", "status", "asked for its status")
        bits = int(told["status"])
        aligning_s = float(told["aligning_for"]) if bits & ALIGNING else None
        return NavigatorStatus(bool(bits & ALIGNED), aligning_s, fault_words(bits))

    def drain(self) -> Block:
        """Return the outputs that came since the last call; one that lacks a part is left out."""
        found = self._line.outputs()
        if found:
            self._watch.hear(found[-1].arrival_s, found[-1].warmest_degC)
        rows = np.array(found, dtype=ROW)
        return Block({name: rows[name] for name in COLUMNS}, rows["arrival_s"])

    def _temperature_degC(self) -> float | None:
        """Return the temperature of the warmest gyro; None while nothing is output.

        Outputs are looked at and left where they are, for whoever drains them. Raises
        InstrumentError when none has come for a while, or a gyro has no sensor.
        """
        if not self._watch.runs:
            return None
        newest = self._line.newest()
        if newest is not None:
            self._watch.hear(newest.arrival_s, newest.warmest_degC)
        return self._watch.temperature_degC()

    quantities: ClassVar = {"temperature": _temperature_degC}

    def close(self) -> None:
        """Close the line; the navigator goes on as it is."""
        self._line.close()

    def _send(self, command: str, number: int, values: Mapping[str, float]) -> None:
        self._line.send(Request(command, number, **values))
