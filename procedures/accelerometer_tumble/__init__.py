"""An accelerometer tumbled on a rotary stage: the coefficients of the IEEE 1293 model.

Imported data only: a run of it does not exist yet, and a plan that asks for one is refused.

Source: IEEE Std 1293-1998, multipoint tumble (clause 8.3, annex on the multipoint tumble).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.errors import InputError
from station.fields import StrictModel
from station.procedure import LazyImport, Problem, Procedure, ResultKind

if TYPE_CHECKING:
    from station.findings import Findings
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

IMPORTED = "a tumble test is for imported data: use `station analyse` on a dataset folder"


class TumbleParameters(StrictModel):
    """A plan has no parameters: it cannot be run."""


def check(parameters: TumbleParameters, bench: Bench) -> Iterator[Problem]:
    """Yield why no plan of it can run."""
    yield Problem(("procedure",), IMPORTED)


def no_run(folder: RunFolder, parameters: TumbleParameters, bench: Bench) -> Findings:
    """Refuse what no run can have recorded."""
    raise InputError(IMPORTED)


PROCEDURE = Procedure(
    name="accelerometer-tumble",
    title="Accelerometer: tumble test on a rotary stage (imported data)",
    source="IEEE Std 1293-1998, multipoint tumble",
    parameters=TumbleParameters,
    results={
        "K0": ResultKind((), "V"),
        **{name: ResultKind((), "V/g") for name in ("Ki", "Kf", "Ko", "Kp")},
        **{name: ResultKind((), "V/g^2") for name in ("Kii", "Kio", "Kip", "Koo", "Kpp", "Kop")},
        "Kiii": ResultKind((), "V/g^3"),
        "bias": ResultKind((), "g"),
        "misalignment": ResultKind(("o", "p"), "arcsec"),
        "fixture_error": ResultKind((), "arcsec"),
    },
    steps=(),
    evaluate_run=no_run,
    evaluate_dataset=LazyImport(f"{__name__}.evaluate:findings_of_dataset"),
    check=check,
    assumptions=(
        "An encoder's first harmonic beyond its statement, and a mounting that was taken for "
        "another throughout, have the shape of coefficients: no reading shows them.",
    ),
    conditions=LazyImport(f"{__name__}.from_import:Conditions").get,
)
