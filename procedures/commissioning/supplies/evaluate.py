"""From the record of the supplies' part to its findings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from procedures.commissioning.coils.evaluate import MT_PER_T
from procedures.commissioning.coils.parameters import COILS
from procedures.commissioning.coils.steps import GAUSSMETER, supply_of
from procedures.commissioning.not_measured import not_measured
from station.findings import Findings, findings_of

from .analysis import GAIN, SupplyRecord, analyse
from .parameters import FLOWS, RESULTS, SupplyParameters, before_unit, cut_unit, limit_unit
from .steps import FIELD_OF_CUT

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: SupplyParameters, bench: Bench) -> Findings:
    """Return the figures of the supplies; a run without all their records gives none."""
    wanted = [unit(coil) for coil in COILS for unit in (limit_unit, before_unit, cut_unit)]
    if missing := [unit for unit in wanted if unit not in folder.finished_units()]:
        return findings_of(not_measured("supplies", RESULTS, missing), None, [])
    supplies = [record_of(folder, parameters, bench, coil) for coil in COILS]
    gain = bench.stated_input(FIELD_OF_CUT, GAIN, "gain of the gaussmeter", relative=True)
    return findings_of(analyse(supplies), supplies, list(gain))


def record_of(
    folder: RunFolder, parameters: SupplyParameters, bench: Bench, coil: str
) -> SupplyRecord:
    """Return what was recorded of one supply."""
    supply = supply_of(coil)
    return SupplyRecord(
        coil,
        parameters.limit_A,
        float(folder.rows(supply, limit_unit(coil))[FLOWS][0]),
        # What counts as no current is what a read-back may be off by: a rectangle of that.
        bench.instruments[supply].limits["zero_current"] / math.sqrt(3.0),
        along_mT(folder, before_unit(coil), coil),
        along_mT(folder, cut_unit(coil), coil),
    )


def along_mT(folder: RunFolder, unit: str, coil: str) -> NDArray[np.float64]:
    """Return the valid readings of a record along a coil, shape (n,)."""
    rows = folder.rows(GAUSSMETER, unit)
    return np.asarray(rows[rows["state"] == 0][f"{coil}_T"] * MT_PER_T)
