"""Uncertainty budgets of type A and type B contributions, as the GUM has them (GTC)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from station.findings import Covariance, Estimate, InputQuantity, finite

COVERAGE_PERCENT = 95
TYPE_A = "repeatability (from the data)"
MONTE_CARLO = "monte-carlo"
"""The method of a result whose value and uncertainty are those of its trials."""


@dataclass(frozen=True)
class BudgetLine:
    """One contribution to a standard uncertainty: the columns of the GUM's table (annex H).

    `value`, `standard_uncertainty` and `degrees_of_freedom` are the input's own, in its `unit`; the
    uncertainty is None where nobody states it, the value where an older document has none.
    `sensitivity` is d result / d input; `contribution` is in the result's unit, `share` its part of
    the combined variance.
    """

    quantity: str
    description: str
    kind: Literal["A", "B"]
    standard_uncertainty: float | None
    unit: str
    distribution: str
    degrees_of_freedom: float
    sensitivity: float
    contribution: float
    share: float
    source: str
    value: float | None = None

    def to_data(self) -> dict[str, Any]:
        """Return the line as in `results.json`; degrees of freedom without end are null."""
        return {
            "description": self.description,
            "type": self.kind,
            "contribution": self.contribution,
            "source": self.source,
            "quantity": self.quantity,
            "value": self.value,
            "standard_uncertainty": self.standard_uncertainty,
            "unit": self.unit,
            "distribution": self.distribution,
            "degrees_of_freedom": finite(self.degrees_of_freedom),
            "sensitivity": self.sensitivity,
            "share": self.share,
        }

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> BudgetLine:
        """Return the line that `to_data` wrote."""
        rest = dict(data)
        dof = rest.pop("degrees_of_freedom")
        return cls(
            kind=rest.pop("type"), degrees_of_freedom=math.inf if dof is None else dof, **rest
        )


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

    Effective degrees of freedom by Welch-Satterthwaite, coverage by Student's t (GUM annex G). By
    Monte Carlo u is that of the trials, U reaches to the farther end of their interval, and the
    budget stays the linear one.
    """
    import GTC

    known = {
        quantity.name: (
            quantity,
            GTC.ureal(0.0, quantity.standard_uncertainty, quantity.degrees_of_freedom),
        )
        for quantity in inputs
        if quantity.standard_uncertainty
    }
    unstated = {
        quantity.name: quantity for quantity in inputs if quantity.standard_uncertainty is None
    }
    combined: list[Combined | None] = []
    for estimate in estimates:
        if estimate.value is None or estimate.standard_uncertainty is None:
            combined.append(None)
            continue
        dof = estimate.degrees_of_freedom if estimate.degrees_of_freedom is not None else math.inf
        total = GTC.ureal(estimate.value, estimate.standard_uncertainty, dof)
        inner = {name: at for name, at in estimate.sensitivities.items() if name in known}
        for name, sensitivity in inner.items():
            total = total + sensitivity * known[name][1]
        variance = float(total.u) ** 2
        lines = [_repeatability(estimate, dof, variance)]
        lines += [_of_input(known[name][0], at, variance) for name, at in inner.items()]
        lines += [
            _of_input(unstated[name], at, variance)
            for name, at in estimate.sensitivities.items()
            if name in unstated and at
        ]
        lines.sort(key=lambda line: -line.contribution)
        effective_dof = float(total.df)
        factor = coverage_factor(effective_dof)
        standard = float(total.u)
        if estimate.method == MONTE_CARLO:
            own, effective_dof = estimate.extra["monte_carlo"], math.inf
            standard = own["standard_uncertainty"]
            factor = max(abs(end - estimate.value) for end in own["interval"]) / standard
        combined.append(Combined(standard, effective_dof, factor, factor * standard, tuple(lines)))
    return combined


def coverage_factor(degrees_of_freedom: float) -> float:
    """Return Student's t for a coverage of 95 %."""
    import GTC

    return float(GTC.rp.k_factor(degrees_of_freedom, COVERAGE_PERCENT))


def _repeatability(estimate: Estimate, dof: float, variance: float) -> BudgetLine:
    """Return the line of what the data themselves say."""
    u = estimate.standard_uncertainty or 0.0
    return BudgetLine(
        quantity="repeatability",
        description=TYPE_A,
        kind="A",
        standard_uncertainty=u,
        unit=estimate.unit,
        distribution="Student's t" if math.isfinite(dof) else "normal",
        degrees_of_freedom=dof,
        sensitivity=1.0,
        contribution=u,
        share=_share(u, variance),
        source="this measurement",
        value=estimate.value,
    )


def _of_input(quantity: InputQuantity, sensitivity: float, variance: float) -> BudgetLine:
    """Return the line of a type B input."""
    contribution = abs(sensitivity) * (quantity.standard_uncertainty or 0.0)
    return BudgetLine(
        quantity=quantity.name,
        description=quantity.description,
        kind="B",
        standard_uncertainty=quantity.standard_uncertainty,
        unit=quantity.unit,
        distribution=quantity.distribution,
        degrees_of_freedom=quantity.degrees_of_freedom,
        sensitivity=sensitivity,
        contribution=contribution,
        share=_share(contribution, variance),
        source=quantity.source,
        value=quantity.value,
    )


def _share(contribution: float, variance: float) -> float:
    return contribution**2 / variance if variance > 0.0 else 0.0


def covariance_of(
    estimates: Sequence[Estimate], inputs: Sequence[InputQuantity], type_a: Covariance | None
) -> Covariance | None:
    """Return the covariance of the results: that of the data, and what shared inputs add.

    One gaussmeter is one input of three axes. None where that of the data is not known (GUM 5.2.2,
    F.1.2.3).
    """
    if type_a is None:
        return None
    determined = {
        (estimate.name, estimate.axis): estimate
        for estimate in estimates
        if estimate.standard_uncertainty is not None
    }
    places = [n for n, key in enumerate(type_a.keys) if key in determined]
    keys = tuple(type_a.keys[n] for n in places)
    u = {input.name: input.standard_uncertainty for input in inputs}

    def shared(a: Estimate, b: Estimate) -> float:
        return sum(
            at * b.sensitivities.get(name, 0.0) * (u.get(name) or 0.0) ** 2
            for name, at in a.sensitivities.items()
        )

    matrix = tuple(
        tuple(
            type_a.matrix[places[row]][places[column]] + shared(determined[a], determined[b])
            for column, b in enumerate(keys)
        )
        for row, a in enumerate(keys)
    )
    return Covariance(keys, matrix)
