"""The likely cause of what a commissioning measures, named only as far as the data decide.

A coil and the probe's axis have one sign together: which of them is reversed, only a field of
known direction decides, such as the ambient one from a map. Two exchanged supplies differ from two
exchanged axes of the probe by the constants of the coils, where these differ.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Flag

from .limits import COIL_CONSTANT, COVERAGE, CROSS_AXIS, FIELD_AFTER_OFF_MT, LEAST_SHARE
from .parameters import COILS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """What causes are found from; rows of (3, 3) are probe axes, columns coils.

    `response` is the field over that of the stated constant, `response_u` its combined standard
    uncertainty, `after_off_mT` (coil, axis) the field after the output went off less the ambient.
    """

    response: Array
    response_u: Array
    constants_mT_per_A: Array
    after_off_mT: Array
    after_off_u_mT: Array
    ambient_mT: Array
    expected_mT: Array | None
    ambient_u_mT: float


def causes_of(data: Measured) -> list[Flag]:
    """Return a flag for each cause."""
    flags = list(_outputs_on(data))
    largest = np.abs(data.response).max(axis=0)
    dead = [coil for coil, share in zip(COILS, largest, strict=True) if share < LEAST_SHARE]
    if dead:
        return flags + [
            Flag(
                "coil-without-field",
                f"Coil {coil} makes no field: its cable, its supply's output or the probe's place.",
                coil,
            )
            for coil in dead
        ]
    seen_on = np.abs(data.response).argmax(axis=0)
    if len(set(seen_on.tolist())) < len(COILS):
        where = ", ".join(f"{c} on {COILS[i]}" for c, i in zip(COILS, seen_on, strict=True))
        message = f"Several coils act on one axis of the probe ({where}): it stands askew."
        return [*flags, Flag("probe-askew", message)]
    moved = [k for k, axis in enumerate(seen_on) if axis != k]
    if moved:
        flags.append(_exchanged(data, seen_on, moved))
    for k, axis in enumerate(seen_on):
        if data.response[axis, k] < 0.0:
            flags.append(_reversed(data, k, int(axis)))
    if not moved:
        flags += [*_constants(data), *_leaning(data)]
    return flags


def _outputs_on(data: Measured) -> Iterator[Flag]:
    for coil, left_mT, u_mT in zip(COILS, data.after_off_mT, data.after_off_u_mT, strict=True):
        k = int(np.abs(left_mT).argmax())
        if abs(left_mT[k]) - COVERAGE * u_mT[k] > FIELD_AFTER_OFF_MT:
            message = (
                f"With the output of coil {coil} switched off {left_mT[k]:.3g} mT stay on axis "
                f"{COILS[k]}: the output stays on. Switch the supply off by hand."
            )
            yield Flag("output-stays-on", message, coil)


def _exchanged(data: Measured, seen_on: NDArray[np.intp], moved: list[int]) -> Flag:
    """Return which was exchanged; both are named where the coil constants do not decide it."""
    measured = np.abs([data.response[seen_on[k], k] for k in moved])
    u = np.hypot([data.response_u[seen_on[k], k] for k in moved], COIL_CONSTANT / np.sqrt(3.0))
    constants = data.constants_mT_per_A
    of_coils = np.abs([constants[seen_on[k]] / constants[k] for k in moved])
    misfit_of_coils = float(np.sum(((measured - of_coils) / u) ** 2))
    misfit_of_probe = float(np.sum(((measured - 1.0) / u) ** 2))
    names = " and ".join(COILS[k] for k in moved)
    if abs(misfit_of_coils - misfit_of_probe) < COVERAGE**2:
        message = (
            f"Fields of the coils {names} act on each other's axes: either the supplies' cables or "
            "the probe's axes are exchanged; the coil constants are too alike to decide which."
        )
        return Flag("axes-exchanged", message)
    if misfit_of_coils < misfit_of_probe:
        message = f"The coils {names} are swapped: exchange their cables at the supplies."
        return Flag("coils-swapped", message)
    message = f"The gaussmeter's axes {names} are swapped: look at its probe's mounting and cable."
    return Flag("probe-axes-swapped", message)


def _reversed(data: Measured, coil: int, axis: int) -> Flag:
    """Return which is reversed; both are named where the ambient field does not decide it."""
    name, seen = COILS[coil], COILS[axis]
    expected = None if data.expected_mT is None else float(data.expected_mT[axis])
    if expected is None or abs(expected) < COVERAGE * data.ambient_u_mT:
        message = (
            f"The field of coil {name} is reversed: its cable's poles, or axis {seen} of the "
            "probe. State the ambient field in the plan, from a map, to decide which."
        )
        return Flag("field-reversed", message, name)
    if data.ambient_mT[axis] * expected < 0.0:
        message = f"Axis {seen} of the probe is reversed: it shows the ambient field reversed, too."
        return Flag("probe-axis-reversed", message, seen)
    message = f"The polarity of coil {name} is reversed: exchange the poles of its cable."
    return Flag("coil-polarity-reversed", message, name)


def _constants(data: Measured) -> Iterator[Flag]:
    for k, coil in enumerate(COILS):
        off_by = abs(float(data.response[k, k])) - 1.0
        if abs(off_by) - COVERAGE * float(data.response_u[k, k]) > COIL_CONSTANT:
            constant = abs(float(data.response[k, k] * data.constants_mT_per_A[k]))
            message = (
                f"The constant of coil {coil} is off by {100.0 * off_by:.2g} %: it measures "
                f"{constant:.4g} mT/A. Compare settings.coil_constant with the coil."
            )
            yield Flag("coil-constant-off", message, coil)


def _leaning(data: Measured) -> Iterator[Flag]:
    for k, coil in enumerate(COILS):
        others = [i for i in range(len(COILS)) if i != k]
        across = float(np.hypot(*data.response[others, k]))
        u = float(np.hypot(*data.response_u[others, k]))
        if across - COVERAGE * u > CROSS_AXIS:
            message = f"Coil {coil} has {100.0 * across:.2g} % across its axis: coil or probe lean."
            yield Flag("coil-leans", message, coil)
