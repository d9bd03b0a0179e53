"""From the record of the clocks' part to its findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from procedures.commissioning.coils.steps import GAUSSMETER
from procedures.commissioning.not_measured import not_measured
from station.findings import Analysis, Findings, findings_of

from .analysis import clock_estimate, clock_flags
from .parameters import RESULTS, UNIT, ClockParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: ClockParameters, bench: Bench) -> Findings:
    """Return the error of the gaussmeter's clock; a run without its record gives none."""
    if UNIT not in folder.finished_units():
        return findings_of(not_measured("clocks", RESULTS, [UNIT]), None, [])
    rows = folder.rows(GAUSSMETER, UNIT)
    stamps_s = np.asarray(rows["instrument_time_s"], dtype=np.float64)
    error = clock_estimate("gaussmeter_clock_error", stamps_s, rows["arrival_time_s"])
    return findings_of(Analysis([error], (), list(clock_flags(error, GAUSSMETER))), None, [])
