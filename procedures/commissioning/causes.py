"""The likely causes of what a commissioning measures, named only as far as the data decide.

A coil and the probe's axis have one sign together: which of them is reversed, only a field of
known direction decides, such as the ambient one from a map. Two exchanged supplies differ from two
exchanged axes of the probe by the constants of the coils, where these differ.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from station.findings import Flag

from .coils import AFTER_OFF, CONSTANT, CROSS_AXIS, Measured, across_of
from .part import COILS, COVERAGE

PROBE_SWAPPED = "probe-axes-swapped"
ALIKE = 0.0075
"""Relative. Three coils that are off by as much differ from the statements by one cause."""
AMBIENT_MT = 0.005
"""Beyond what map and compass leave open: iron, a magnet, a gaussmeter that was not zeroed."""
EARTH_MT = 0.1
"""The earth's field is 0.02 mT to 0.07 mT."""
MIN_SHARE = 0.1
"""Of the commanded field: a coil that makes less on every axis is not connected."""


def coil_causes(data: Measured) -> list[Flag]:
    """Return a flag for each cause."""
    flags = list(_outputs_on(data))
    largest = np.abs(data.response).max(axis=0)
    dead = [coil for coil, share in zip(COILS, largest, strict=True) if share < MIN_SHARE]
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
    probe_swapped = any(flag.code == PROBE_SWAPPED for flag in flags)
    for k, axis in enumerate(seen_on):
        if not moved or data.response[axis, k] < 0.0:
            flags += _reversed(data, k, int(axis), k if probe_swapped else int(axis))
    if not moved:
        flags += [*_constants(data), *_leaning(data), *_ambient(data)]
    return flags


def _outputs_on(data: Measured) -> Iterator[Flag]:
    for coil, left_mT, u_mT in zip(COILS, data.after_off_mT, data.after_off_u_mT, strict=True):
        k = int(np.abs(left_mT).argmax())
        if abs(left_mT[k]) - COVERAGE * u_mT[k] > AFTER_OFF.limit:
            message = (
                f"With the output of coil {coil} switched off {left_mT[k]:.3g} mT stay on axis "
                f"{COILS[k]}: the output stays on. Switch the supply off by hand."
            )
            yield Flag("output-stays-on", message, coil)


def _exchanged(data: Measured, seen_on: NDArray[np.intp], moved: list[int]) -> Flag:
    """Return which was exchanged; both are named where the coil constants do not decide it."""
    measured = np.abs([data.response[seen_on[k], k] for k in moved])
    u = np.hypot([data.response_u[seen_on[k], k] for k in moved], CONSTANT.limit / np.sqrt(3.0))
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
    return Flag(PROBE_SWAPPED, message)


def _reversed(data: Measured, coil: int, axis: int, along: int) -> Iterator[Flag]:
    """Yield what is reversed; both are named where the ambient field does not decide it.

    The probe's `axis` sees the coil; it lies along the bench's axis `along`.
    """
    name, seen = COILS[coil], COILS[axis]
    negative = data.response[axis, coil] < 0.0
    expected = 0.0 if data.expected_mT is None else float(data.expected_mT[along])
    ambient = float(data.ambient_mT[axis])
    if min(abs(expected), abs(ambient)) < COVERAGE * data.ambient_u_mT:
        if negative:
            message = (
                f"The field of coil {name} is reversed: its cable's poles, or axis {seen} of the "
                "probe. State the ambient field in the plan, from a map, to decide which."
            )
            yield Flag("field-reversed", message, name)
        return
    mirrored = ambient * expected < 0.0
    if mirrored:
        message = f"Axis {seen} of the probe is reversed: it shows the ambient field reversed, too."
        yield Flag("probe-axis-reversed", message, seen)
    if negative != mirrored:
        message = f"The polarity of coil {name} is reversed: exchange the poles of its cable."
        yield Flag("coil-polarity-reversed", message, name)


def _ambient(data: Measured) -> Iterator[Flag]:
    """Yield that the ambient field is not the stated one, or none of the earth."""
    within_mT = AMBIENT_MT + COVERAGE * data.ambient_u_mT
    if data.expected_mT is not None:
        # An axis of the probe that is reversed is named as such.
        off_mT = np.abs(np.abs(data.ambient_mT) - np.abs(data.expected_mT))
        if off_mT.max() > within_mT:
            axis = COILS[int(off_mT.argmax())]
            message = (
                f"The ambient field along {axis} differs by {off_mT.max():.3g} mT from the stated "
                "one: look for iron and magnets, at the gaussmeter's zero, and at the map."
            )
            yield Flag("ambient-otherwise", message, axis)
    elif float(np.linalg.norm(data.ambient_mT)) > EARTH_MT:
        message = (
            f"The ambient field is {np.linalg.norm(data.ambient_mT):.3g} mT, more than the "
            "earth's: look for iron and magnets, and at the gaussmeter's zero."
        )
        yield Flag("ambient-otherwise", message)


def _constants(data: Measured) -> Iterator[Flag]:
    ratio = np.abs(np.diag(data.response))
    off_by = ratio - 1.0
    is_off = np.abs(off_by) - COVERAGE * np.diag(data.response_u) > CONSTANT.limit
    if is_off.all() and np.ptp(ratio) < ALIKE * ratio.mean():
        message = (
            f"All coils measure {100.0 * off_by.mean():+.3g} % off alike: rather the gaussmeter's "
            "gain or units than three coils. Compare it with another one; no constant is replaced."
        )
        yield Flag("field-scale-off", message)
        return
    for k, coil in enumerate(COILS):
        if is_off[k]:
            constant = float(ratio[k] * abs(data.constants_mT_per_A[k]))
            message = (
                f"The constant of coil {coil} is off by {100.0 * off_by[k]:.3g} %: it measures "
                f"{constant:.4g} mT/A. Compare settings.coil_constant with the coil."
            )
            yield Flag("coil-constant-off", message, coil)


def _leaning(data: Measured) -> Iterator[Flag]:
    for k, coil in enumerate(COILS):
        across, u = across_of(data.response, data.response_u, k)
        if across - COVERAGE * u > CROSS_AXIS.limit:
            message = f"Coil {coil} has {100.0 * across:.2g} % across its axis: coil or probe lean."
            yield Flag("coil-leans", message, coil)
