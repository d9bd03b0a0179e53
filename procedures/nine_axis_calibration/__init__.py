"""Nine-axis sensor: bias and scale factor of its three fibre-optic gyros.

The nine-axis calibration step by step, numbered by the claims that the source divides it into.

Source: "A calibration method and device for a nine-axis sensor" (Chinese patent text 19276906,
2018-10-30), claims 1 and 2; letters divide a claim in the order of its text. Claims 3 and 4 give
the rates and the positions.
"""

from __future__ import annotations

from station.procedure import LazyImport, Procedure, ResultKind, usual_modules

from .directions import AXES
from .parameters import NineAxisParameters
from .steps import STEPS

PAIRS = ("XY", "XZ", "YX", "YZ", "ZX", "ZY")

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
        "accelerometer_bias": ResultKind(AXES, "g"),
        "accelerometer_scale_factor": ResultKind(AXES, "1"),
        "accelerometer_nonorthogonality": ResultKind(("XY", "XZ", "YZ"), "arcsec"),
        "accelerometer_second_order": ResultKind(AXES, "ug/g^2"),
        "boresight": ResultKind(AXES, "arcsec"),
        "g_sensitivity": ResultKind(tuple(a + b for a in AXES for b in AXES), "deg/h/g"),
        "magnetometer_offset": ResultKind(AXES, "nT"),
        "magnetometer_scale_factor": ResultKind(AXES, "1"),
        "magnetometer_misalignment": ResultKind(PAIRS, "arcsec"),
    },
    steps=STEPS,
    records=LazyImport(f"{__name__}.outlook:records"),
    check=LazyImport(f"{__name__}.outlook:check"),
    **usual_modules(__name__),
    outlook=LazyImport(f"{__name__}.outlook:outlook"),
    files=LazyImport(f"{__name__}.calibration:files_of"),
    assumptions=(
        "The three positions and the turns do not determine the accelerometers: none faces down. "
        "`poses` adds directions that do.",
        "A scale factor is that along the table's axis. An input axis tilted by 10 arcmin reads "
        "4 ppm less; with one axis recorded that is not distinguished from K.",
        "Misalignments are towards the axes of the table as the sensor was mounted on it, so they "
        "hold the fixture's own errors; towards the accelerometers where these are determined.",
        "A field that turns with the sensor, as that of the plate it is mounted on, counts as the "
        "magnetometer's offset: one mounting cannot distinguish the two.",
        "The biases are those of the positions 1 to 3: a gyro that feels gravity has it in them.",
        "The bias is that of this switch-on and temperature, with the gyros at rest. It is "
        "taken as the same in all positions; where it is not, the uncertainty is widened.",
    ),
)
