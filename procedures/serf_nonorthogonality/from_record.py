"""From a run's raw rows to the dataset: the last attempt of each finished shot."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from procedures.serf_nonorthogonality.cell import CHANNELS, DIGITIZER
from procedures.serf_nonorthogonality.dataset import SerfDataset, Shot
from procedures.serf_nonorthogonality.parameters import SerfParameters
from procedures.serf_nonorthogonality.shots import AXES, Wanted
from procedures.serf_nonorthogonality.steps import REPEATED

if TYPE_CHECKING:
    from station.bench import Bench
    from station.calibration import Calibration
    from station.record.folder import RunFolder


def shot_of_unit(folder: RunFolder, wanted: Wanted, parameters: SerfParameters) -> Shot:
    """Return a finished shot, its time zero where the field comes.

    A shot that was taken again holds several records, each beginning before the trigger: only the
    last one counts.
    """
    rows = folder.rows(DIGITIZER, wanted.id)
    starts = np.flatnonzero(np.diff(rows["time_s"]) < 0) + 1
    last = rows[starts[-1] :] if len(starts) else rows
    finished = folder.finished_units().get(wanted.id, {})
    time_s = last["time_s"] - float(finished.get("delay_s", 0.0))
    after = time_s > 0.0
    return Shot(
        name=wanted.id,
        field_nT=np.array(wanted.field_nT),
        time_s=time_s[after],
        voltage_V=last["voltage_V"][after],
        full_scale_V=parameters.full_scale_V,
    )


def dataset_of_run(folder: RunFolder, parameters: SerfParameters, bench: Bench) -> SerfDataset:
    """Return all finished shots of a run in the order in which they were taken."""
    finished = folder.finished_units()
    taken = [wanted for wanted in parameters.wanted if wanted.id in finished]
    repeated = [
        (event.details["unit"], event.details["reason"])
        for event in folder.events_of(REPEATED)
        if event.details["unit"] in finished
    ]
    known = parameters.coil_constants == "known" or parameters.shots == "as_published"
    return SerfDataset(
        shots=[shot_of_unit(folder, wanted, parameters) for wanted in taken],
        pump_axis=parameters.pump_axis,
        probe_axis=parameters.probe_axis,
        nuclear_spin=parameters.nuclear_spin,
        constants_known=known,
        sample_rate_Hz=parameters.sample_rate_Hz,
        gamma_Hz_per_nT=parameters.gyromagnetic_ratio_Hz_per_nT,
        mains_Hz=parameters.mains_frequency_Hz,
        repeated=repeated,
        # The trigger falls anywhere between two samples.
        start_u_s=1.0 / (math.sqrt(12.0) * parameters.sample_rate_Hz),
        coil_u=_coil_u(bench),
    )


def coil_calibration(coil: str, bench: Bench) -> Calibration | None:
    """Return the calibration record of a coil's supply, None where it says nothing of its scale."""
    supply = bench.instruments.get(CHANNELS[coil][0])
    record = supply.calibration if supply is not None else None
    return record if record is not None and record.covers("scale", 1.0, "1") else None


def _coil_u(bench: Bench) -> tuple[float, float, float] | None:
    """Return the relative u of the three coil constants, None where the bench does not state it."""
    records = [coil_calibration(coil, bench) for coil in AXES]
    x, y, z = (one.standard_uncertainty("scale", 1.0, "1") if one else None for one in records)
    return None if x is None or y is None or z is None else (x, y, z)
