"""What the chamber's part commands and records."""

from __future__ import annotations

from collections.abc import Iterator

from station.method.commands import Power
from station.method.motion import ChamberOn, TemperatureTo
from station.method.work import Rows, Work

from .parameters import UNIT, ChamberParameters

CHAMBER, NAVIGATOR, POWER = "thermal_chamber", "navigator", "dut_power"
FROM = ("parameters", "chamber", "from")
STEP = ("parameters", "chamber", "step")
LOOK_S, OUTPUT_HZ = 10.0, 1.0


def instruments(parameters: ChamberParameters) -> tuple[str, ...]:
    """Return the bench instances that are used."""
    return (CHAMBER, NAVIGATOR, POWER)


def first(parameters: ChamberParameters) -> TemperatureTo:
    """Return the command that brings the air to where the step begins."""
    text = f"to {parameters.from_degC:g} degC"
    return TemperatureTo(CHAMBER, parameters.from_degC, text, decided_by=FROM)


def second(parameters: ChamberParameters) -> TemperatureTo:
    """Return the command of the step."""
    end_degC = parameters.from_degC + parameters.step_K
    return TemperatureTo(CHAMBER, end_degC, f"to {end_degC:g} degC", decided_by=STEP)


def work(parameters: ChamberParameters) -> Iterator[Work]:
    """Yield the step with its hold before and after."""
    lasts_s = parameters.before_s + parameters.after_s
    commands = (ChamberOn(CHAMBER), Power(POWER, True), first(parameters), second(parameters))
    rows = (Rows(NAVIGATOR, lasts_s, lasts_s * OUTPUT_HZ), Rows(CHAMBER, lasts_s, lasts_s / LOOK_S))
    yield Work("T1", UNIT, commands, rows, lasts_s)
    yield Work("T1", None, (Power(POWER, False),))
