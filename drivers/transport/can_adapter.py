"""A CAN adapter through python-can, and the run time of what it stamps."""

from __future__ import annotations

import math
from contextlib import suppress

import can

from station.roles.can_addresses import CanAddress

WINDOW_S = 2.0
"""Clocks of adapters go wrong by some 1e-4: 0.4 ms in two windows."""


class Adapter:
    """A bus of python-can whose every error is OSError."""

    def __init__(self, address: CanAddress) -> None:
        try:
            self._bus = can.Bus(interface=address.interface, ignore_config=True, **address.settings)
        except Exception as error:  # libraries of makers raise whatever they like
            raise OSError(f"{address.interface}: {error}") from error
        self._next: can.Message | None = None

    @property
    def waiting(self) -> bool:
        """Whether a message has come that nobody has taken yet."""
        if self._next is None:
            self._next = self._received(0.0)
        return self._next is not None

    def recv(self, within_s: float) -> can.Message | None:
        """Return the next message that has come, or comes within a real time; raises OSError."""
        message, self._next = self._next, None
        return message or self._received(within_s)

    def send(self, message: can.Message) -> None:
        """Put a frame on the bus; raises OSError."""
        try:
            self._bus.send(message)
        except can.CanError as error:
            raise OSError(str(error)) from error

    def shutdown(self) -> None:
        """Give the adapter back."""
        with suppress(can.CanError):
            self._bus.shutdown()

    def _received(self, within_s: float) -> can.Message | None:
        try:
            return self._bus.recv(within_s)
        except can.CanError as error:
            raise OSError(str(error)) from error


class StampedTime:
    """The run time at which a frame was stamped by a clock with an origin of its own.

    A frame is taken late by chance and never early: the least delay of the last windows is the
    offset of the two clocks. A clock that is set, or drifts, is followed within two windows.
    """

    def __init__(self) -> None:
        self._since_s = -math.inf
        self._least_s = self._before_s = math.inf

    def run_time(self, stamp_s: float, taken_s: float) -> float:
        """Return when a frame came, s of run time, that was taken at run time `taken_s`."""
        if taken_s - self._since_s >= WINDOW_S:
            recent = taken_s - self._since_s < 2 * WINDOW_S
            self._before_s = self._least_s if recent else math.inf
            self._since_s, self._least_s = taken_s, math.inf
        self._least_s = min(self._least_s, taken_s - stamp_s)
        return stamp_s + min(self._least_s, self._before_s)
