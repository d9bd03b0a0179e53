"""The uncertainty budget of type A and type B contributions (GUM, computed with GTC)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from station.findings import Estimate, InputQuantity

COVERAGE_PERCENT = 95
TYPE_A = "repeatability (from the data)"


@dataclass(frozen=True)
class BudgetLine:
    """One contribution to a standard uncertainty, in the result's unit."""

    description: str
    kind: Literal["A", "B"]
    contribution: float
    source: str

    def to_data(self) -> dict[str, Any]:
        """Return the line as in `results.json`."""
        return {
            "description": self.description,
            "type": self.kind,
            "contribution": self.contribution,
            "source": self.source,
        }


@dataclass(frozen=True)
class Combined:
    """A combined standard uncertainty with its coverage at 95 % and the budget behind it."""

    standard_uncertainty: float
    degrees_of_freedom: float
    coverage_factor: float
    expanded_uncertainty: float
    budget: tuple[BudgetLine, ...]


def combine(
    estimates: Sequence[Estimate], inputs: Sequence[InputQuantity]
) -> list[Combined | None]:
    """Return each estimate's combined uncertainty, None where it has no value.

    Effective degrees of freedom by Welch-Satterthwaite, coverage by Student's t (GUM annex G).
    """
    import GTC

    known = {
        quantity.name: (
            quantity,
            GTC.ureal(0.0, quantity.standard_uncertainty, quantity.degrees_of_freedom),
        )
        for quantity in inputs
        if quantity.standard_uncertainty > 0
    }
    combined: list[Combined | None] = []
    for estimate in estimates:
        if estimate.value is None or estimate.standard_uncertainty is None:
            combined.append(None)
            continue
        dof = estimate.degrees_of_freedom if estimate.degrees_of_freedom is not None else math.inf
        total = GTC.ureal(estimate.value, estimate.standard_uncertainty, dof)
        lines = [BudgetLine(TYPE_A, "A", estimate.standard_uncertainty, "this measurement")]
        for name, sensitivity in estimate.sensitivities.items():
            if name not in known:
                continue
            quantity, uncertain = known[name]
            total = total + sensitivity * uncertain
            contribution = abs(sensitivity) * quantity.standard_uncertainty
            lines.append(BudgetLine(quantity.description, "B", contribution, quantity.source))
        lines.sort(key=lambda line: -line.contribution)
        effective_dof = float(total.df)
        factor = float(GTC.rp.k_factor(effective_dof, COVERAGE_PERCENT))
        standard = float(total.u)
        combined.append(Combined(standard, effective_dof, factor, factor * standard, tuple(lines)))
    return combined
