"""A thermometer with places: what it read, and what its spread means for the results.

The temperature of the device that counts is taken to lie anywhere as far from what `device` reads
as the farthest of the other places at the device does: a rectangular distribution of that
half-width, on which a result depends as on an offset of its thermometer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import TYPE_CHECKING, Any

from procedures.common.stage_and_meter import THERMOMETER, USUAL_DEGC
from station.errors import MissingRows
from station.findings import Estimate, Flag, InputQuantity
from station.method.dry_run import has_setting
from station.parts import Table
from station.procedure import RecordUse
from station.roles.multimeter import DEVICE, is_at_device, places_in

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

PLACES = "places"
"""The setting of a driver that reads several."""
GRADIENT = "device_gradient_degC"
"""The input of a budget."""
ABOUT = "spread of the temperature over the device"
SOURCE = "the places of the thermometer"
Corrected = Callable[[float], float]


@dataclass(frozen=True)
class AtPlaces:
    """What a thermometer read `when`: its mean at each place, degC, NaN where it read no number."""

    when: str
    temperature_degC: Mapping[str, float]

    @property
    def spread_degC(self) -> float | None:
        """How far the farthest other place at the device is off `device`; None without both."""
        device = self.temperature_degC[DEVICE]
        away = [
            abs(degC - device)
            for place, degC in self.temperature_degC.items()
            if place != DEVICE and is_at_device(place) and math.isfinite(degC - device)
        ]
        return max(away, default=None)


def at_places(when: str, rows: NDArray[Any], corrected: Corrected) -> AtPlaces:
    """Return the means of recorded rows, shape (n,), by place; the bench's corrections applied."""
    columns = places_in(rows.dtype.names or ())
    read = means([rows[name].tolist() for name in columns.values()])
    return AtPlaces(when, dict(zip(columns, map(corrected, read), strict=True)))


def means(read: Iterable[Sequence[float]]) -> list[float]:
    """Return the means of what was read at each place at the same times, NaN without.

    Of times at which some place read no number none counts, for means of other times differ by more
    than the places do. A place that read none at more than half of the times keeps no other from
    its mean, and has none.
    """
    by_place = [*read]
    alive = [2 * sum(map(math.isfinite, own)) >= len(own) > 0 for own in by_place]
    together = zip(*compress(by_place, alive), strict=True)
    whole = [all(map(math.isfinite, at)) for at in together]
    count = sum(whole)
    return [
        math.fsum(compress(own, whole)) / count if count and is_alive else math.nan
        for own, is_alive in zip(by_place, alive, strict=True)
    ]


def has_places(rows: NDArray[Any]) -> bool:
    """Whether recorded rows of a thermometer are of several places."""
    return len(places_in(rows.dtype.names or ())) > 1


def recorded_rows(folder: RunFolder, unit: str) -> NDArray[Any] | None:
    """Return what a thermometer with places read in a unit of work; None where there was none."""
    try:
        rows = folder.rows(THERMOMETER, unit)
    except MissingRows:
        return None
    return rows if has_places(rows) else None


def record_uses(bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the spread takes of the record of a bench's thermometer with places.

    Errors that its places share are in no difference, and those against one another are in the
    spread as it was read: no part of u lacks without a record.
    """
    if not has_setting(bench, THERMOMETER, PLACES):
        return ()
    at_device = [*filter(is_at_device, bench.instruments[THERMOMETER].settings[PLACES])]
    counts = len(at_device) > 1
    return (RecordUse(THERMOMETER, "temperature", USUAL_DEGC, "degC", counts, needed=False),)


def corrected_by(bench: Bench) -> Corrected:
    """Return what applies the bench file's corrections of the thermometer."""
    return lambda degC: bench.corrected(THERMOMETER, "temperature", degC, "degC")


def at_points(folder: RunFolder, units: Iterable[str], bench: Bench) -> tuple[AtPlaces, ...]:
    """Return what was read at points: over all of them, and where it is widest; none without."""
    rows = {unit: recorded_rows(folder, unit) for unit in units}
    corrected = corrected_by(bench)
    each = [at_places(unit, own, corrected) for unit, own in rows.items() if own is not None]
    far = widest(each)
    if not each:
        return ()
    places = [*each[0].temperature_degC]
    read = means([[reading.temperature_degC[place] for reading in each] for place in places])
    whole = AtPlaces("all points", dict(zip(places, read, strict=True)))
    return (whole, *([] if far is None else [far]))


def widest(readings: Iterable[AtPlaces]) -> AtPlaces | None:
    """Return the reading with the largest spread over the device; None where none has one."""
    spread = [reading for reading in readings if reading.spread_degC is not None]
    return max(spread, key=lambda reading: reading.spread_degC or 0.0, default=None)


def gradient_inputs(readings: Iterable[AtPlaces]) -> Iterator[InputQuantity]:
    """Yield the spread over the device as an input, where there was a thermometer with places."""
    reading = widest(readings)
    if reading is not None and reading.spread_degC is not None:
        u_degC = reading.spread_degC / math.sqrt(3.0)
        yield InputQuantity(GRADIENT, ABOUT, u_degC, "degC", SOURCE, distribution="uniform")


def silent_flags(readings: Sequence[AtPlaces]) -> Iterator[Flag]:
    """Yield a flag where a place at the device read no number: the spread lacks it, and u."""
    if not readings:
        return
    silent = {
        place: sum(not math.isfinite(reading.temperature_degC[place]) for reading in readings)
        for place in readings[0].temperature_degC
        if is_at_device(place)
    }
    for place, count in silent.items():
        if count:
            yield Flag(
                "place-silent",
                f"The thermometer read no number at {place} in {count} of {len(readings)} "
                "readings: what the temperature differs there is in no uncertainty. Check the "
                "sensor and its wires.",
                details={"count": count},
            )


def with_gradient(
    estimates: Sequence[Estimate], inputs: Iterable[InputQuantity], offset: str
) -> list[Estimate]:
    """Return estimates that depend on the spread, where it is an input, as on the `offset`."""
    if all(given.name != GRADIENT for given in inputs):
        return list(estimates)
    return [
        replace(own, sensitivities={**own.sensitivities, GRADIENT: own.sensitivities[offset]})
        if offset in own.sensitivities
        else own
        for own in estimates
    ]


def table_of(readings: Sequence[AtPlaces]) -> Iterator[Table]:
    """Yield the table of temperatures by place, where there are any."""
    if not readings:
        return
    places, rows = list(readings[0].temperature_degC), []
    for reading in readings:
        spread = "" if reading.spread_degC is None else f"{reading.spread_degC:.3f}"
        degC = [
            f"{value:.3f}" if math.isfinite(value) else ""
            for value in reading.temperature_degC.values()
        ]
        rows.append([reading.when, *degC, spread])
    yield Table(
        "Temperatures by place",
        "What the thermometer read at each of its places, as its calibration record corrects it, "
        "and how far the farthest place at the device is off `device`. The temperature that counts "
        "is taken to lie anywhere as far from `device` as the largest of these: its standard "
        "uncertainty in the budget is that over the square root of 3.",
        ["when", *(f"{place}, degC" for place in places), "spread over the device, degC"],
        rows,
    )
