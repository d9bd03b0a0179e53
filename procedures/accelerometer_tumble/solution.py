"""All readings in one weighted least-squares solution, with priors on encoder and mountings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation.alternatives import Alternative, Score, doubt, farthest, worth_trying
from procedures.estimation.orthogonal import (
    choose_by_information,
    independent_of,
    information,
    keep_inliers,
)
from procedures.estimation.sine import legendre_columns
from procedures.estimation.slow_terms import (
    DRIFT,
    K0_T,
    KI_T,
    Terms,
    apart,
    candidates,
    likelihoods,
)

from .causes import alternatives_of, scores_of
from .dataset import AnalysisSettings, Mask, TumbleDataset
from .model import COEFFICIENTS, Array

ROUNDS = 8
OWN_PART = 1e-3
"""A slow term is tried where more than this part of its column is its own."""
ROWS_A_TERM = 6
SMALLEST_NOISE_V = 1e-12
MAX_TRIED = 6
"""Alternatives of one shape: each moves the coefficients by its own amount."""
MAX_WILD = 0.1
"""More than this part of the readings is not wild: the model does not follow them."""
ENCODER, MOUNTING = "encoder", "mounting"


@dataclass(frozen=True)
class Beside:
    """Columns (n, m) of what is beside the model, V per rad, with their priors (m,) in rad.

    `encoder` says which are the encoder's harmonics; the others are mountings, in their order.
    """

    columns: Array
    prior_rad: Array
    encoder: Mask


@dataclass(frozen=True)
class Parts:
    """What the output (n,) is made of: the model's columns, slow ones by name, what is beside.

    Only rows `inside` (n,) count. The `slow` terms are some of the `usable` ones, which the rows
    tell from the model.
    """

    output: Array
    inside: Mask
    model: Array
    slow: Terms
    usable: Terms
    beside: Beside

    def with_slow(self, names: Iterable[str]) -> Parts:
        """Return these parts with some of the usable slow terms."""
        return replace(self, slow={name: self.usable[name] for name in names})

    @property
    def design(self) -> Array:
        """The columns without a prior (n, k)."""
        return np.column_stack((self.model, *self.slow.values()))

    @property
    def columns(self) -> Array:
        """All columns (n, k + m)."""
        return np.column_stack((self.design, self.beside.columns))

    def system(self, sigma_V: float) -> tuple[Array, Array]:
        """Return the readings that count over their noise, then one row a prior."""
        top, prior_rad = self.columns[self.inside] / sigma_V, self.beside.prior_rad
        known = np.diag(1.0 / prior_rad) if len(prior_rad) else np.empty((0, 0))
        known = np.hstack((np.zeros((len(known), top.shape[1] - len(known))), known))
        data = np.append(self.output[self.inside] / sigma_V, np.zeros(len(known)))
        return np.vstack((top, known)), data


@dataclass(frozen=True)
class Solution:
    """The kept coefficients (k,), in V and g, and what they rest on.

    `names` are theirs; `covariance` (k, k) is whole; `noise` (k, k) the readings' part of it;
    `by_prior` (k, m) how much each coefficient takes of one standard deviation of each prior.
    `slow` are the coefficients of drift and temperature (K0_T in V/degC, Ki_T in V/g/degC),
    `beside` (m,) the solved encoder harmonics and mountings in rad, `beside_u` their standard
    deviation under the priors. `cause` is what else moved the output, with its coefficients
    `cause_terms`.
    """

    parts: Parts
    names: tuple[str, ...]
    value: Array
    covariance: Array
    noise: Array
    by_prior: Array
    freedom: float
    sigma_V: float
    residual_V: Array
    slow: Mapping[str, float]
    beside: Array
    beside_u: Array
    cause: Alternative | None
    cause_terms: Array

    @property
    def kept(self) -> Mask:
        """The readings that count (n,)."""
        return self.parts.inside

    @property
    def priors(self) -> Beside:
        """What is known beforehand of encoder and mountings."""
        return self.parts.beside

    @property
    def slow_V(self) -> Array:
        """What drift and temperature make of the output (n,)."""
        nothing = np.zeros(len(self.residual_V))
        return sum((self.slow[name] * own for name, own in self.parts.slow.items()), nothing)

    def of(self, name: str) -> float:
        """Return a coefficient, 0 of one that is not kept."""
        return float(self.value[self.names.index(name)]) if name in self.names else 0.0

    @property
    def price(self) -> int:
        """For how many columns it counts: each reading left out is one that it explains."""
        count = len(self.slow) + int(np.sum(~self.kept))
        return count if self.cause is None else count + len(self.cause_terms) + self.cause.places


def beside_model(dataset: TumbleDataset, scale: float) -> Beside:
    """Return the encoder's harmonics and the mountings for a scale factor in V/g."""
    slope = scale * dataset.gravity_g * np.cos(dataset.theta_rad)
    columns: list[Array] = []
    if dataset.encoder_accuracy_rad > 0.0:
        alpha = dataset.encoder_rad
        columns = [slope * wave(n * alpha) for n in (1.0, 2.0) for wave in (np.cos, np.sin)]
    harmonics = len(columns)
    if dataset.mounting_rad > 0.0:
        mounting = dataset.mounting
        columns += [slope * (mounting == number) for number in range(int(mounting[-1]) + 1)]
    encoder = np.arange(len(columns)) < harmonics
    prior_rad = np.where(encoder, dataset.encoder_accuracy_rad, dataset.mounting_rad)
    shaped = np.column_stack(columns) if columns else np.empty((len(slope), 0))
    return Beside(shaped, prior_rad, encoder)


def slow_columns(dataset: TumbleDataset, order: int, model: Array) -> Terms:
    """Return drift to an order and the temperature terms that the model (n, k) does not hold.

    All but that of Ki have zero mean.
    """
    time_s = dataset.time_s
    columns: dict[str, Array] = {}
    if order:
        shapes = legendre_columns(time_s, order, time_s[0], time_s[-1])[:, 1:]
        columns = {f"{DRIFT}{n + 1}": own - own.mean() for n, own in enumerate(shapes.T)}
    if dataset.temperature_degC is not None:
        off_K = dataset.temperature_degC - float(np.mean(dataset.temperature_degC))
        columns |= {K0_T: off_K - off_K.mean(), KI_T: off_K * dataset.columns[:, 1]}
    if not columns:
        return {}
    own_part = independent_of(model, np.column_stack([*columns.values()]), OWN_PART)
    return {name: own for n, (name, own) in enumerate(columns.items()) if n in own_part}


def solve(
    dataset: TumbleDataset,
    kept: tuple[str, ...],
    settings: AnalysisSettings,
    beside: bool = True,
) -> Solution:
    """Solve for the kept coefficients, `k` of them; there must be more readings than that.

    What else may have moved the output is solved for where the information criterion asks for it;
    what noise may just imitate widens the uncertainties. Neither with nothing `beside` the model.
    """
    model = dataset.columns[:, [COEFFICIENTS.index(name) for name in kept]]
    plain = _solve(dataset, model, kept, settings, None)
    if not beside:
        return plain
    scale = plain.of("Ki")
    known = alternatives_of(dataset, scale)
    every_row = plain.kept | True

    def system(solution: Solution, inside: Mask, slow: bool) -> tuple[Array, Array, Mask]:
        parts = replace(solution.parts, model=model, inside=every_row)
        design, data = (parts if slow else replace(parts, slow={})).system(solution.sigma_V)
        counted = np.append(inside, np.ones(len(data) - len(inside), dtype=bool))
        return design * solution.sigma_V, data * solution.sigma_V, counted

    def rated(*which: Solution | Mask | bool) -> list[Score]:
        return scores_of(dataset, *system(*which), known, scale)  # type: ignore[arg-type]

    likely = [
        cause
        for inside in (plain.kept, every_row)[: 1 + int(not plain.kept.all())]
        for slow in (True, False)[: 1 + len(plain.slow)]
        for cause in worth_trying(rated(plain, inside, slow), MAX_TRIED)
    ]
    causes = {cause.columns.tobytes(): cause for cause in likely}.values()
    solutions = [plain, *(_solve(dataset, model, kept, settings, cause) for cause in causes)]
    squares = [solution.freedom * solution.sigma_V**2 for solution in solutions]
    values = information(squares, [solution.price for solution in solutions], len(model))
    best = solutions[int(np.argmin(values))]
    mean = averaged(best)
    u = np.sqrt(np.diag(mean.covariance))
    moved = farthest(values, [solution.value for solution in solutions], u)
    if best.cause is None:
        of_best = best, best.kept, True
        moved = moved + doubt(*system(*of_best), rated(*of_best), u)
    added = np.outer(moved, moved)
    return replace(mean, covariance=mean.covariance + added, noise=mean.noise + added)


def _solve(
    dataset: TumbleDataset,
    model: Array,
    kept: tuple[str, ...],
    settings: AnalysisSettings,
    cause: Alternative | None,
) -> Solution:
    """Solve with a cause beside the model, wild readings left out."""
    rows, width = model.shape
    if cause is not None:
        model = np.column_stack((model, cause.columns))
    order = max(0, min(settings.max_drift_order, (rows - width) // ROWS_A_TERM))
    slow, output = slow_columns(dataset, order, model), dataset.output_V
    full = np.column_stack((model, *slow.values()))
    inside = np.ones(rows, dtype=bool)
    first = np.linalg.lstsq(model, output, rcond=None)[0]
    for _ in range(2):
        beside = beside_model(dataset, float(first[kept.index("Ki")]) if "Ki" in kept else 0.0)
        own = beside.columns[:, list(independent_of(full, beside.columns, OWN_PART))]
        inside = keep_inliers(np.column_stack((full, own)), output, settings.outlier)
        first = np.linalg.lstsq(full[inside], output[inside], rcond=None)[0]
    if np.mean(~inside) > MAX_WILD:
        inside = np.ones(rows, dtype=bool)
    parts = _chosen(Parts(output, inside, model, slow, slow, beside))
    return weighted(parts, kept, cause)


def _models(parts: Parts) -> list[Parts]:
    """Return the parts with each choice of slow terms that may be."""
    models = candidates(parts.model, parts.usable, parts.inside)
    return [parts.with_slow(names) for names in models]


def _chosen(parts: Parts) -> Parts:
    """Return parts with the slow terms that the information criterion asks for.

    With these wild readings and causes are looked for; results are an average of all that may be.
    """
    subsets = _models(parts)
    squares = _squares_V2(subsets, weighted(parts, (), None).sigma_V)
    counts = [len(subset.slow) for subset in subsets]
    return subsets[choose_by_information(squares, counts, int(parts.inside.sum()))]


def _squares_V2(subsets: Sequence[Parts], sigma_V: float) -> list[float]:
    """Return what each leaves of the readings and of the priors, squared, with one noise."""
    squares = []
    for subset in subsets:
        whole, data = subset.system(sigma_V)
        scale = np.linalg.norm(whole, axis=0)
        rest = data - (whole / scale) @ np.linalg.lstsq(whole / scale, data, rcond=None)[0]
        squares.append(float(rest @ rest) * sigma_V**2)
    return squares


def averaged(best: Solution) -> Solution:
    """Return the average of the solutions with each choice of slow terms, as likely as each is.

    The covariance holds how far they lie apart. Those terms are named that the criterion asks for.
    """
    subsets = _models(best.parts)
    solutions = [weighted(subset, best.names, best.cause) for subset in subsets]
    largest = max(solutions, key=lambda solution: len(solution.slow))
    squares = _squares_V2(subsets, largest.sigma_V)
    names, count = [list(subset.slow) for subset in subsets], int(best.kept.sum())
    share = likelihoods(squares, names, count, round(largest.freedom))

    def mean(of: Callable[[Solution], Array | float]) -> Array:
        return np.asarray(np.tensordot(share, [of(solution) for solution in solutions], axes=1))

    by_prior = mean(lambda solution: solution.by_prior)
    noise = mean(lambda solution: solution.noise)
    noise = noise + apart(share, np.array([solution.value for solution in solutions]))
    slow = mean(lambda solution: np.array([solution.slow.get(name, 0.0) for name in best.slow]))
    return replace(
        best,
        value=mean(lambda solution: solution.value),
        covariance=noise + by_prior @ by_prior.T,
        noise=noise,
        by_prior=by_prior,
        freedom=float(mean(lambda solution: solution.freedom)),
        sigma_V=float(np.sqrt(mean(lambda solution: solution.sigma_V**2))),
        residual_V=mean(lambda solution: solution.residual_V),
        slow=dict(zip(best.slow, slow.tolist(), strict=True)),
        beside=mean(lambda solution: solution.beside),
        cause_terms=mean(lambda solution: solution.cause_terms),
    )


def weighted(parts: Parts, kept: tuple[str, ...], cause: Alternative | None) -> Solution:
    """Solve for the `kept` coefficients with the priors, the noise from the residuals."""
    width = len(kept)
    output, inside, columns = parts.output, parts.inside, parts.columns
    rows, count = int(inside.sum()), parts.design.shape[1]
    plain = columns[inside]
    unit = np.where((size := np.linalg.norm(plain, axis=0)) > 0.0, size, 1.0)
    start = np.linalg.lstsq(plain / unit, output[inside], rcond=None)
    rest = output[inside] - (plain / unit) @ start[0]
    sigma = float(np.sqrt(rest @ rest / max(rows - int(start[2]), 1)))
    for _ in range(ROUNDS):
        sigma = max(sigma, SMALLEST_NOISE_V)
        whole, data = parts.system(sigma)
        scale = np.linalg.norm(whole, axis=0)
        # Data over their standard deviation: each column of the solver is one of them.
        solver = np.linalg.pinv(whole / scale, rcond=1e-12) / scale[:, None]
        value = solver @ data
        residual = output - columns @ value
        freedom = rows - float(np.einsum("ij,ji->", whole[:rows], solver[:, :rows]))
        if freedom <= 0.0:
            break
        sigma = float(np.sqrt(residual[inside] @ residual[inside] / freedom))
    by_reading, by_prior = solver[:width, :rows], solver[:width, rows:]
    noise = by_reading @ by_reading.T
    posterior = np.einsum("ij,ij->i", solver[count:], solver[count:])
    wide = parts.model.shape[1]
    return Solution(
        parts=parts,
        names=kept,
        value=value[:width],
        covariance=noise + by_prior @ by_prior.T,
        noise=noise,
        by_prior=by_prior,
        freedom=freedom,
        sigma_V=sigma,
        residual_V=residual,
        slow=dict(zip(parts.slow, value[wide:count].tolist(), strict=True)),
        beside=value[count:],
        beside_u=np.sqrt(np.maximum(parts.beside.prior_rad**2 - posterior, 0.0)),
        cause=cause,
        cause_terms=value[width:wide],
    )
