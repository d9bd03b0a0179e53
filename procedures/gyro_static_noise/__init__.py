"""A gyro at rest: its noise, its bias, and what switching it off and on does to the bias.

Numbered as the station does it: mount, warm up, a long record, short ones after each switch-on.
The coefficients are those of IEEE Std 952, annex C; no clause of a standard is quoted.
"""

from __future__ import annotations

from station.procedure import Procedure, ResultKind, usual_modules

from .outlook import outlook, records, undetermined
from .parameters import UNITS, StaticParameters
from .steps import STEPS

AXES = ("IA", "X", "Y", "Z")

PROCEDURE = Procedure(
    name="gyro-static-noise",
    title="Gyro at rest: noise coefficients, bias, repeatability",
    source="Allan variance of a gyro at rest (IEEE Std 952, annex C; no clause is quoted)",
    parameters=StaticParameters,
    results={name: ResultKind(AXES, unit) for name, unit in UNITS.items()},
    steps=STEPS,
    records=records,
    **usual_modules(__name__),
    outlook=outlook,
    measured_axes=lambda parameters: dict.fromkeys(UNITS, ("IA",)),
    undetermined=undetermined,
    assumptions=(
        "The bias instability B is that of the density B^2/(2 pi f): the Allan deviation's floor "
        "is 0.664 B. The minimum of the curve, often quoted instead, is a result of its own.",
        "The noise is that of one temperature and attitude; the earth's rate is taken off the "
        "bias for the stated input axis.",
        "The repeatability is that of the switch-ons measured, short noise taken off; another set "
        "of switch-ons scatters about it.",
    ),
)
