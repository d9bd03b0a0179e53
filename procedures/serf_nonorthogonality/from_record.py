"""From a run's raw rows to the dataset: the last attempt of each finished shot."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from procedures.serf_nonorthogonality.cell import CHANNELS, DIGITIZER
from procedures.serf_nonorthogonality.dataset import SerfDataset, Shot
from procedures.serf_nonorthogonality.parameters import SerfParameters
from procedures.serf_nonorthogonality.shots import AXES, REPEATED, Wanted

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def shot_of_unit(
    folder: RunFolder, wanted: Wanted, parameters: SerfParameters, bench: Bench
) -> Shot:
    """Return a finished shot, its time zero where the field comes.

    A shot that was taken again holds several records, each beginning before the trigger: only the
    last one counts. Sample clock and, where they are known, coil constants are corrected by the
    records of the bench file.
    """
    field_nT = np.array(wanted.field_nT)
    if parameters.constants_known:
        field_nT *= [bench.corrected(CHANNELS[coil][0], "scale", 1.0, "1") for coil in AXES]
    rows = folder.rows(DIGITIZER, wanted.id)
    starts = np.flatnonzero(np.diff(rows["time_s"]) < 0) + 1
    last = rows[starts[-1] :] if len(starts) else rows
    finished = folder.finished_units().get(wanted.id, {})
    slower = parameters.sample_rate_Hz / true_rate_Hz(parameters, bench)
    time_s = slower * (last["time_s"] - float(finished.get("delay_s", 0.0)))
    after = time_s > 0.0
    return Shot(
        name=wanted.id,
        field_nT=field_nT,
        time_s=time_s[after],
        voltage_V=last["voltage_V"][after],
        full_scale_V=parameters.full_scale_V,
    )


def true_rate_Hz(parameters: SerfParameters, bench: Bench) -> float:
    """Return the sampling rate as the digitizer's record corrects it."""
    return bench.corrected(DIGITIZER, "frequency", parameters.sample_rate_Hz, "Hz")


def dataset_of_run(folder: RunFolder, parameters: SerfParameters, bench: Bench) -> SerfDataset:
    """Return all finished shots of a run in the order in which they were taken."""
    finished = folder.finished_units()
    taken = [wanted for wanted in parameters.wanted if wanted.id in finished]
    repeated = [
        (event.details["unit"], event.details["reason"])
        for event in folder.events_of(REPEATED)
        if event.details["unit"] in finished
    ]
    return SerfDataset(
        shots=[shot_of_unit(folder, wanted, parameters, bench) for wanted in taken],
        pump_axis=parameters.pump_axis,
        probe_axis=parameters.probe_axis,
        nuclear_spin=parameters.nuclear_spin,
        constants_known=parameters.constants_known,
        sample_rate_Hz=true_rate_Hz(parameters, bench),
        gamma_Hz_per_nT=parameters.gyromagnetic_ratio_Hz_per_nT,
        mains_Hz=parameters.mains_frequency_Hz,
        repeated=repeated,
        # The trigger falls anywhere between two samples.
        start_u_s=1.0 / (math.sqrt(12.0) * parameters.sample_rate_Hz),
        coil_u=_coil_u(bench),
    )


def _coil_u(bench: Bench) -> tuple[float, float, float] | None:
    """Return the relative u of the three coil constants, None where the bench does not state it."""
    x, y, z = (bench.stated(CHANNELS[coil][0], "scale", 1.0, "1") for coil in AXES)
    return None if x is None or y is None or z is None else (x[0], y[0], z[0])
