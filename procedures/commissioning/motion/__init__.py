"""The part of the table: sense, encoder and direction of its axes, by a sensor on it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station.procedure import LazyImport

from .parameters import RESULTS
from .steps import STEPS, prompts
from .work import IMU, NAVIGATOR, POWER, TURNTABLE, check, instruments, records, work

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has a table of three named axes, and a sensor or a navigator."""
    from station.roles.turntable import table_axes

    if any(name not in bench.instruments for name in (TURNTABLE, POWER)):
        return False
    if not {IMU, NAVIGATOR} & set(bench.instruments):
        return False
    return table_axes(bench.instruments[TURNTABLE].settings) is not None


def fits(bench: Bench) -> Iterator[str]:
    """Yield that a navigator stands in for a sensor that a bench does not have."""
    if IMU not in bench.instruments:
        yield f"parameters.motion.device={NAVIGATOR}"


MOTION_PART = Part(
    name="motion",
    steps=STEPS,
    results=RESULTS,
    instruments=instruments,
    work=work,
    prompts=prompts,
    records=records,
    check=check,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
    fits=fits,
)
