"""From the record of the chamber's part to its findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from procedures.commissioning.not_measured import not_measured
from station.findings import Findings, findings_of
from station.roles.base import ARRIVAL

from .analysis import ChamberDataset, analyse
from .parameters import AXES, RESULTS, STEPPED, UNIT, ChamberParameters
from .steps import CHAMBER, LOOK_S, NAVIGATOR

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: ChamberParameters, bench: Bench) -> Findings:
    """Return the figures of the chamber; a run without its record gives none."""
    if UNIT not in folder.finished_units():
        return findings_of(not_measured("chamber", RESULTS, [UNIT]), None, [])
    data = dataset_of_run(folder, parameters)
    return findings_of(analyse(data), data, [])


def dataset_of_run(folder: RunFolder, parameters: ChamberParameters) -> ChamberDataset:
    """Return air and thermometers, the latter as means of some outputs."""
    air, device = folder.rows(CHAMBER, UNIT), folder.rows(NAVIGATOR, UNIT)
    read = np.column_stack([device[f"temperature_{axis}_degC"] for axis in AXES])
    cell = ((device[ARRIVAL] - device[ARRIVAL][0]) // LOOK_S).astype(np.int64)
    _, starts, counts = np.unique(cell, return_index=True, return_counts=True)
    return ChamberDataset(
        np.asarray(air[ARRIVAL]),
        np.asarray(air["temperature_degC"]),
        np.add.reduceat(device[ARRIVAL], starts) / counts,
        np.add.reduceat(read, starts) / counts[:, None],
        float(folder.finished_units()[UNIT][STEPPED]),
        parameters.from_degC,
        parameters.step_K,
    )
