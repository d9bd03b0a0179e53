"""All readings in one weighted least-squares solution, with priors on encoder and mountings."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from procedures.estimation.orthogonal import (
    choose_by_information,
    independent_of,
    keep_inliers,
    thin_qr,
)
from procedures.estimation.sine import legendre_columns

from .dataset import AnalysisSettings, Mask, TumbleDataset
from .model import COEFFICIENTS, Array

ROUNDS = 8
OWN_PART = 1e-3
"""A slow term is tried where more than this part of its column is its own."""
ROWS_A_TERM = 6
STEP_GAIN = 30.0
"""What a step must lower -2 ln L by, searched for at every reading."""
FEWEST_BESIDE_STEP = 3
SMALLEST_NOISE_V = 1e-12
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
    much each coefficient takes of one standard deviation of each prior. `beside` (m,) are the
    solved encoder harmonics and mountings in rad, `beside_u` their standard deviation under the
    priors. `step_at` is the reading before which the output steps, by `step_V`.
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
    slow_V: Array
    beside: Array
    beside_u: Array
    priors: Beside
    step_at: int | None = None
    step_V: float = 0.0


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


def solve(dataset: TumbleDataset, kept: tuple[str, ...], settings: AnalysisSettings) -> Solution:
    """Solve for the kept coefficients, `k` of them; there must be more readings than that."""
    model = dataset.columns[:, [COEFFICIENTS.index(name) for name in kept]]
    output = dataset.output_V
    rows, width = model.shape
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
    step_at = _step(np.column_stack((full, beside.columns[:, list(own)])), output, inside)
    if step_at is not None:
        after = (np.arange(rows) >= step_at).astype(np.float64)
        after -= after.mean()
        # A drift explains part of a step: what lies outside is judged with both.
        inside = keep_inliers(np.column_stack((full, after)), output, settings.outlier)
        model = np.column_stack((model, after))
    if np.mean(~inside) > MAX_WILD:
        inside = np.ones(rows, dtype=bool)
    chosen = _choose(model, slow, names, beside, output, inside)
    names, slow = _taken(names, slow, chosen)
    return weighted(model, slow, names, beside, output, inside, width, step_at)


def _taken(
    names: tuple[str, ...], columns: Array, indices: tuple[int, ...]
) -> tuple[tuple[str, ...], Array]:
    return tuple(names[n] for n in indices), columns[:, list(indices)]


def _step(design: Array, output: Array, inside: Mask) -> int | None:
    """Return the reading before which a step explains most, None where noise explains it."""
    rows = np.flatnonzero(inside)
    if len(rows) < design.shape[1] + 2 * FEWEST_BESIDE_STEP + 1:
        return None
    basis = thin_qr(design[rows] / np.linalg.norm(design[rows], axis=0))[0]
    left = output[rows] - basis @ (basis.T @ output[rows])
    after = np.tri(len(rows))[:, FEWEST_BESIDE_STEP : len(rows) - FEWEST_BESIDE_STEP + 1]
    own = after - basis @ (basis.T @ after)
    size = np.einsum("ij,ij->j", own, own)
    gain = (left @ after) ** 2 / np.where(size > OWN_PART, size, np.inf)
    best = int(np.argmax(gain))
    whole = float(left @ left)
    free = len(rows) - design.shape[1] - 2
    rest = max(whole - float(gain[best]), SMALLEST_NOISE_V**2)
    if free < 1 or free * np.log(max(whole, SMALLEST_NOISE_V**2) / rest) < STEP_GAIN:
        return None
    return int(rows[best + FEWEST_BESIDE_STEP])


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
    step_at: int | None,
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
        slow_V=slow @ value[model.shape[1] : count],
        beside=value[count:],
        beside_u=np.sqrt(seen),
        priors=beside,
        step_at=step_at,
        step_V=float(value[width]) if step_at is not None else 0.0,
    )
