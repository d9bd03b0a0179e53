"""SERF gyro: angles between the three coils of its cell, from free precession in their fields.

Source: "In-situ calibration of the non-orthogonality angles of a SERF gyro's magnetic field by its
built-in magnetometer" (Chinese patent text 36201635, 2023-01-04), claims and steps 1 to 7.
"""

from __future__ import annotations

from station.procedure import Procedure, ResultKind, usual_modules

from .outlook import check, outlook, records
from .parameters import SerfParameters
from .shots import AXES, PAIRS
from .steps import STEPS

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
    records=records,
    check=check,
    **usual_modules(__name__),
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
