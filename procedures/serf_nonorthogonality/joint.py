"""All shots in one fit, for a polarisation that changes the frequency while it fades.

Shared are the polarisation at time zero, the relaxation and the broadening by spin exchange; each
shot has its own frequency in the end, and its own linear coefficients as in `tone`. How the
frequency falls depends on the angle between field and pump light, which the caller knows from the
angles solved so far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .shots import SlowingDown
from .spin_motion import clocks, decay_line
from .tone import NoTone, ToneFit, fit_tone
from .tone_search import beyond

Array = NDArray[np.float64]

SHARED = 3
MAX_ITERATIONS = 25
ENOUGH = 1e-9
SQUARES = (0.03, 0.08, 0.15, 0.25, 0.36, 0.5, 0.68, 0.85)
"""P² to begin with."""


@dataclass(frozen=True)
class Record:
    """A shot as the joint fit takes it: usable samples only, and the deviation of one, in V."""

    time_s: Array
    voltage_V: Array
    noise_V: float


@dataclass(frozen=True)
class JointFit:
    """What all shots say together.

    `omega_rad_per_s` (shots,) are the frequencies in the end, with their covariance; `square` is
    P² at time zero, `rate_per_s` R/q(0), `beta_s` the broadening over w². `shared_covariance` (3,
    3) is of these three, `residual_V` are in the records' order; `chi_square` with
    `degrees_of_freedom` is of all samples. `baseline_over_tone` (shots,) compares the amplitudes at
    time zero; `by_late_start` (shots,) are derivatives of the frequencies, in rad/s², by a time
    zero of the own record that came later than its time stamps say; `drift_per_s` (shots,) with its
    u is a steady drift of the frequency, relative, which nothing of the model follows;
    `decay_per_s` (shots,) with its u is how fast the tone of each shot fades by itself.
    """

    omega_rad_per_s: Array
    covariance: Array
    square: float
    rate_per_s: float
    beta_s: float
    shared_covariance: Array
    residual_V: tuple[Array, ...]
    baseline_over_tone: Array
    baseline_over_tone_u: Array
    by_late_start: Array
    drift_per_s: Array
    drift_u: Array
    decay_per_s: Array
    decay_u: Array
    chi_square: float
    degrees_of_freedom: int

    @property
    def polarisation(self) -> float:
        """The polarisation at time zero."""
        return float(np.sqrt(max(self.square, 0.0)))


class NoJointFit(ValueError):
    """The joint fit found no minimum."""


@dataclass(frozen=True)
class _Step:
    """The projected residuals and slopes of all shots at a place of the search."""

    cost: float
    normal: Array
    right: Array
    residual_V: tuple[Array, ...]
    of_shots: Array
    """Baseline over tone, its u, the frequency's derivative by a late start, a drift, its u, how
    much faster the tone fades than those of all, its u."""


def fit_jointly(
    records: Sequence[Record],
    spin: SlowingDown,
    along: Array,
    start: tuple[Array, Array],
    mains_Hz: float | None = None,
) -> JointFit:
    """Fit all records; `along` (shots,) squares of the cosine between field and pump light.

    `start` is (P², R/q(0), beta) and the frequencies (shots,). Raises NoJointFit.
    """
    shared, omega = start[0].copy(), start[1].copy()
    damping = 1e-4
    step = _evaluate(records, spin, along, shared, omega, mains_Hz)
    for _ in range(MAX_ITERATIONS):
        scale = np.sqrt(np.diag(step.normal))
        if not np.all(np.isfinite(scale)) or np.any(scale <= 0.0):
            raise NoJointFit("a parameter has no influence")
        small, right = step.normal / np.outer(scale, scale), step.right / scale
        for _ in range(10):
            move = np.linalg.solve(small + damping * np.eye(len(right)), right)
            new_shared = shared + (move / scale)[:SHARED]
            new_omega = omega + (move / scale)[SHARED:]
            if -0.2 < new_shared[0] < 0.999 and new_shared[1] > 0.0 and bool(np.all(new_omega > 0)):
                after = _evaluate(records, spin, along, new_shared, new_omega, mains_Hz)
                if after.cost <= step.cost:
                    break
            damping = max(8.0 * damping, 1e-6)
        else:
            break
        gained = step.cost - after.cost
        shared, omega, step = new_shared, new_omega, after
        damping *= 0.1
        if gained <= ENOUGH * max(step.cost, 1.0) or float(np.max(np.abs(move))) < 1e-3:
            break
    # What is eliminated of the shots' own parameters is in the inverse of the whole.
    scale = np.sqrt(np.diag(step.normal))
    inverse = np.linalg.inv(step.normal / np.outer(scale, scale)) / np.outer(scale, scale)
    samples = sum(len(record.time_s) for record in records)
    own = 4 + (2 if mains_Hz is not None else 0) + 1
    return JointFit(
        omega_rad_per_s=omega,
        covariance=inverse[SHARED:, SHARED:],
        square=float(shared[0]),
        rate_per_s=float(shared[1]),
        beta_s=float(shared[2]),
        shared_covariance=inverse[:SHARED, :SHARED],
        residual_V=step.residual_V,
        baseline_over_tone=step.of_shots[:, 0],
        baseline_over_tone_u=step.of_shots[:, 1],
        by_late_start=step.of_shots[:, 2],
        drift_per_s=step.of_shots[:, 3],
        drift_u=step.of_shots[:, 4],
        decay_per_s=shared[1] + shared[2] * omega**2 + step.of_shots[:, 5],
        decay_u=step.of_shots[:, 6],
        chi_square=step.cost,
        degrees_of_freedom=samples - own * len(records) - SHARED,
    )


def _evaluate(
    records: Sequence[Record],
    spin: SlowingDown,
    along: Array,
    shared: Array,
    omega: Array,
    mains_Hz: float | None,
) -> _Step:
    count = len(records)
    square, rate, beta = (float(value) for value in shared)
    broad = beta * omega**2
    nudge = np.array([1e-4, 1e-4 * rate, 1e-3 * rate])
    # One integration for the place itself and for a nudge of P², of R/q(0) and of Gamma_se.
    squares = np.repeat([square, square + nudge[0], square, square], count)
    rates = np.repeat([rate, rate, rate + nudge[1], rate], count)
    broads = np.concatenate([broad, broad, broad, broad + nudge[2]])
    times = [record.time_s for record in records]
    phases = clocks(times * 4, spin, squares, rates, broads, np.tile(along, 4))
    normal = np.zeros((SHARED + count, SHARED + count))
    right = np.zeros(SHARED + count)
    cost, residuals, of_shots = 0.0, [], []
    for k, record in enumerate(records):
        u = phases[k]
        by = [(phases[k + (n + 1) * count] - u) / nudge[n] for n in range(3)]
        t, w = record.time_s, float(omega[k])
        fade = np.exp(-rate * u - broad[k] * t)
        cosine, sine, base = fade * np.cos(w * u), fade * np.sin(w * u), np.exp(-rate * u)
        columns = [cosine, sine, base, np.ones_like(t)]
        if mains_Hz is not None:
            turn = 2.0 * np.pi * mains_Hz * t
            columns += [np.cos(turn), np.sin(turn)]
        design = np.column_stack(columns)
        basis, triangle = np.linalg.qr(design)
        y = record.voltage_V
        linear = np.linalg.solve(triangle, basis.T @ y)
        tone = linear[0] * cosine + linear[1] * sine
        turned = linear[1] * cosine - linear[0] * sine
        slow = linear[2] * base
        by_clock = w * turned - rate * (tone + slow)
        by_broad = by_clock * by[2] - t * tone
        slopes = np.column_stack(
            [
                by_clock * by[0],
                by_clock * by[1] - u * (tone + slow),
                w**2 * by_broad,
                u * turned + 2.0 * beta * w * by_broad,
                broad[k] * tone - by_clock * np.gradient(u, t),
                0.5 * w * t * u * turned,
                -t * tone,
            ]
        )
        slopes -= basis @ (basis.T @ slopes)
        late = float(slopes[:, 3] @ slopes[:, 4]) / float(slopes[:, 3] @ slopes[:, 3])
        residual = y - basis @ (basis.T @ y)
        own = slopes[:, [0, 1, 2, 3, 5]]
        drift = beyond(own.T @ own, own.T @ residual, record.noise_V)
        own = slopes[:, [3, 6]]
        faster = beyond(own.T @ own, own.T @ residual, record.noise_V)
        slopes = slopes[:, :4]
        weight = record.noise_V**-2
        places = np.array([0, 1, 2, SHARED + k])
        normal[np.ix_(places, places)] += weight * (slopes.T @ slopes)
        right[places] += weight * (slopes.T @ residual)
        cost += weight * float(residual @ residual)
        residuals.append(residual)
        size = np.hypot(linear[0], linear[1])
        last = np.linalg.solve(triangle.T, np.eye(len(linear))[2])
        of_shots.append(
            (linear[2] / size, record.noise_V * np.linalg.norm(last) / size, late, *drift, *faster)
        )
    return _Step(cost, normal, right, tuple(residuals), np.array(of_shots))


def joint_start(
    records: Sequence[Record],
    spin: SlowingDown,
    along: Array,
    fits: Sequence[ToneFit],
    mains_Hz: float | None,
) -> tuple[Array, Array]:
    """Return where the joint fit begins: (P², R/q(0), beta) and the frequencies.

    In the time of the right clock each shot is a tone of one frequency. The clock of each P² of a
    grid is tried on the shot with the most signal; then all shots are fitted in the time of the
    best. Raises NoJointFit.
    """
    strongest = int(np.argmax([fit.signal_to_noise for fit in fits]))
    rate = float(np.median([fit.decay_per_s for fit in fits])) * 0.85
    best: tuple[float, float, ToneFit] | None = None
    for square in SQUARES:
        minimum = _in_its_time(
            records[strongest], spin, square, rate, float(along[strongest]), mains_Hz
        )
        if minimum is not None and (best is None or minimum.noise_V < best[0]):
            best = (minimum.noise_V, square, minimum)
    if best is None:
        raise NoJointFit("no polarisation explains the strongest shot")
    _, square, strongest_fit = best
    rate = 0.9 * strongest_fit.decay_per_s
    slower = strongest_fit.omega_rad_per_s / fits[strongest].omega_rad_per_s
    omega, decay = [], []
    for k, record in enumerate(records):
        near = slower * fits[k].omega_rad_per_s, strongest_fit.decay_per_s
        minimum = _in_its_time(record, spin, square, rate, float(along[k]), mains_Hz, near)
        if minimum is None:
            raise NoJointFit(f"shot {k + 1} is no tone in the time of its polarisation")
        omega.append(minimum.omega_rad_per_s)
        decay.append(minimum.decay_per_s)
    frequencies = np.array(omega)
    line = decay_line(frequencies, np.array(decay), np.full(len(decay), 0.01 * rate))
    return np.array([square, max(line.rate_per_s, 1e-3), line.beta_s]), frequencies


def _in_its_time(
    record: Record,
    spin: SlowingDown,
    square: float,
    rate: float,
    along: float,
    mains_Hz: float | None,
    near: tuple[float, float] | None = None,
) -> ToneFit | None:
    ones = np.ones(1)
    (u,) = clocks(
        [record.time_s], spin, square * ones, rate * ones, 0.1 * rate * ones, along * ones
    )
    try:
        return fit_tone(u, record.voltage_V, mains_Hz=mains_Hz, start=near)
    except NoTone:
        return None
