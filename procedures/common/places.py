"""A thermometer with places: what it read, and what its spread means for the results.

The temperature of the device that counts is taken to lie anywhere as far from what `device` reads
as the farthest of the other places at the device does: a rectangular distribution of that
half-width, on which a result depends as on an offset of its thermometer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import TYPE_CHECKING, Any

from procedures.common.stage_and_meter import ARRIVAL, THERMOMETER, USUAL_DEGC
from station.errors import MissingRows
from station.findings import Estimate, Flag, InputQuantity
from station.method.dry_run import has_setting
from station.parts import Table
from station.procedure import RecordUse
from station.roles.multimeter import DEVICE, is_at_device, places_in

if TYPE_CHECKING:
    import numpy as np
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
Still = Callable[["NDArray[np.float64]"], "NDArray[np.bool_]"]
"""Which of the readings (n,) of a place stand still, as the analysis of a procedure tells it."""


@dataclass(frozen=True)
class AtPlaces:
    """What a thermometer read `when`: its mean at each place, degC, NaN where it read no number.

    `stood` counts the readings of a place that stood still: they are no numbers.
    """

    when: str
    temperature_degC: Mapping[str, float]
    stood: Mapping[str, int] = field(default_factory=dict)

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


@dataclass(frozen=True)
class PlaceRows:
    """Recorded rows (n,) of a thermometer with places, and which of each place stand still (n,)."""

    rows: NDArray[Any]
    still: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)

    def only(self, some: NDArray[np.bool_]) -> PlaceRows:
        """Return some of the rows, by a mask (n,)."""
        return PlaceRows(
            self.rows[some], {place: still[some] for place, still in self.still.items()}
        )


def judged(by_unit: Mapping[str, NDArray[Any]], still: Still) -> dict[str, PlaceRows]:
    """Return what was recorded in units of work with which readings stand `still`.

    All of them are judged together, in the order of time: in one soak a coarse sensor may repeat.
    """
    import numpy as np

    if not by_unit:
        return {}
    whole = np.concatenate([*by_unit.values()])
    order = np.argsort(whole[ARRIVAL], kind="stable")
    ends = np.cumsum([len(rows) for rows in by_unit.values()])[:-1]
    parts: dict[str, list[NDArray[np.bool_]]] = {}
    for place, column in places_in(whole.dtype.names or ()).items():
        of_place = np.zeros(len(whole), dtype=bool)
        of_place[order] = still(whole[column][order])
        parts[place] = np.split(of_place, ends)
    return {
        unit: PlaceRows(rows, {place: own[n] for place, own in parts.items()})
        for n, (unit, rows) in enumerate(by_unit.items())
    }


def at_places(when: str, recorded: PlaceRows, corrected: Corrected) -> AtPlaces:
    """Return the means of recorded rows by place; the bench's corrections applied."""
    import numpy as np

    columns, still = places_in(recorded.rows.dtype.names or ()), recorded.still
    read = means(
        np.where(still.get(place, False), math.nan, recorded.rows[name]).tolist()
        for place, name in columns.items()
    )
    stood = {place: int(own.sum()) for place, own in still.items() if own.any()}
    return AtPlaces(when, dict(zip(columns, map(corrected, read), strict=True)), stood)


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


def recorded_rows(folder: RunFolder, units: Iterable[str], still: Still) -> dict[str, PlaceRows]:
    """Return what a thermometer with places read in units of work, those in which it read any."""
    by_unit = {}
    for unit in units:
        with suppress(MissingRows):
            by_unit[unit] = folder.rows(THERMOMETER, unit)
    return judged({unit: rows for unit, rows in by_unit.items() if has_places(rows)}, still)


def record_uses(bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the spread takes of the record of a bench's thermometer with places.

    Errors that its places share are in no difference, and those against one another are in the
    spread as it was read: no part of u lacks without a record.
    """
    if not has_setting(bench, THERMOMETER, PLACES):
        return ()
    counts = tells_spread(bench)
    return (RecordUse(THERMOMETER, "temperature", USUAL_DEGC, "degC", counts, needed=False),)


def tells_spread(bench: Bench) -> bool:
    """Whether the thermometer of a bench has several places at the device."""
    if not has_setting(bench, THERMOMETER, PLACES):
        return False
    places = bench.instruments[THERMOMETER].settings[PLACES]
    return len([*filter(is_at_device, places)]) > 1


def corrected_by(bench: Bench) -> Corrected:
    """Return what applies the bench file's corrections of the thermometer."""
    return lambda degC: bench.corrected(THERMOMETER, "temperature", degC, "degC")


def at_points(
    folder: RunFolder, units: Iterable[str], bench: Bench, still: Still
) -> tuple[AtPlaces, ...]:
    """Return what was read at points: over all of them, and where it is widest; none without."""
    recorded, corrected = recorded_rows(folder, units, still), corrected_by(bench)
    each = [at_places(unit, own, corrected) for unit, own in recorded.items()]
    far = widest(each)
    if not each:
        return ()
    places = [*each[0].temperature_degC]
    read = means([[reading.temperature_degC[place] for reading in each] for place in places])
    stood = {place: sum(reading.stood.get(place, 0) for reading in each) for place in places}
    whole = AtPlaces("all points", dict(zip(places, read, strict=True)), stood)
    return (whole, *([] if far is None else [far]))


def widest(readings: Iterable[AtPlaces]) -> AtPlaces | None:
    """Return the reading with the largest spread over the device; None where none has one."""
    spread = [reading for reading in readings if reading.spread_degC is not None]
    return max(spread, key=lambda reading: reading.spread_degC or 0.0, default=None)


def gradient_inputs(readings: Iterable[AtPlaces], asked: bool) -> Iterator[InputQuantity]:
    """Yield the spread over the device as an input, where a thermometer read it.

    Where the bench's was `asked` for it and what it read does not tell it, the input is one that
    nobody states: u of a lost record is no smaller without a word.
    """
    reading = widest(readings)
    if reading is not None and reading.spread_degC is not None:
        yield _uniform(reading.spread_degC, SOURCE)
    elif asked:
        yield InputQuantity.if_stated(GRADIENT, ABOUT, None, "degC", SOURCE)


def stated_gradient(half_width_degC: float | None) -> Iterator[InputQuantity]:
    """Yield the spread over the device that the conditions of a dataset state, where they do."""
    if half_width_degC:
        yield _uniform(half_width_degC, "the dataset's conditions")


def _uniform(half_width_degC: float, source: str) -> InputQuantity:
    u_degC = half_width_degC / math.sqrt(3.0)
    return InputQuantity(GRADIENT, ABOUT, u_degC, "degC", source, distribution="uniform")


def place_flags(readings: Sequence[AtPlaces]) -> Iterator[Flag]:
    """Yield a flag where a place at the device stood still, or read no number: u lacks it."""
    from .frozen import frozen_flag

    if not readings:
        return
    places = [*filter(is_at_device, readings[0].temperature_degC)]
    for place in places:
        if count := sum(reading.stood.get(place, 0) for reading in readings):
            extent = f"{count} reading{'' if count == 1 else 's'}"
            then = "They are left out: what the temperature differs there is in no uncertainty."
            details = {"count": count, "instrument": THERMOMETER}
            yield frozen_flag(f"The thermometer at {place}", extent, "the sensor", then, details)
    silent = {
        place: sum(
            not (math.isfinite(reading.temperature_degC[place]) or reading.stood.get(place))
            for reading in readings
        )
        for place in places
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
