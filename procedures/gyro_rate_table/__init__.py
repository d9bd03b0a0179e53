"""The scale factor of a rate gyro by whole turns on a rate table.

Numbered as the station does it: mount, switch on, stand, turn, stand, off; again after each
switch-on. The terms are those of IEEE Std 952 and 647; no clause of a standard is quoted.
"""

from __future__ import annotations

from station.procedure import Procedure, ResultKind, usual_modules

from .outlook import check, outlook, records, undetermined
from .parameters import UNITS, RateTableParameters
from .steps import STEPS

PROCEDURE = Procedure(
    name="gyro-rate-table",
    title="Rate table: scale factor, nonlinearity, asymmetry of a gyro",
    source="Scale factor of a rate gyro on a rate table (terms of IEEE Std 952 and 647; no clause "
    "is quoted)",
    parameters=RateTableParameters,
    results={name: ResultKind(("IA",), unit) for name, unit in UNITS.items()},
    steps=STEPS,
    records=records,
    check=check,
    **usual_modules(__name__),
    outlook=outlook,
    undetermined=undetermined,
    assumptions=(
        "K is the slope of the unweighted line through the noise-free response at the recorded "
        "rates; a mean over the rates is another number where the response is no line.",
        "K is that along the table's axis: an input axis that leans by 10 arcmin reads 4.2 ppm "
        "less.",
        "The repeatability is that of the switch-ons measured; another set scatters about it.",
        "Threshold and resolution are not measured.",
    ),
)
