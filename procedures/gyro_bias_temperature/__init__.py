"""The bias of a gyro over temperature: soaks and ramps in a chamber, the gyro at rest.

Imported data only: a run of it does not exist yet, and a plan that asks for one is refused.

Source: JJF 1535, bias temperature sensitivity (title seen, formula by public use; no clause is
quoted).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.errors import InputError
from station.fields import StrictModel
from station.procedure import LazyImport, Problem, Procedure, ResultKind

from .units import AXES, UNITS

if TYPE_CHECKING:
    from station.findings import Findings
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

IMPORTED = "bias over temperature is for imported data: use `station analyse` on a dataset folder"


class TemperatureParameters(StrictModel):
    """A plan has no parameters: it cannot be run."""


def check(parameters: TemperatureParameters, bench: Bench) -> Iterator[Problem]:
    """Yield why no plan of it can run."""
    yield Problem(("procedure",), IMPORTED)


def no_run(folder: RunFolder, parameters: TemperatureParameters, bench: Bench) -> Findings:
    """Refuse what no run can have recorded."""
    raise InputError(IMPORTED)


PROCEDURE = Procedure(
    name="gyro-bias-temperature",
    title="Gyro at rest: bias over temperature (imported data)",
    source="JJF 1535, bias temperature sensitivity (no clause is quoted)",
    parameters=TemperatureParameters,
    results={name: ResultKind(AXES, unit) for name, unit in UNITS.items()},
    steps=(),
    evaluate_run=no_run,
    evaluate_dataset=LazyImport(f"{__name__}.evaluate:findings_of_dataset"),
    check=check,
    report=LazyImport(f"{__name__}.figures:draw_parts"),
    assumptions=(
        "The curve is the bias at rest in the middle of its hysteresis loop, against the "
        "temperature that the thermometer reads: its offset is not in u.",
        "With a curve that is nearly a line the lag of the sensor and the sensitivity to the rate "
        "of temperature are one: the stated prior of the lag decides between them.",
        "Another switch-on has another bias: its repeatability is in no u here.",
    ),
    conditions=LazyImport(f"{__name__}.from_import:Conditions").get,
)
