"""Nine-axis sensor: bias and scale factor of its three fibre-optic gyros."""

from __future__ import annotations

from station.procedure import Later, Procedure, ResultKind, usual_modules

from .parameters import NineAxisParameters
from .steps import STEPS
from .work import check, instruments, prompts, records, work

AXES = ("X", "Y", "Z")
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
    },
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=prompts,
    check=check,
    **usual_modules(__name__),
    work=work,
    outlook=Later(f"{__name__}.outlook:outlook"),
    files=Later(f"{__name__}.calibration:files_of"),
    assumptions=(
        "The three positions do not determine the accelerometers or the magnetometer: each feels "
        "gravity or the field in too few directions. Their records are kept.",
        "A scale factor is that along the table's axis. An input axis tilted by 10 arcmin reads "
        "4 ppm less; with one axis recorded that is not distinguished from K.",
        "Misalignments are towards the axes of the table as the sensor was mounted on it, so they "
        "hold the fixture's own errors.",
        "The bias is that of this switch-on and temperature, with the gyros at rest. It is "
        "taken as the same in all positions; where it is not, the uncertainty is widened.",
    ),
)
