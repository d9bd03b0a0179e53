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
from procedures.serf_nonorthogonality.from_record import dataset_of_run
from procedures.serf_nonorthogonality.parameters import SerfParameters
from procedures.serf_nonorthogonality.shots import AXES
from station.findings import Findings, InputQuantity, findings_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
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
    rate_Hz = parameters.sample_rate_Hz
    if stated := bench.stated(DIGITIZER, "frequency", rate_Hz, "Hz"):
        about = "sample clock of the digitizer"
        yield InputQuantity("sample_clock", about, stated[0] / rate_Hz, "1", stated[1])
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
    generator = CHANNELS[coil][0]
    if stated := bench.stated(generator, "scale", 1.0, "1"):
        said = f"coil constant of {coil} ({generator})"
        yield InputQuantity(f"coil_{coil}", said, stated[0], "1", stated[1])


def _delay(rate_Hz: float, bench: Bench) -> Iterator[InputQuantity]:
    """Yield the time zero's uncertainty; it stands in the budget with no contribution.

    The phase of every tone is free, so that a late trigger moves no frequency.
    """
    u_s, source = ONE_SAMPLE / rate_Hz, "one sample of the digitizer"
    if stated := bench.stated(PUMP, "time_offset", 0.0, "s"):
        u_s, source = math.hypot(u_s, stated[0]), stated[1]
    said = "trigger delay (the phase is free)"
    yield InputQuantity("trigger_delay_s", said, u_s, "s", source)
