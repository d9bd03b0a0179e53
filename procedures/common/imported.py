"""A procedure that evaluates imported data only: no run of it exists, no plan is valid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from station.errors import InputError
from station.fields import StrictModel
from station.procedure import LazyImport, Problem, Procedure

if TYPE_CHECKING:
    from station.findings import Findings
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


class NoParameters(StrictModel):
    """A plan has no parameters: it cannot be run."""


def imported_only(package: str, what: str, **declared: Any) -> Procedure:
    """Return the procedure of a package with the modules `evaluate` and `dataset`.

    `what` begins the sentence that refuses a plan; `declared` are further fields of the procedure.
    """
    sentence = f"{what} is for imported data: use `station analyse` on a dataset folder"

    def check(parameters: NoParameters, bench: Bench) -> Iterator[Problem]:
        yield Problem(("procedure",), sentence)

    def no_run(folder: RunFolder, parameters: NoParameters, bench: Bench) -> Findings:
        raise InputError(sentence)

    return Procedure(
        parameters=NoParameters,
        steps=(),
        evaluate_run=no_run,
        evaluate_dataset=LazyImport(f"{package}.evaluate:findings_of_dataset"),
        check=check,
        conditions=LazyImport(f"{package}.dataset:Conditions").get,
        **declared,
    )
