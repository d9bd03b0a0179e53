"""Angles between the three coils of a SERF gyro's cell, from the spins' own precession."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from procedures.serf_nonorthogonality.check import check
from procedures.serf_nonorthogonality.forecast import forecast
from procedures.serf_nonorthogonality.parameters import SerfParameters
from procedures.serf_nonorthogonality.steps import STEPS, instruments, prompts, units
from station.procedure import Procedure, ResultKind

if TYPE_CHECKING:
    from station.bench import Bench
    from station.dataset_reading import RawDataset
    from station.fields import StrictModel
    from station.record.folder import RunFolder
    from station.report.parts import Part
    from station.results import Findings, ResultDocument

AXES = ("x", "y", "z")


def evaluate_run(folder: RunFolder, parameters: SerfParameters, bench: Bench) -> Findings:
    """Return what a run's recorded data say."""
    from procedures.serf_nonorthogonality.evaluate import findings_of_run

    return findings_of_run(folder, parameters, bench)


def evaluate_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    from procedures.serf_nonorthogonality.evaluate import findings_of_dataset

    return findings_of_dataset(raw)


def conditions() -> type[StrictModel]:
    """Return the model of an imported dataset's conditions."""
    from procedures.serf_nonorthogonality.from_import import Conditions

    return Conditions


def report(findings: Findings, document: ResultDocument) -> Sequence[Part]:
    """Return the plots and tables of this procedure."""
    from procedures.serf_nonorthogonality.figures import draw_parts

    return draw_parts(findings.detail.analysis, findings.detail.dataset, document)


def outlook(parameters: SerfParameters) -> Sequence[str]:
    """Return in lines what a plan determines and how well, before anything moves."""
    from procedures.serf_nonorthogonality.outlook import outlook

    return outlook(parameters)


PROCEDURE = Procedure(
    name="serf-nonorthogonality",
    title="SERF gyro: angles between the three coils of the cell",
    source="In-situ calibration of the non-orthogonality angles of a SERF gyro's magnetic field by "
    "its built-in magnetometer (Chinese patent text 36201635, 2023-01-04), steps 1 to 7",
    parameters=SerfParameters,
    results={
        "nonorthogonality_angle": ResultKind(("xy", "xz", "yz"), "deg"),
        "residual_field": ResultKind(AXES, "nT"),
        "coil_factor": ResultKind(AXES, "1"),
        "slowing_down_factor": ResultKind((), "1"),
    },
    steps=STEPS,
    instruments=instruments,
    prompts=prompts,
    check=check,
    evaluate_run=evaluate_run,
    evaluate_dataset=evaluate_dataset,
    report=report,
    conditions=conditions,
    units=units,
    forecast=forecast,
    outlook=outlook,
)
