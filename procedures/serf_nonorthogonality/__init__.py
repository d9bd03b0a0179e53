"""SERF gyro: angles between the three coils of its cell, from free precession in their fields."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from procedures.serf_nonorthogonality.check import check
from procedures.serf_nonorthogonality.forecast import forecast
from procedures.serf_nonorthogonality.parameters import SerfParameters
from procedures.serf_nonorthogonality.shots import AXES, PAIRS
from procedures.serf_nonorthogonality.steps import STEPS, instruments, prompts, units
from station.procedure import Procedure, ResultKind

if TYPE_CHECKING:
    from station.bench import Bench
    from station.dataset_reading import RawDataset
    from station.fields import StrictModel
    from station.record.folder import RunFolder
    from station.report.parts import Part
    from station.results import Findings, ResultDocument


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
    """Return in lines what a plan determines, what it does not, and how well."""
    from procedures.serf_nonorthogonality.outlook import outlook

    return outlook(parameters)


PROCEDURE = Procedure(
    name="serf-nonorthogonality",
    title="SERF gyro: non-orthogonality angles of its coils",
    source="In-situ calibration of the non-orthogonality angles of a SERF gyro's magnetic field by "
    "its built-in magnetometer (Chinese patent text 36201635, 2023-01-04), steps 1 to 7",
    parameters=SerfParameters,
    results={
        "nonorthogonality_angle": ResultKind(PAIRS, "deg"),
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
    assumptions=(
        "Only coil factor over slowing-down factor is seen. Nothing here measures a field in "
        "absolute terms; the angles do not need it.",
        "The fields are steady during a shot. A field of nuclei that still precess, or that decay "
        "from shot to shot, is not: it shows in the residual field and in chi-square.",
        "A falling frequency is taken for the slowing-down factor of one alkali at spin "
        "temperature, with a broadening that follows the square of the frequency and does not "
        "change as the polarisation fades.",
        "The law of cosines as published runs on the frequencies of this fit, which knows the "
        "baseline. On those of the printed signal formula, which has none, it is worse.",
    ),
)
