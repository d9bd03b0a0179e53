"""Laser-gyro bias magnetic-field sensitivity by a sinusoidal field, S1 to S9.

Source: "a method to accurately measure the magnetic-field sensitivity of the bias of a laser
gyro", steps S1-S9.
"""

from __future__ import annotations

from station.procedure import Procedure, ResultKind, usual_modules

from .outlook import check, held_bytes, limited_results, outlook, records
from .parameters import RlgParameters
from .steps import STEPS

PROCEDURE = Procedure(
    name="rlg-magnetic-sensitivity",
    title="Laser gyro: magnetic-field sensitivity of the bias",
    source="A method to accurately measure the magnetic-field sensitivity of the bias of a laser "
    "gyro (Chinese patent text 23757495, 2020-04-11), steps S1 to S9",
    parameters=RlgParameters,
    results={"magnetic_sensitivity": ResultKind(("IA", "NA", "LA"), "deg/h/mT")},
    steps=STEPS,
    records=records,
    check=check,
    **usual_modules(__name__),
    held_bytes=held_bytes,
    outlook=outlook,
    measured_axes=lambda parameters: {"magnetic_sensitivity": tuple(parameters.axes)},
    needs_limits=limited_results,
    assumptions=(
        "The probe's axes stand along the coils' normals and the gyro's axes along both; what they "
        "differ is in the results as far as the measured cross components show it.",
        "The field is measured beside the gyro, not in it. Where the bench file states "
        "`coil_geometry`, that at the gyro follows from it; without, the coil's homogeneity is "
        "covered only as far as the gaussmeter's record in the bench file covers it.",
        "A magnetic shield of the gyro is part of the gyro: the sensitivity is that to the outer "
        "field at the drive frequency.",
        "The sensitivity is signed, positive when the output rises with the field along the "
        "positive axis. The published rule gives its magnitude only.",
    ),
)
