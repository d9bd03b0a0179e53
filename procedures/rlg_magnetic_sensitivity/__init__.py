"""Laser-gyro bias magnetic-field sensitivity by a sinusoidal field, S1 to S9."""

from __future__ import annotations

from collections.abc import Mapping

from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from procedures.rlg_magnetic_sensitivity.steps import STEPS, prompts
from procedures.rlg_magnetic_sensitivity.work import (
    check,
    held_bytes,
    instruments,
    outlook,
    records,
    work,
)
from station.procedure import Procedure, ResultKind, usual_modules


def limited_results(parameters: RlgParameters) -> Mapping[str, tuple[str, ...]]:
    """Return the results that need a limit: all, where the plan stops when they are decided."""
    early = parameters.stop is not None and parameters.stop.early_decision
    return {"magnetic_sensitivity": tuple(parameters.axes)} if early else {}


PROCEDURE = Procedure(
    name="rlg-magnetic-sensitivity",
    title="Laser gyro: magnetic-field sensitivity of the bias",
    source="A method to accurately measure the magnetic-field sensitivity of the bias of a laser "
    "gyro (Chinese patent text 23757495, 2020-04-11), steps S1 to S9",
    parameters=RlgParameters,
    results={"magnetic_sensitivity": ResultKind(("IA", "NA", "LA"), "deg/h/mT")},
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=prompts,
    check=check,
    **usual_modules(__name__),
    work=work,
    held_bytes=held_bytes,
    outlook=outlook,
    measured_axes=lambda parameters: {"magnetic_sensitivity": tuple(parameters.axes)},
    needs_limits=limited_results,
    assumptions=(
        "The probe's axes stand along the coils' normals and the gyro's axes along both; what they "
        "differ is in the results as far as the measured cross components show it.",
        "The field is measured beside the gyro, not in it; the coil's homogeneity over that "
        "distance is covered only as far as the gaussmeter's record in the bench file covers it.",
        "A magnetic shield of the gyro is part of the gyro: the sensitivity is that to the outer "
        "field at the drive frequency.",
        "The sensitivity is signed, positive when the output rises with the field along the "
        "positive axis. The published rule gives its magnitude only.",
    ),
)
