"""An accelerometer tumbled on a rotary stage: the coefficients of the IEEE 1293 model.

Source: IEEE Std 1293-1998, multipoint tumble (clause 8.3, annex on the multipoint tumble).
"""

from __future__ import annotations

from procedures.common.imported import imported_only
from station.procedure import ResultKind

PROCEDURE = imported_only(
    __name__,
    "a tumble test",
    name="accelerometer-tumble",
    title="Accelerometer: tumble test on a rotary stage (imported data)",
    source="IEEE Std 1293-1998, multipoint tumble",
    results={
        "K0": ResultKind((), "V"),
        **{name: ResultKind((), "V/g") for name in ("Ki", "Kf", "Ko", "Kp")},
        **{name: ResultKind((), "V/g^2") for name in ("Kii", "Kio", "Kip", "Koo", "Kpp", "Kop")},
        "Kiii": ResultKind((), "V/g^3"),
        "bias": ResultKind((), "g"),
        "misalignment": ResultKind(("o", "p"), "arcsec"),
        "fixture_error": ResultKind((), "arcsec"),
    },
    assumptions=(
        "An encoder's first harmonic beyond its statement, and a mounting that was taken for "
        "another throughout, have the shape of coefficients: no reading shows them.",
    ),
)
