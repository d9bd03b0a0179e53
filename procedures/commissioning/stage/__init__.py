"""The part of the rotary stage: sense, zero, whole turn and axis, by the accelerometer on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station.procedure import LazyImport

from .parameters import RESULTS
from .steps import STEPS, prompts
from .work import METER, POWER, STAGE, check, instruments, records, work

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has a rotary stage, and a voltmeter for the accelerometer on it."""
    return all(name in bench.instruments for name in (STAGE, METER, POWER))


STAGE_PART = Part(
    name="stage",
    steps=STEPS,
    results=RESULTS,
    instruments=instruments,
    work=work,
    prompts=prompts,
    records=records,
    check=check,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
)
