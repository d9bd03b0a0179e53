"""Accelerometer magnetic sensitivity: thirteen coupled coefficients in a strong steady field.

Source: "A magnetic-sensitivity calibration system and method for a linear accelerometer" (Chinese
patent text 36286229, 2023-01-13), paragraphs [0010] to [0018].
"""

from __future__ import annotations

from station.procedure import LazyImport, Procedure, ResultKind, usual_modules

from .checks import check, records
from .parameters import AccelerometerParameters
from .steps import STEPS

UNITS = {
    **{"K0": "V", "Ki": "V/g", "Kii": "V/g^2", "Kiii": "V/g^3"},
    **dict.fromkeys(("Kio", "Kip", "Koo", "Kpp"), "V/g^2"),
    **{"Km": "V/T", "Kmm": "V/T^2"},
    **dict.fromkeys(("Kim", "Kom", "Kpm"), "V/g/T"),
}
"""As in `model`, which needs NumPy and is not imported until data are there."""


PROCEDURE = Procedure(
    name="accelerometer-magnetic-sensitivity",
    title="Accelerometer: magnetic sensitivity in a strong steady field",
    source="A magnetic-sensitivity calibration system and method for linear accelerometers "
    "(Chinese patent text 36286229, 2023-01-13), steps (1) to (8)",
    parameters=AccelerometerParameters,
    results={name: ResultKind((), unit) for name, unit in UNITS.items()},
    steps=STEPS,
    records=records,
    check=check,
    **usual_modules(__name__),
    outlook=LazyImport(f"{__name__}.outlook:outlook"),
    undetermined=LazyImport(f"{__name__}.outlook:undetermined"),
    assumptions=(
        "At rest the accelerations on the three axes always make 1 g: K0 and the square terms are "
        "distinguished only as far as the combinations say. A centrifuge would separate them.",
        "The field is a scalar in the published model, along the coil's axis. With the coil's "
        "axis along gravity a sensitivity to the direction of the field and the coupling of field "
        "and acceleration (Kim, Kom, Kpm) have the same columns.",
        "The field is measured beside the accelerometer, whose own magnet disturbs the probe; the "
        "gaussmeter's record in the bench file covers that only as far as it says so. Where the "
        "bench file states `coil_geometry`, the field at the accelerometer follows from it.",
        "Encoder offset and misalignment of the input axis are fitted wherever the plan separates "
        "them from the coefficients. In one plane they have the same column.",
    ),
)
