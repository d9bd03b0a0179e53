"""The part of the chamber: how it follows its set-point, and which thermometers follow it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station.procedure import LazyImport

from .parameters import RESULTS
from .steps import CHAMBER, NAVIGATOR, POWER, STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has a chamber, and a device in it that reports its temperatures."""
    return all(name in bench.instruments for name in (CHAMBER, NAVIGATOR, POWER))


CHAMBER_PART = Part(
    name="chamber",
    steps=STEPS,
    results=RESULTS,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
)
