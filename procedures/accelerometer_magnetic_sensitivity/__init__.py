"""Accelerometer magnetic sensitivity: thirteen coupled coefficients in a strong steady field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from procedures.accelerometer_magnetic_sensitivity.check import check, instruments
from procedures.accelerometer_magnetic_sensitivity.forecast import forecast
from procedures.accelerometer_magnetic_sensitivity.parameters import AccelerometerParameters
from procedures.accelerometer_magnetic_sensitivity.steps import STEPS, prompts, units
from station.procedure import Procedure, ResultKind

if TYPE_CHECKING:
    from station.bench import Bench
    from station.dataset_reading import RawDataset
    from station.fields import StrictModel
    from station.record.folder import RunFolder
    from station.report.parts import Part
    from station.results import Findings, ResultDocument

UNITS = {
    **{"K0": "V", "Ki": "V/g", "Kii": "V/g^2", "Kiii": "V/g^3"},
    **dict.fromkeys(("Kio", "Kip", "Koo", "Kpp"), "V/g^2"),
    **{"Km": "V/T", "Kmm": "V/T^2"},
    **dict.fromkeys(("Kim", "Kom", "Kpm"), "V/g/T"),
}
"""As in `model`, which needs NumPy and is not imported until data are there."""


def evaluate_run(folder: RunFolder, parameters: AccelerometerParameters, bench: Bench) -> Findings:
    """Return what a run's recorded data say."""
    from procedures.accelerometer_magnetic_sensitivity.evaluate import findings_of_run

    return findings_of_run(folder, parameters, bench)


def evaluate_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    from procedures.accelerometer_magnetic_sensitivity.evaluate import findings_of_dataset

    return findings_of_dataset(raw)


def conditions() -> type[StrictModel]:
    """Return the model of an imported dataset's conditions."""
    from procedures.accelerometer_magnetic_sensitivity.from_import import Conditions

    return Conditions


def report(findings: Findings, document: ResultDocument) -> Sequence[Part]:
    """Return the plots and tables of this procedure."""
    from procedures.accelerometer_magnetic_sensitivity.figures import draw_parts

    return draw_parts(findings.detail.analysis, findings.detail.dataset, document)


def outlook(parameters: AccelerometerParameters) -> Sequence[str]:
    """Return in lines what a plan determines, what it does not, and how well."""
    from procedures.accelerometer_magnetic_sensitivity.outlook import outlook

    return outlook(parameters)


def undetermined(parameters: AccelerometerParameters) -> Mapping[str, str]:
    """Return each coefficient that a plan does not determine alone, and what it does instead."""
    from procedures.accelerometer_magnetic_sensitivity.outlook import undetermined

    return undetermined(parameters)


PROCEDURE = Procedure(
    name="accelerometer-magnetic-sensitivity",
    title="Accelerometer: magnetic sensitivity in a strong steady field",
    source="A magnetic-sensitivity calibration system and method for linear accelerometers "
    "(Chinese patent text 36286229, 2023-01-13), steps (1) to (8)",
    parameters=AccelerometerParameters,
    results={name: ResultKind((), unit) for name, unit in UNITS.items()},
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
    undetermined=undetermined,
    assumptions=(
        "At rest the accelerations on the three axes always make 1 g: K0 and the square terms are "
        "told apart only as far as the combinations say. A centrifuge would tell them apart.",
        "The field is a scalar in the published model, along the coil's axis. With the coil's "
        "axis along gravity a sensitivity to the direction of the field and the coupling of field "
        "and acceleration (Kim, Kom, Kpm) have the same columns.",
        "The field is measured beside the accelerometer, whose own magnet disturbs the probe; the "
        "gaussmeter's record in the bench file covers that only as far as it says so.",
        "Encoder offset and misalignment of the input axis are fitted wherever the plan tells "
        "them from the coefficients. In one plane they have the same column.",
    ),
)
