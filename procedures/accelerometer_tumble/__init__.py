"""An accelerometer tumbled on a rotary stage: the coefficients of the IEEE 1293 model.

Source: IEEE Std 1293-1998, multipoint tumble (clause 8.3, annex on the multipoint tumble).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.common.constants import FULL_TURN_DEG
from procedures.common.stage_and_meter import (
    MULTIMETER,
    STAGE,
    THERMOMETER,
    USUAL_DEGC,
    problems_of_meter,
)
from station.procedure import LazyImport, Problem, Procedure, RecordUse, ResultKind

from .parameters import TumbleParameters
from .steps import STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def records(parameters: TumbleParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records.

    The graduation of the stage counts where the plan states no `encoder_accuracy`.
    """
    within = parameters.encoder_accuracy_arcsec is None
    turn = FULL_TURN_DEG
    return (
        RecordUse(MULTIMETER, "voltage", parameters.scale_factor_V_per_g, "V"),
        RecordUse(STAGE, "angle", 0.0, "deg", needed=False),
        RecordUse(STAGE, "graduation", turn, "deg", within, needed=within, corrected=False),
        RecordUse(THERMOMETER, "temperature", USUAL_DEGC, "degC", needed=False),
    )


def check(parameters: TumbleParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the voltmeter cannot do, and an encoder of which nobody states how well it is."""
    yield from problems_of_meter(parameters, bench)
    if STAGE not in bench.instruments or parameters.encoder_accuracy_arcsec is not None:
        return
    if bench.stated(STAGE, "graduation", FULL_TURN_DEG, "deg") is None:
        yield Problem(
            ("parameters", "encoder_accuracy"),
            f"the calibration record of {STAGE} states no graduation; state encoder_accuracy",
        )


PROCEDURE = Procedure(
    name="accelerometer-tumble",
    title="Accelerometer: tumble test on a rotary stage",
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
    steps=STEPS,
    records=records,
    check=check,
    evaluate_run=LazyImport(f"{__name__}.evaluate:findings_of_run"),
    evaluate_dataset=LazyImport(f"{__name__}.evaluate:findings_of_dataset"),
    conditions=LazyImport(f"{__name__}.dataset:Conditions").get,
    report=LazyImport(f"{__name__}.figures:draw_parts"),
    outlook=LazyImport(f"{__name__}.outlook:outlook"),
    undetermined=LazyImport(f"{__name__}.outlook:undetermined"),
    assumptions=(
        "An encoder's first harmonic beyond its statement, and a mounting that was taken for "
        "another throughout, have the shape of coefficients: no reading shows them.",
        "The accelerometer stays in the ambient field: K0 and the coefficients hold with what that "
        "does to it (0.8 uV of K0 for 15 mV/T in 50 uT).",
    ),
)
