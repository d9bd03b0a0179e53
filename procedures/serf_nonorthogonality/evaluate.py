"""From data to findings: the analysis, with the type B inputs that the bench file states."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.serf_nonorthogonality.analysis import analyse
from procedures.serf_nonorthogonality.cell import CHANNELS, DIGITIZER, PUMP
from procedures.serf_nonorthogonality.dataset import SerfDataset
from procedures.serf_nonorthogonality.findings import AnalysisSettings
from procedures.serf_nonorthogonality.from_import import dataset_of_import
from procedures.serf_nonorthogonality.from_record import coil_calibration, dataset_of_run
from procedures.serf_nonorthogonality.parameters import SerfParameters
from procedures.serf_nonorthogonality.shots import AXES
from station.findings import Findings, InputQuantity, findings_of

if TYPE_CHECKING:
    from station.bench import Bench
    from station.calibration import Calibration
    from station.dataset_reading import RawDataset
    from station.record.folder import RunFolder

GAMMA_ROUNDING = 5e-6 / math.sqrt(3.0)
"""Hz/nT: half a unit of the last digit of 28.02495 Hz/nT, as a uniform distribution."""
ONE_SAMPLE = 1.0 / math.sqrt(12.0)


def findings_of_run(folder: RunFolder, parameters: SerfParameters, bench: Bench) -> Findings:
    """Return what a run's finished shots say, type B inputs from the bench's calibrations."""
    dataset = dataset_of_run(folder, parameters, bench)
    inputs = [*common_inputs(dataset), *bench_inputs(dataset, parameters, bench)]
    return findings_of(analyse(dataset, settings(parameters)), dataset, inputs)


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says; it brings no calibration records."""
    dataset = dataset_of_import(raw)
    return findings_of(analyse(dataset), dataset, list(common_inputs(dataset)))


def settings(parameters: SerfParameters) -> AnalysisSettings:
    """Return the analysis settings of a plan."""
    return AnalysisSettings(**dict(parameters.thresholds))


def common_inputs(dataset: SerfDataset) -> Iterator[InputQuantity]:
    """Yield what no bench file says: the gyromagnetic ratio, how the light lies to the coils."""
    yield InputQuantity(
        "gyromagnetic_ratio",
        "gyromagnetic ratio, its last digit",
        GAMMA_ROUNDING / dataset.gamma_Hz_per_nT,
        "1",
        "CODATA, rounded",
    )


def bench_inputs(
    dataset: SerfDataset, parameters: SerfParameters, bench: Bench
) -> Iterator[InputQuantity]:
    """Yield coil constants, sample clock, trigger delay, and the residual field of a run."""
    if dataset.constants_known:
        for coil in AXES:
            yield from _coil(coil, bench)
    clock = _record(bench, DIGITIZER)
    rate_Hz = dataset.sample_rate_Hz
    if clock is not None and clock.covers("frequency", rate_Hz, "Hz"):
        u_Hz = clock.standard_uncertainty("frequency", rate_Hz, "Hz")
        yield InputQuantity(
            "sample_clock", "sample clock of the digitizer", u_Hz / rate_Hz, "1", clock.source
        )
    yield from _delay(rate_Hz, bench)
    for axis in AXES:
        yield InputQuantity(
            f"residual_{axis}_nT",
            f"residual field along {axis}, taken for zero",
            parameters.nulling.tolerance_nT / math.sqrt(3.0),
            "nT",
            "nulling.tolerance of the plan",
        )


def _coil(coil: str, bench: Bench) -> Iterator[InputQuantity]:
    record = coil_calibration(coil, bench)
    if record is not None:
        u = record.standard_uncertainty("scale", 1.0, "1")
        said = f"coil constant of {coil} ({CHANNELS[coil][0]})"
        yield InputQuantity(f"coil_{coil}", said, u, "1", record.source)


def _delay(rate_Hz: float, bench: Bench) -> Iterator[InputQuantity]:
    """Yield the time zero's uncertainty; it stands in the budget with no contribution.

    The phase of every tone is free, so that a late trigger moves no frequency.
    """
    u_s, source = ONE_SAMPLE / rate_Hz, "one sample of the digitizer"
    record = _record(bench, PUMP)
    if record is not None and record.covers("time_offset", 0.0, "s"):
        u_s = math.hypot(u_s, record.standard_uncertainty("time_offset", 0.0, "s"))
        source = record.source
    said = "trigger delay (the phase is free)"
    yield InputQuantity("trigger_delay_s", said, u_s, "s", source)


def _record(bench: Bench, instrument: str) -> Calibration | None:
    found = bench.instruments.get(instrument)
    return found.calibration if found is not None else None
