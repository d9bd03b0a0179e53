"""What the coils' part writes into the bench file: constants that differ from what was measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.completing import Completion
from station.findings import Findings

from .analysis import GAIN
from .limits import COVERAGE
from .parameters import COILS
from .steps import supply_of

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def completions(findings: Findings, bench: Bench) -> Iterator[Completion]:
    """Yield each coil's measured constant, where the stated one lies outside its uncertainty.

    Nothing where no record states the gaussmeter's gain. Causes are the caller's to look at.
    """
    gains = [input.standard_uncertainty for input in findings.inputs if input.name == GAIN]
    gain_u = next(iter(gains), None)
    if gain_u is None:
        return
    for estimate in findings.estimates:
        if (
            estimate.name != "coil_constant_ratio"
            or estimate.value is None
            or estimate.axis not in COILS
        ):
            continue
        u = ((estimate.standard_uncertainty or 0.0) ** 2 + (gain_u * estimate.value) ** 2) ** 0.5
        if abs(estimate.value - 1.0) <= COVERAGE * u:
            continue
        constant = estimate.extra["coil_constant_mT_per_A"]
        yield Completion(
            ("instruments", supply_of(estimate.axis), "settings", "coil_constant"),
            f"{constant:.6g} mT/A",
            f"measured, U = {100.0 * COVERAGE * u / estimate.value:.2g} % (k = {COVERAGE:g})",
            (estimate.name, estimate.axis, 1.0),
        )
