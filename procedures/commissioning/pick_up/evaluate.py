"""From the record of the pick-up part to its findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from procedures.commissioning.not_measured import not_measured
from station.findings import Findings, findings_of
from station.roles.base import ARRIVAL

from .analysis import PickUpDataset, PickUpReadings, analyse, beyond_range
from .parameters import COILS, FREQUENCY, OFF, RESULTS, PickUpParameters, unit_of
from .steps import METER, RANGE_V

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

UV_PER_V = 1e6


def findings(folder: RunFolder, parameters: PickUpParameters, bench: Bench) -> Findings:
    """Return the lines of all coils; a run without all its records gives none."""
    finished = folder.finished_units()
    if missing := [unit_of(coil) for coil in (OFF, *COILS) if unit_of(coil) not in finished]:
        return findings_of(not_measured("pick_up", RESULTS, missing), None, [])
    if over := [
        coil for coil in (OFF, *COILS) if folder.rows(METER, unit_of(coil))["overload"].any()
    ]:
        return findings_of(beyond_range(over, RANGE_V), None, [])
    data = PickUpDataset({coil: readings_of(folder, unit_of(coil)) for coil in (OFF, *COILS)})
    return findings_of(analyse(data), data, [])


def readings_of(folder: RunFolder, unit: str) -> PickUpReadings:
    """Return the readings of a record, all of them within the range."""
    rows = folder.rows(METER, unit)
    return PickUpReadings(
        np.asarray(rows[ARRIVAL]),
        rows["voltage_V"] * UV_PER_V,
        float(folder.finished_units()[unit][FREQUENCY]),
    )
