"""What an analysis says: estimates, published values, flags, in words that every procedure shares.

Analyses return these as they are, so nothing but the standard library may be imported here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

NOT_TRIED = "not-tried"
"""The code of the flag that names what a bench could have been asked and was not."""


@dataclass(frozen=True)
class Estimate:
    """A quantity that the data gave, with its type A uncertainty and what else it depends on.

    Value and standard uncertainty are None where the data do not determine it, the degrees of
    freedom None where they are infinitely many. `sensitivities` maps the name of an input quantity
    to d value / d input; `extra` goes into the result as it is (terms of a combination, a model's
    coefficients).
    """

    name: str
    axis: str | None
    value: float | None
    unit: str
    standard_uncertainty: float | None
    degrees_of_freedom: float | None
    method: str
    sensitivities: Mapping[str, float] = field(default_factory=dict)
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """What the value really is, as people read it."""
        return self.measures.replace("_", " ")

    @property
    def measures(self) -> str:
        """What the value really is: the combination in `terms`, else the name."""
        terms = self.extra.get("terms")
        return combination_text(terms) if terms else self.name

    @property
    def way(self) -> tuple[str, str]:
        """How the value came: its method, and the frame that it is in."""
        return self.method, self.extra.get("frame", "")

    @property
    def holds_at(self) -> str:
        """The conditions that the value holds at, such as `25.3 degC`; empty without any."""
        return ", ".join(self.extra.get("conditions", {}).values())


def combination_text(terms: Mapping[str, float], digits: int = 4) -> str:
    """Return a combination as people write it: `K0 + Kpp`, `Kii − Kpp`, `Km + 0.05 Kmm`."""
    text = ""
    for name, share in terms.items():
        size = "" if abs(abs(share) - 1.0) < 1e-9 else f"{abs(share):.{digits}g} "
        sign = ("−" if share < 0 else "") if not text else (" − " if share < 0 else " + ")
        text += f"{sign}{size}{name}"
    return text


def undetermined(
    name: str, axis: str | None, unit: str, method: str, extra: Mapping[str, Any] | None = None
) -> Estimate:
    """Return the estimate of a quantity that the data do not determine."""
    return Estimate(name, axis, None, unit, None, None, method, {}, extra or {})


@dataclass(frozen=True)
class Published:
    """What the source document's own formula gives on the same data, None where it cannot run."""

    name: str
    axis: str | None
    value: float | None
    unit: str
    method: str

    def to_data(self) -> dict[str, Any]:
        """Return the entry of `as_published`."""
        return {
            "name": self.name,
            "axis": self.axis,
            "value": finite(self.value),
            "unit": self.unit,
            "method": self.method,
        }


@dataclass(frozen=True)
class Flag:
    """Something the reader must know, in one sentence, with a code that programs rely on.

    `details` go into the result as they are: how often it happened is `count`.
    """

    code: str
    message: str
    axis: str | None = None
    details: Mapping[str, Any] = field(default_factory=dict)

    def to_data(self) -> dict[str, Any]:
        """Return the entry of `flags`; a detail that is no finite number is left out."""
        data: dict[str, Any] = {"code": self.code, "axis": self.axis, "message": self.message}
        shown = {
            name: value
            for name, value in self.details.items()
            if not isinstance(value, float) or math.isfinite(value)
        }
        return {**data, **shown}

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Flag:
        """Return the flag that `to_data` wrote."""
        details = dict(data)
        code, axis, message = (details.pop(key) for key in ("code", "axis", "message"))
        return cls(code, message, axis, details)


NOT_IDENTIFIABLE = "not-identifiable"
CONTRADICTS = "contradicts-statement"


def contradiction(statement: str, message: str, axis: str | None = None, **details: object) -> Flag:
    """Return the flag of data that disagree with a stated constant, specification or column."""
    return Flag(CONTRADICTS, message, axis, {"statement": statement, **details})


NOT_STATED = "not stated"
"""The source of an input of which no certificate, plan or condition says how well it is known."""


@dataclass(frozen=True)
class InputQuantity:
    """A type B input: its standard uncertainty in its own unit, and where that comes from.

    The standard uncertainty is None where nobody states it: such an input has its row in the
    budget, and adds nothing to u. `value` is the best estimate, 0 of what is a deviation.
    """

    name: str
    description: str
    standard_uncertainty: float | None
    unit: str
    source: str
    degrees_of_freedom: float = math.inf
    distribution: Literal["normal", "uniform", "not stated"] = "normal"
    value: float = 0.0

    @classmethod
    def if_stated(
        cls,
        name: str,
        description: str,
        u: float | None,
        unit: str,
        source: str,
        *,
        value: float = 0.0,
    ) -> InputQuantity:
        """Return a normal input; where `u` is None or zero, one that nobody states."""
        if u:
            return cls(name, description, u, unit, source, value=value)
        distribution: Literal["not stated"] = "not stated"
        return cls(name, description, None, unit, NOT_STATED, math.inf, distribution, value)


Key = tuple[str, str | None]
"""Name and axis of a result."""


@dataclass(frozen=True)
class Covariance:
    """Covariance of results: `matrix` (k, k) in the products of their units, `keys` in its order.

    Results that are not among the keys are left out, not uncorrelated.
    """

    keys: tuple[Key, ...]
    matrix: tuple[tuple[float, ...], ...]

    def to_data(self) -> dict[str, Any]:
        """Return the `covariance` of the result document."""
        return {"names": [list(key) for key in self.keys], "matrix": [*map(list, self.matrix)]}

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Covariance:
        """Return the covariance that `to_data` wrote."""
        keys = tuple((name, axis) for name, axis in data["names"])
        return cls(keys, tuple(tuple(row) for row in data["matrix"]))


@dataclass(frozen=True)
class Trials:
    """How the whole analysis is done again with other data, for a Monte Carlo; can be pickled.

    `noisy(dataset, random)` returns the dataset with other noise, drawn by a NumPy generator from
    what the analysis knows of it; `perturbed` has, by the name of an input quantity, what returns
    the dataset as it is where the input deviates by so much. `drawn` has it of inputs that each
    stand for many, such as the errors of all mountings: it takes their u, and draws them itself.
    Inputs that both lack are propagated by their sensitivities.
    """

    dataset: Any
    analyse: Callable[[Any], Analysis]
    noisy: Callable[[Any, Any], Any]
    perturbed: Mapping[str, Callable[[Any, float], Any]]
    drawn: Mapping[str, Callable[[Any, float, Any], Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Findings:
    """All that an analysis says, and the type B inputs; `detail` is for the procedure's report.

    `covariance` is that of the estimates' type A uncertainties; None where it is not known. Without
    `trials` there is no Monte Carlo. `measured` has, by instrument and quantity, what it read, in
    the unit of the `RecordUse`: means of levels and amplitudes, never single samples with their
    noise.
    """

    estimates: Sequence[Estimate]
    published: Sequence[Published]
    flags: Sequence[Flag]
    inputs: Sequence[InputQuantity]
    detail: Any
    covariance: Covariance | None = None
    trials: Trials | None = None
    measured: Mapping[tuple[str, str], tuple[float, ...]] = field(default_factory=dict)


def extremes(values: Any) -> tuple[float, ...]:
    """Return the least and the greatest of an array, what is no number left out; none of none."""
    numbers = [float(value) for value in values if math.isfinite(value)]
    return (min(numbers), max(numbers)) if numbers else ()


def of_numbers(findings: Findings) -> Findings:
    """Return findings in which each estimate is a number with an uncertainty, or undetermined.

    No NaN is a result: what an analysis could not compute, the data do not determine.
    """
    lost = [e for e in findings.estimates if e.value is not None and not _is_number(e)]
    if not lost:
        return findings
    flags = list(findings.flags)
    for estimate in lost:
        text = (
            f"{estimate.name.replace('_', ' ').capitalize()} came out as no number: these data do "
            "not determine it. Look for columns that never change or that repeat each other."
        )
        details = {"coefficients": [estimate.name]}
        flags.append(Flag(NOT_IDENTIFIABLE, text, estimate.axis, details))
    estimates = [
        undetermined(e.name, e.axis, e.unit, e.method) if e in lost else e
        for e in findings.estimates
    ]
    return replace(findings, estimates=estimates, flags=flags)


def _is_number(estimate: Estimate) -> bool:
    u = estimate.standard_uncertainty
    return math.isfinite(estimate.value or 0.0) and (u is None or math.isfinite(u))


@dataclass(frozen=True)
class Detail:
    """What a procedure's report draws: the data, and what its analysis says of them."""

    analysis: Any
    dataset: Any


@dataclass(frozen=True)
class FlagThresholds:
    """Where the flags are raised that procedures share; a plan's `thresholds` have these defaults.

    `not_significant` is in standard uncertainties, `gap` in nominal intervals, `outlier` in robust
    standard deviations, `model_too_stiff` a correlation, `field_differs_from_commanded` relative.
    """

    not_significant: float = 2.0
    gap: float = 1.5
    outlier: float = 5.0
    model_too_stiff: float = 0.3
    field_differs_from_commanded: float = 0.01


@dataclass(frozen=True)
class Analysis:
    """The outcome of an analysis as far as every procedure's is alike.

    `estimates` stand in the order of the result document, `published` holds what the source
    document's own formula gives, `flags` what the reader must know.
    """

    estimates: Sequence[Estimate]
    published: Sequence[Published]
    flags: Sequence[Flag]

    def estimate(self, name: str, axis: str | None = None) -> Estimate:
        """Return one estimate; KeyError where the data do not concern it."""
        for estimate in self.estimates:
            if (estimate.name, estimate.axis) == (name, axis):
                return estimate
        raise KeyError((name, axis))


def findings_of(analysis: Analysis, dataset: Any, inputs: Sequence[InputQuantity]) -> Findings:
    """Return an analysis of a dataset with its type B inputs, ready to be concluded."""
    detail = Detail(analysis, dataset)
    return Findings(analysis.estimates, analysis.published, analysis.flags, inputs, detail)


def finite(value: float | None) -> float | None:
    """Return the value, or None where it is no finite number."""
    return float(value) if value is not None and math.isfinite(value) else None
