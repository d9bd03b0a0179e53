"""From the record of the probe's part to its findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from procedures.commissioning.coils.analysis import Mean, mean_of
from procedures.commissioning.coils.evaluate import field_of
from procedures.commissioning.not_measured import not_measured
from station.findings import Findings, findings_of

from .analysis import ProbeDataset, analyse
from .parameters import COILS, PLACES, RESULTS, ProbeParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: ProbeParameters, bench: Bench) -> Findings:
    """Return the figures of the probe's place; a run without all its records gives none."""
    units = [record.unit for place in PLACES for record in parameters.records_at(place)]
    finished = folder.finished_units()
    if missing := [unit for unit in units if unit not in finished]:
        return findings_of(not_measured("probe", RESULTS, missing), None, [])
    data = dataset_of_run(folder, parameters)
    return findings_of(analyse(data), data, [])


def dataset_of_run(folder: RunFolder, parameters: ProbeParameters) -> ProbeDataset:
    """Return half the difference of both senses; it is free of the ambient field and of zeros."""
    fields: list[list[float]] = []
    u: list[list[float]] = []
    for place in PLACES:
        means: dict[tuple[str, str], Mean] = {
            (record.coil, record.sense): mean_of(field_of(folder, record.unit))
            for record in parameters.records_at(place)
        }
        both = [(means[coil, "plus"], means[coil, "minus"]) for coil in COILS]
        fields.append([(a.field_mT[k] - b.field_mT[k]) / 2.0 for k, (a, b) in enumerate(both)])
        u.append([float(np.hypot(a.u_mT[k], b.u_mT[k])) / 2.0 for k, (a, b) in enumerate(both)])
    return ProbeDataset(
        np.array([place.shift_mm for place in PLACES]),
        np.array(fields),
        np.array(u),
        parameters.placing_mm,
        parameters.field_mT,
        parameters.device_mm,
    )
