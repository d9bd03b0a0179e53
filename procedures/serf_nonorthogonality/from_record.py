"""From a run's raw rows to the dataset: the last attempt of each finished shot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from procedures.serf_nonorthogonality.cell import DIGITIZER, REPEATED
from procedures.serf_nonorthogonality.dataset import SerfDataset, Shot
from procedures.serf_nonorthogonality.parameters import SerfParameters

if TYPE_CHECKING:
    from station.bench import Bench
    from station.record.folder import RunFolder

Array = NDArray[np.float64]


def shot_of_unit(folder: RunFolder, unit: str) -> tuple[Array, Array]:
    """Return time (s, zero where the field comes) and voltage of a shot, (samples,) each.

    A shot that was taken again holds several records, each beginning before the trigger: only the
    last one counts.
    """
    rows = folder.rows(DIGITIZER, unit)
    starts = np.flatnonzero(np.diff(rows["time_s"]) < 0) + 1
    last = rows[starts[-1] :] if len(starts) else rows
    finished = folder.finished_units().get(unit, {})
    time_s = last["time_s"] - float(finished.get("delay_s", 0.0))
    after = time_s > 0.0
    return np.asarray(time_s[after]), np.asarray(last["voltage_V"][after])


def dataset_of_run(folder: RunFolder, parameters: SerfParameters, bench: Bench) -> SerfDataset:
    """Return all finished shots of a run in the order in which they were taken."""
    finished = folder.finished_units()
    shots = []
    for wanted in parameters.wanted:
        if wanted.id in finished:
            time_s, voltage_V = shot_of_unit(folder, wanted.id)
            shots.append(
                Shot(
                    name=wanted.id,
                    field_nT=np.array(wanted.field_nT),
                    time_s=time_s,
                    voltage_V=voltage_V,
                    full_scale_V=parameters.full_scale_V,
                )
            )
    repeated = [
        (event.details["unit"], event.details["reason"])
        for event in folder.events_of(REPEATED)
        if event.details["unit"] in finished
    ]
    known = parameters.coil_constants == "known" or parameters.shots == "as_published"
    return SerfDataset(
        shots=shots,
        pump_axis=parameters.pump_axis,
        probe_axis=parameters.probe_axis,
        nuclear_spin=parameters.nuclear_spin,
        constants_known=known,
        sample_rate_Hz=parameters.sample_rate_Hz,
        gamma_Hz_per_nT=parameters.gyromagnetic_ratio_Hz_per_nT,
        mains_Hz=parameters.mains_frequency_Hz,
        repeated=repeated,
    )
