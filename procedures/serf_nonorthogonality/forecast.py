"""What a run will command and record; no instrument is opened to say so."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.method.set_points import SetPoint
from station.method.work import Forecast, Recording

from .cell import CHANNELS, DIGITIZER, PUMP, Coils, coils_of
from .check import knows_its_coils
from .parameters import SerfParameters
from .steps import shot_s

if TYPE_CHECKING:
    from station.instruments.bench import Bench

FIELD = ("parameters", "field")


def forecast(parameters: SerfParameters, bench: Bench) -> Forecast:
    """Return the set-points of steps 1 to 7 and the rows of the digitizer.

    Nothing where the bench file does not say what a volt makes at the coils.
    """
    if not knows_its_coils(bench):
        return Forecast()
    shots = len(parameters.wanted)
    rows = round(shots * parameters.record_s * parameters.sample_rate_Hz)
    return Forecast(
        tuple(set_points(parameters, coils_of(bench))),
        (Recording(DIGITIZER, rows, shots * shot_s(parameters)),),
        {generator: FIELD for generator, _ in CHANNELS.values()},
    )


def set_points(parameters: SerfParameters, coils: Coils) -> Iterator[SetPoint]:
    """Yield what is commanded of each instrument, in order."""
    yield SetPoint("1", PUMP, "open until the trigger")
    if parameters.gyro_was_running:
        gradient = parameters.depolarise.gradient_nT_per_cm
        yield point("1", "gradient", gradient, f"{gradient:g} nT/cm", coils)
    for number, shot in enumerate(parameters.wanted):
        step = ("3", "5")[number] if number < 2 else "7"
        for coil, field_nT in zip("xyz", shot.field_nT, strict=True):
            if field_nT:
                yield point(step, coil, field_nT, f"shot {shot.id}: {field_nT:g} nT", coils)
    yield SetPoint("7", PUMP, "closed")


def point(step: str, coil: str, field: float, said: str, coils: Coils) -> SetPoint:
    """Return the set-point of a coil."""
    generator, channel = CHANNELS[coil]
    voltage_V = coils.voltage_V(coil, field)
    return SetPoint(
        step,
        generator,
        f"channel {channel}, coil {coil}, {said}, {voltage_V:.4g} V",
        voltage_V=abs(voltage_V),
    )
