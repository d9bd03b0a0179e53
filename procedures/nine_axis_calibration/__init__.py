"""Nine-axis sensor: bias and scale factor of its three fibre-optic gyros."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from procedures.nine_axis_calibration.check import check, instruments
from procedures.nine_axis_calibration.forecast import forecast
from procedures.nine_axis_calibration.parameters import NineAxisParameters
from procedures.nine_axis_calibration.placing import prompts
from procedures.nine_axis_calibration.steps import STEPS, unit_durations_s
from station.procedure import Procedure, ResultKind

if TYPE_CHECKING:
    from station.bench import Bench
    from station.dataset_reading import RawDataset
    from station.fields import StrictModel
    from station.record.folder import RunFolder
    from station.report.parts import Part
    from station.results import Findings, ResultDocument

AXES = ("X", "Y", "Z")
PAIRS = ("XY", "XZ", "YX", "YZ", "ZX", "ZY")


def evaluate_run(folder: RunFolder, parameters: NineAxisParameters, bench: Bench) -> Findings:
    """Return what a run's recorded data say."""
    from procedures.nine_axis_calibration.evaluate import findings_of_run

    return findings_of_run(folder, parameters, bench)


def evaluate_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    from procedures.nine_axis_calibration.evaluate import findings_of_dataset

    return findings_of_dataset(raw)


def conditions() -> type[StrictModel]:
    """Return the model of an imported dataset's conditions."""
    from procedures.nine_axis_calibration.from_import import Conditions

    return Conditions


def report(findings: Findings, document: ResultDocument) -> Sequence[Part]:
    """Return the plots and tables of this procedure."""
    from procedures.nine_axis_calibration.figures import draw_parts

    return draw_parts(findings.detail.analysis, findings.detail.dataset)


def files(findings: Findings, document: ResultDocument) -> Mapping[str, str]:
    """Return the calibration file and its snippets, name to text."""
    from procedures.nine_axis_calibration.calibration import calibration_files

    return calibration_files(findings.detail.analysis, document)


def outlook(parameters: NineAxisParameters) -> Sequence[str]:
    """Return in lines how long a plan turns and how well it determines what."""
    from procedures.nine_axis_calibration.outlook import outlook

    return outlook(parameters)


def units(parameters: NineAxisParameters) -> tuple[str, ...]:
    """Return the units of work: each position, then each axis, rate and sense."""
    return parameters.units


PROCEDURE = Procedure(
    name="nine-axis-calibration",
    title="Nine-axis sensor: gyro bias and scale factor",
    source="A calibration method and device for a nine-axis sensor (Chinese patent text 19276906, "
    "2018-10-30), claims 1 to 4",
    parameters=NineAxisParameters,
    results={
        "bias": ResultKind(AXES, "deg/h"),
        "scale_factor": ResultKind(AXES, "1"),
        "asymmetry": ResultKind(AXES, "ppm"),
        "nonlinearity": ResultKind(AXES, "ppm"),
        "misalignment": ResultKind(PAIRS, "arcsec"),
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
    unit_durations_s=unit_durations_s,
    forecast=forecast,
    outlook=outlook,
    files=files,
    assumptions=(
        "The three positions do not determine the accelerometers or the magnetometer: each feels "
        "gravity or the field in too few directions. Their records are kept.",
        "A scale factor is that along the table's axis. An input axis tilted by 10 arcmin reads "
        "4 ppm less; with one axis recorded that cannot be told from K.",
        "Misalignments are towards the axes of the table as the sensor was mounted on it, so they "
        "hold the fixture's own errors.",
        "The bias is that of this switch-on and temperature, with the gyros at rest. It is "
        "taken as the same in all positions; where it is not, the uncertainty is widened.",
    ),
)
