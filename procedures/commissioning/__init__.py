"""Commissioning: what a bench's coils, supplies and probe do, before a method relies on them."""

from __future__ import annotations

from station.procedure import Procedure, ResultKind, usual_modules

from .parameters import COILS, FIGURES, CommissioningParameters
from .steps import STEPS, prompts
from .work import check, instruments, records, work

PROCEDURE = Procedure(
    name="commissioning",
    title="Commissioning of a bench: coils, their supplies and the field probe",
    source="Inertial Station, checks C1 and C2 (no published method)",
    parameters=CommissioningParameters,
    results={name: ResultKind(COILS, unit) for name, unit in FIGURES},
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=prompts,
    check=check,
    **usual_modules(__name__),
    work=work,
    assumptions=(
        "The probe's axes stand along the coils' as its prompt asks: a probe turned by a small "
        "angle shows as a part across the axes of all coils.",
        "A reversed coil and a reversed axis of the probe differ only by the ambient field that "
        "the plan states; two exchanged coils and two exchanged axes of the probe only where the "
        "coil constants differ.",
    ),
)
