"""FOG scale factor over temperature: turns about three axes on a ramp, a polynomial, its proof.

Source: the Chinese patent text on calibrating the full-temperature scale factor of a fibre-optic
gyro by continuous turns while the temperature rises, steps one to four.
"""

from __future__ import annotations

from station.procedure import LazyImport, Procedure, ResultKind, usual_modules

from .outlook import check, measured_axes, outlook, records
from .parameters import AXES, FogParameters
from .steps import STEPS

PROCEDURE = Procedure(
    name="fog-scale-factor-temperature",
    title="Fibre-optic gyro: scale factor over temperature",
    source="A method to determine the scale-factor error of fibre-optic gyros (CN 105277211 A, "
    "2016-01-27), steps 1 to 4",
    parameters=FogParameters,
    results={
        "scale_factor_error": ResultKind(AXES, "ppm"),
        "largest_scale_factor_error": ResultKind(AXES, "ppm"),
        "residual_scale_factor_error": ResultKind(AXES, "ppm"),
        "heading_error_uncompensated": ResultKind((), "deg"),
        "heading_error_compensated": ResultKind((), "deg"),
        "position_error_uncompensated": ResultKind((), "m"),
        "position_error_compensated": ResultKind((), "m"),
        "final_position_error_uncompensated": ResultKind((), "m"),
        "final_position_error_compensated": ResultKind((), "m"),
        "velocity_error_uncompensated": ResultKind((), "m/s"),
        "velocity_error_compensated": ResultKind((), "m/s"),
    },
    steps=STEPS,
    records=records,
    check=check,
    **usual_modules(__name__),
    inputs=LazyImport(f"{__name__}.from_import:inputs"),
    files=LazyImport(f"{__name__}.compensation:files_of"),
    outlook=outlook,
    measured_axes=measured_axes,
    assumptions=(
        "The curve is that of the ramp's direction and rate. Hysteresis between heating and "
        "cooling cannot be seen in it; a verification ramp the other way shows it.",
        "The curve is given where the gyro has been, and nowhere else: outside, compensation holds "
        "the value at the end of the range.",
        "Where turns have one sense the gyro's bias is taken for scale factor; its specification "
        "times the time of a turn is in u. Pairs of both senses cancel it.",
        "A full turn brings the table back to the same mark of its encoder, so that the error of "
        "its graduation drops out. What a table does not repeat is noise of the turns.",
    ),
)
