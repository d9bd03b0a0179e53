"""From a record or an imported dataset to findings, with the type B inputs of the bench file.

Of each finished shot the last attempt counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.common.inputs import Declared, with_unstated
from station.findings import Findings, InputQuantity, findings_of

from .analysis import analyse
from .cell import CHANNELS, DIGITIZER, PUMP
from .dataset import CellTemperature, SerfDataset, Shot
from .from_import import dataset_of_import
from .nulling_by_tones import MODULATED
from .oven import HEATER, cell_record
from .parameters import AnalysisSettings, SerfParameters
from .shots import AXES, REPEATED, Wanted
from .trials import trials_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

GAMMA_ROUNDING = 5e-6 / math.sqrt(3.0)
"""Hz/nT: half a unit of the last digit of 28.02495 Hz/nT, as a uniform distribution."""
INPUTS: Declared = {
    **{f"coil_{coil}": (f"coil constant of {coil}", "1") for coil in AXES},
    "sample_clock": ("sample clock of the digitizer", "1"),
    **{
        f"residual_{axis}_nT": (f"residual field along {axis}, taken for zero", "nT")
        for axis in AXES
    },
}
"""What the results depend on, beside the gyromagnetic ratio."""
ABOUT_CELL = "temperature of the cell (its slowing-down factor is measured with the angles)"
ONE_SAMPLE = 1.0 / math.sqrt(12.0)


def findings_of_run(folder: RunFolder, parameters: SerfParameters, bench: Bench) -> Findings:
    """Return what a run's finished shots say, type B inputs from the bench's calibrations."""
    dataset = dataset_of_run(folder, parameters, bench)
    inputs = [*common_inputs(dataset), *bench_inputs(dataset, parameters, bench)]
    return _findings(dataset, settings(parameters), inputs)


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says; it brings no calibration records."""
    dataset = dataset_of_import(raw)
    inputs = with_unstated(common_inputs(dataset), INPUTS)
    return _findings(dataset, AnalysisSettings(), inputs)


def _findings(
    dataset: SerfDataset, limits: AnalysisSettings, inputs: list[InputQuantity]
) -> Findings:
    analysis = analyse(dataset, limits)
    findings = findings_of(analysis, dataset, inputs)
    return replace(findings, trials=trials_of(analysis, dataset, limits))


def settings(parameters: SerfParameters) -> AnalysisSettings:
    """Return the analysis settings of a plan."""
    return AnalysisSettings.model_construct(**dict(parameters.thresholds))


def common_inputs(dataset: SerfDataset) -> Iterator[InputQuantity]:
    """Yield what no bench file says: the gyromagnetic ratio, how the light lies to the coils."""
    yield InputQuantity(
        "gyromagnetic_ratio",
        "gyromagnetic ratio, its last digit",
        GAMMA_ROUNDING / dataset.gamma_Hz_per_nT,
        "1",
        "CODATA, rounded",
        distribution="uniform",
    )


def bench_inputs(
    dataset: SerfDataset, parameters: SerfParameters, bench: Bench
) -> Iterator[InputQuantity]:
    """Yield coil constants, sample clock, trigger delay, and the residual field of a run."""
    if dataset.constants_known:
        for coil in AXES:
            generator = CHANNELS[coil][0]
            about = f"coil constant of {coil} ({generator})"
            yield from bench.stated_input((generator, "scale", 1.0, "1"), f"coil_{coil}", about)
    rate_Hz = parameters.sample_rate_Hz
    clock = (DIGITIZER, "frequency", rate_Hz, "Hz")
    about = "sample clock of the digitizer"
    yield from bench.stated_input(clock, "sample_clock", about, relative=True)
    yield from _delay(rate_Hz, bench)
    if parameters.cell_temperature_degC is not None:
        stated = (HEATER, *cell_record(parameters.cell_temperature_degC))
        yield from bench.stated_input(stated, "cell_temperature", ABOUT_CELL)
    for axis in AXES:
        yield InputQuantity(
            f"residual_{axis}_nT",
            f"residual field along {axis}, taken for zero",
            parameters.nulling.tolerance_nT / math.sqrt(3.0),
            "nT",
            "nulling.tolerance of the plan",
            distribution="uniform",
        )


def _delay(rate_Hz: float, bench: Bench) -> Iterator[InputQuantity]:
    """Yield the time zero's uncertainty; it stands in the budget with no contribution.

    The phase of every tone is free, so that a late trigger moves no frequency.
    """
    u_s, source = ONE_SAMPLE / rate_Hz, "one sample of the digitizer"
    if stated := bench.stated(PUMP, "time_offset", 0.0, "s"):
        u_s, source = math.hypot(u_s, stated[0]), stated[1]
    about = "trigger delay (the phase is free)"
    yield InputQuantity("trigger_delay_s", about, u_s, "s", source)


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
        modulated_nT=_modulated_nT(folder),
        cell=_cell(folder, [wanted.id for wanted in taken], parameters, bench),
    )


def _cell(
    folder: RunFolder, units: Sequence[str], parameters: SerfParameters, bench: Bench
) -> CellTemperature | None:
    """Return the cell's temperature before each shot, None where its heater was not driven.

    Of a shot that was taken again the last reading counts.
    """
    wanted_degC = parameters.cell_temperature_degC
    if wanted_degC is None or not units:
        return None
    read_degC = [float(folder.rows(HEATER, unit)["temperature_degC"][-1]) for unit in units]
    stated = bench.stated(HEATER, *cell_record(wanted_degC))
    return CellTemperature(
        tuple(bench.corrected(HEATER, "temperature", degC, "degC") for degC in read_degC),
        None if stated is None else stated[0],
        wanted_degC,
        parameters.stability.within_degC,
    )


def _modulated_nT(folder: RunFolder) -> Mapping[str, float]:
    """Return the residual field that the last tones told, empty where none were sent."""
    looks = list(folder.events_of(MODULATED))
    return looks[-1].details["field_nT"] if looks else {}


def _coil_u(bench: Bench) -> tuple[float, float, float] | None:
    """Return the relative u of the three coil constants, None where the bench does not state it."""
    x, y, z = (bench.stated(CHANNELS[coil][0], "scale", 1.0, "1") for coil in AXES)
    return None if x is None or y is None or z is None else (x[0], y[0], z[0])
