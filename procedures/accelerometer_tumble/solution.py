"""All readings in one weighted least-squares solution, with priors on encoder and mountings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from procedures.estimation.alternatives import Alternative, Score, doubt, farthest, worth_trying
from procedures.estimation.orthogonal import (
    choose_by_information,
    independent_of,
    information,
    keep_inliers,
)
from procedures.estimation.sine import legendre_columns

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
class Solution:
    """The kept coefficients (k,), in V and g, and what they rest on.

    `covariance` (k, k) is whole; `noise` (k, k) the readings' part of it; `by_prior` (k, m) how
    much each coefficient takes of one standard deviation of each prior. `slow_value` are the
    coefficients of drift and temperature, `beside` (m,) the solved encoder harmonics and mountings
    in rad, `beside_u` their standard deviation under the priors. `cause` is what else moved the
    output, with its coefficients `cause_terms`.
    """

    value: Array
    covariance: Array
    noise: Array
    by_prior: Array
    freedom: float
    sigma_V: float
    residual_V: Array
    kept: Mask
    slow_names: tuple[str, ...]
    slow: Array
    slow_value: Array
    slow_V: Array
    beside: Array
    beside_u: Array
    priors: Beside
    cause: Alternative | None
    cause_terms: Array

    @property
    def price(self) -> int:
        """For how many columns it counts: each reading left out is one that it explains."""
        count = len(self.slow_names) + int(np.sum(~self.kept))
        return count if self.cause is None else count + len(self.cause_terms) + self.cause.places

    @property
    def by_temperature(self) -> dict[str, float]:
        """What drift and temperature change, by name: K0_T in V/degC, Ki_T in V/g/degC."""
        return dict(zip(self.slow_names, self.slow_value.tolist(), strict=True))


def beside_model(dataset: TumbleDataset, scale: float) -> Beside:
    """Return the encoder's harmonics and the mountings for a scale factor in V/g."""
    alpha = dataset.encoder_rad
    slope = scale * dataset.gravity_g * np.cos(alpha + dataset.head_rad)
    columns: list[Array] = []
    if dataset.encoder_accuracy_rad > 0.0:
        columns = [slope * wave(n * alpha) for n in (1.0, 2.0) for wave in (np.cos, np.sin)]
    harmonics = len(columns)
    if dataset.mounting_rad > 0.0:
        mounting = dataset.mounting
        columns += [slope * (mounting == number) for number in range(int(mounting[-1]) + 1)]
    priors = [dataset.encoder_accuracy_rad] * harmonics
    priors += [dataset.mounting_rad] * (len(columns) - harmonics)
    shaped = np.column_stack(columns) if columns else np.empty((len(alpha), 0))
    return Beside(shaped, np.array(priors), np.arange(len(columns)) < harmonics)


def slow_columns(dataset: TumbleDataset, order: int) -> tuple[tuple[str, ...], Array]:
    """Return drift to an order and the temperature terms, each with zero mean, where separable."""
    time_s = dataset.time_s
    names = [f"drift {n}" for n in range(1, order + 1)]
    columns = [legendre_columns(time_s, order, time_s[0], time_s[-1])[:, 1:]] if order else []
    if dataset.temperature_degC is not None:
        off_K = dataset.temperature_degC - float(np.mean(dataset.temperature_degC))
        names += ["K0_T", "Ki_T"]
        columns += [off_K[:, None], (off_K * dataset.columns[:, 1])[:, None]]
    if not columns:
        return (), np.empty((len(dataset.time_s), 0))
    shaped = np.column_stack(columns)
    drift = [n for n, name in enumerate(names) if name != "Ki_T"]
    shaped[:, drift] -= shaped[:, drift].mean(axis=0)
    return tuple(names), shaped


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
    scale = float(plain.value[kept.index("Ki")]) if "Ki" in kept else 0.0
    known = alternatives_of(dataset, scale)
    candidates = {
        cause.columns.tobytes(): cause
        for inside in {mask.tobytes(): mask for mask in (plain.kept, plain.kept | True)}.values()
        for with_slow in (True, False)[: 1 + len(plain.slow_names)]
        for cause in worth_trying(
            _scores(dataset, model, plain, known, scale, inside, with_slow), MAX_TRIED
        )
    }
    solutions = [
        plain,
        *(_solve(dataset, model, kept, settings, cause) for cause in candidates.values()),
    ]
    squares = [solution.freedom * solution.sigma_V**2 for solution in solutions]
    prices = [solution.price for solution in solutions]
    values = information(squares, prices, len(model))
    best = solutions[int(np.argmin(values))]
    u = np.sqrt(np.diag(best.covariance))
    moved = farthest(values, [solution.value for solution in solutions], u)
    if best.cause is None:
        rated = _scores(dataset, model, best, known, scale, best.kept, True)
        design, data, inside = _known(dataset, model, best, scale, best.kept, True)
        moved = moved + doubt(design, data, inside, rated, u)
    added = np.outer(moved, moved)
    return replace(best, covariance=best.covariance + added, noise=best.noise + added)


def _known(
    dataset: TumbleDataset,
    model: Array,
    solution: Solution,
    scale: float,
    inside: Mask,
    with_slow: bool,
) -> tuple[Array, Array, Mask]:
    """Return design, output and which rows count, the last ones being the priors."""
    beside = beside_model(dataset, scale)
    columns = np.column_stack((model, solution.slow if with_slow else model[:, :0]))
    design, data = _augmented(
        columns, beside, dataset.output_V, np.ones_like(inside), solution.sigma_V
    )
    counted = np.append(inside, np.ones(len(data) - len(inside), dtype=bool))
    return design * solution.sigma_V, data * solution.sigma_V, counted


def _scores(
    dataset: TumbleDataset,
    model: Array,
    solution: Solution,
    known: list[Alternative],
    scale: float,
    inside: Mask,
    with_slow: bool,
) -> list[Score]:
    system = _known(dataset, model, solution, scale, inside, with_slow)
    return scores_of(dataset, *system, known, scale)


def _solve(
    dataset: TumbleDataset,
    model: Array,
    kept: tuple[str, ...],
    settings: AnalysisSettings,
    cause: Alternative | None,
) -> Solution:
    """Solve with a cause beside the model, wild readings left out."""
    output = dataset.output_V
    rows, width = model.shape
    if cause is not None:
        model = np.column_stack((model, cause.columns))
    order = max(0, min(settings.max_drift_order, (rows - width) // ROWS_A_TERM))
    names, slow = slow_columns(dataset, order)
    names, slow = _taken(names, slow, independent_of(model, slow, OWN_PART))
    first = np.linalg.lstsq(model, output, rcond=None)[0]
    inside = np.ones(rows, dtype=bool)
    for _ in range(2):
        scale = float(first[kept.index("Ki")]) if "Ki" in kept else 0.0
        beside = beside_model(dataset, scale)
        full = np.column_stack((model, slow))
        own = independent_of(full, beside.columns, OWN_PART)
        inside = keep_inliers(
            np.column_stack((full, beside.columns[:, list(own)])), output, settings.outlier
        )
        first = np.linalg.lstsq(full[inside], output[inside], rcond=None)[0]
    if np.mean(~inside) > MAX_WILD:
        inside = np.ones(rows, dtype=bool)
    chosen = _choose(model, slow, names, beside, output, inside)
    names, slow = _taken(names, slow, chosen)
    return weighted(model, slow, names, beside, output, inside, width, cause)


def _taken(
    names: tuple[str, ...], columns: Array, indices: tuple[int, ...]
) -> tuple[tuple[str, ...], Array]:
    return tuple(names[n] for n in indices), columns[:, list(indices)]


def _choose(
    model: Array,
    slow: Array,
    names: tuple[str, ...],
    beside: Beside,
    output: Array,
    inside: Mask,
) -> tuple[int, ...]:
    """Return the slow terms that the information criterion asks for: an order, K0_T, Ki_T."""
    drift = [n for n, name in enumerate(names) if name.startswith("drift")]
    warm = [n for n, name in enumerate(names) if not name.startswith("drift")]
    subsets = [
        (*drift[:order], *(n for n, use in zip(warm, used, strict=True) if use))
        for order in range(len(drift) + 1)
        for used in product((False, True), repeat=len(warm))
    ]
    full = weighted(model, slow, names, beside, output, inside, model.shape[1], None)
    squares = []
    for subset in subsets:
        design = np.column_stack((model, slow[:, list(subset)]))
        squares.append(_penalised(design, beside, output, inside, full.sigma_V))
    best = choose_by_information(squares, [len(subset) for subset in subsets], int(inside.sum()))
    return subsets[best]


def _penalised(design: Array, beside: Beside, output: Array, inside: Mask, sigma_V: float) -> float:
    """Return the sum of squares in V² of a solution, that of the priors in it."""
    whole, data = _augmented(design, beside, output, inside, sigma_V)
    scale = np.linalg.norm(whole, axis=0)
    solved = np.linalg.lstsq(whole / scale, data, rcond=None)[0]
    left = data - (whole / scale) @ solved
    return float(left @ left) * sigma_V**2


def _augmented(
    design: Array, beside: Beside, output: Array, inside: Mask, sigma_V: float
) -> tuple[Array, Array]:
    """Return readings over their noise, then one row a prior."""
    top = np.column_stack((design, beside.columns))[inside] / sigma_V
    priors = np.zeros((len(beside.prior_rad), top.shape[1]))
    if len(beside.prior_rad):
        priors[:, design.shape[1] :] = np.diag(1.0 / beside.prior_rad)
    data = np.concatenate((output[inside] / sigma_V, np.zeros(len(priors))))
    return np.vstack((top, priors)), data


def weighted(
    model: Array,
    slow: Array,
    names: tuple[str, ...],
    beside: Beside,
    output: Array,
    inside: Mask,
    width: int,
    cause: Alternative | None,
) -> Solution:
    """Solve with the priors, the noise from the residuals; the first `width` are coefficients."""
    design = np.column_stack((model, slow))
    rows = int(inside.sum())
    plain = np.column_stack((design, beside.columns))[inside]
    unit = np.where((size := np.linalg.norm(plain, axis=0)) > 0.0, size, 1.0)
    start = np.linalg.lstsq(plain / unit, output[inside], rcond=None)
    left = output[inside] - (plain / unit) @ start[0]
    sigma = float(np.sqrt(left @ left / max(rows - int(start[2]), 1)))
    for _ in range(ROUNDS):
        sigma = max(sigma, SMALLEST_NOISE_V)
        whole, data = _augmented(design, beside, output, inside, sigma)
        scale = np.linalg.norm(whole, axis=0)
        inverse = np.linalg.pinv(whole / scale, rcond=1e-12)
        value = (inverse @ data) / scale
        residual = output - np.column_stack((design, beside.columns)) @ value
        hat = float(np.einsum("ij,ji->", whole[:rows] / scale, inverse[:, :rows]))
        freedom = rows - hat
        if freedom <= 0.0:
            break
        sigma = float(np.sqrt(residual[inside] @ residual[inside] / freedom))
    # Data over their standard deviation: each column of the solver is one of them.
    solver = inverse / scale[:, None]
    by_reading, by_prior = solver[:width, :rows], solver[:width, rows:]
    noise = by_reading @ by_reading.T
    count = design.shape[1]
    posterior = np.einsum("ij,ij->i", solver[count:], solver[count:])
    seen = np.maximum(beside.prior_rad**2 - posterior, 0.0)
    return Solution(
        value=value[:width],
        covariance=noise + by_prior @ by_prior.T,
        noise=noise,
        by_prior=by_prior,
        freedom=freedom,
        sigma_V=sigma,
        residual_V=residual,
        kept=inside,
        slow_names=names,
        slow=slow,
        slow_value=value[model.shape[1] : count],
        slow_V=slow @ value[model.shape[1] : count],
        beside=value[count:],
        beside_u=np.sqrt(seen),
        priors=beside,
        cause=cause,
        cause_terms=value[width : model.shape[1]],
    )
