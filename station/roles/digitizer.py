"""A digitizer: records of one signal about a trigger."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from station.roles.base import Block, Instrument, MadeSafe
from station.roles.role import Quantity, Role, SafeState


@runtime_checkable
class Digitizer(Instrument, MadeSafe, Protocol):
    """A recorder of one signal about a trigger that it gives itself; columns `time_s`, `voltage_V`.

    `time_s` is zero at the trigger. At rest its trigger output is off.
    """

    source: str
    columns: Mapping[str, str]

    @classmethod
    def why_no_record(
        cls,
        settings: Mapping[str, Any],
        sample_rate_Hz: float,
        duration_s: float,
        full_scale_V: float,
    ) -> str | None:
        """Return why it cannot take a record with these bench settings, None where it can."""
        ...

    def prepare(self, sample_rate_Hz: float, duration_s: float, full_scale_V: float) -> float:
        """Choose decimation and range, clear the last record; return the sample rate in Hz."""
        ...

    def fire(self) -> None:
        """Give the trigger: time zero of the record, and of what is wired to the output."""
        ...

    def fetch(self) -> Block | None:
        """Return the record that was fired, None while it is being taken."""
        ...

    def release(self) -> None:
        """Take the trigger output back to rest."""
        ...


DIGITIZER = Role(
    "digitizer",
    Digitizer,
    quantities={"voltage": Quantity("V", magnitude=True)},
    safe_state=SafeState("the trigger output at rest", "the state of the output pin", rank=60),
    reads_device=True,
)
