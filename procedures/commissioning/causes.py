"""The likely causes of what a commissioning measures, named only as far as the data decide.

A coil and the probe's axis have one sign together: which of them is reversed, only a field of
known direction decides, such as the ambient one from a map. Two exchanged supplies differ from two
exchanged axes of the probe by the constants of the coils, where these differ.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from station.findings import Flag

from .coils import AFTER_OFF, CONSTANT, CROSS_AXIS, Measured, across_of
from .part import COILS, COVERAGE

Array = NDArray[np.float64]
FAULT = 9.0
"""How much better, in chi-square, a bench with a fault must explain the record than one without."""
CONSTANT_OFF, AMBIENT_OTHERWISE = 1.5 * FAULT, 3.0 * FAULT
"""The same of a coil's constant, and of a component of the ambient field, that are what they are by
chance: that either is just as a swapped or a reversed axis would show it is hardly likely."""
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
    likely = wirings(data, seen_on)
    flags += [*_exchanged(likely), *_reversed(likely, seen_on)]
    if len({(wiring.coil, wiring.along) for wiring in likely}) > 1:
        return flags  # which coil a figure is of is not known
    own = {likely[0].coil[k]: (int(axis), k) for k, axis in enumerate(seen_on)}
    return [
        *flags,
        *_constants(data, own),
        *_leaning(data, own),
        *_ambient(data, likely[0].along),
    ]


@dataclass(frozen=True)
class Wiring:
    """One way in which supplies, coils and the probe may be connected.

    `coil`: the coil that each supply drives; `along`: the bench's axis along which each axis of the
    probe lies; `poles`, `sense`: 1, or -1 for a supply or an axis of the probe that is reversed.
    """

    coil: tuple[int, ...]
    along: tuple[int, ...]
    poles: tuple[int, ...]
    sense: tuple[int, ...]

    @property
    def faults(self) -> int:
        """How many cables and axes are not as they should be."""
        swaps = sum(len(COILS) - _cycles(order) for order in (self.coil, self.along))
        return swaps + (*self.poles, *self.sense).count(-1)


def wirings(data: Measured, seen_on: NDArray[np.intp]) -> list[Wiring]:
    """Return the likeliest wiring first, and those that fit nearly as well.

    All are tried that show supply k on axis `seen_on[k]` (3,) of the probe with its sign: 48. What
    tells them apart are the coil constants, the ambient field where it is known, and the number of
    faults that each takes; a constant that does not fit counts as much as another fault.
    """
    tried: list[tuple[float, int, Wiring]] = []
    axes = range(len(COILS))
    for coil in permutations(axes):
        along = tuple(coil[seen_on.tolist().index(axis)] for axis in axes)
        for sense in product((1, -1), repeat=len(COILS)):
            signs = np.sign([data.response[seen_on[k], k] for k in axes])
            poles = tuple(int(signs[k]) * sense[seen_on[k]] for k in axes)
            wiring = Wiring(coil, along, poles, sense)
            misfit = FAULT * wiring.faults + _misfit(data, seen_on, wiring)
            tried.append((misfit, len(tried), wiring))
    best = min(tried)[0]
    return [wiring for misfit, _, wiring in sorted(tried) if misfit < best + COVERAGE**2]


def _misfit(data: Measured, seen_on: NDArray[np.intp], wiring: Wiring) -> float:
    """Return chi-square of constants and ambient field; what does not fit is off by itself."""
    supplies = range(len(COILS))
    measured = np.abs([data.response[seen_on[k], k] for k in supplies])
    u = np.hypot([data.response_u[seen_on[k], k] for k in supplies], CONSTANT.limit / np.sqrt(3.0))
    off = np.log(measured / ratios_of(data, wiring)) / u
    misfit = np.minimum(np.square(off), CONSTANT_OFF).sum()
    if data.expected_mT is not None:
        expected_mT = np.array(wiring.sense) * data.expected_mT[list(wiring.along)]
        u_mT = np.hypot(data.ambient_u_mT, AMBIENT_MT / np.sqrt(3.0))
        off = (data.ambient_mT - expected_mT) / u_mT
        misfit += np.minimum(np.square(off), AMBIENT_OTHERWISE).sum()
    return float(misfit)


def ratios_of(data: Measured, wiring: Wiring) -> Array:
    """Return what each supply's field over its stated one would be by the constants, (3,)."""
    constants = np.abs(data.constants_mT_per_A)
    return np.asarray(constants[list(wiring.coil)] / constants)


def _cycles(order: tuple[int, ...]) -> int:
    left, cycles = set(range(len(order))), 0
    while left:
        place, cycles = left.pop(), cycles + 1
        while (place := order[place]) in left:
            left.remove(place)
    return cycles


def _moved(order: tuple[int, ...]) -> str:
    """Return the names of what is not in its own place."""
    return " and ".join(COILS[k] for k, other in enumerate(order) if k != other)


def _exchanged(likely: list[Wiring]) -> Iterator[Flag]:
    """Yield what was exchanged; both are named where the coil constants do not decide it."""
    coils, axes = (
        {_moved(order) for order in orders}
        for orders in ([wiring.coil for wiring in likely], [wiring.along for wiring in likely])
    )
    if len(coils) == 1 and len(axes) == 1:
        yield from (_coils_swapped(names) for names in coils if names)
        yield from (_probe_swapped(names) for names in axes if names)
        return
    names = max(coils | axes, key=len)
    message = (
        f"Fields of the coils {names} act on each other's axes: either the supplies' cables or "
        "the probe's axes are exchanged; the coil constants are too alike to decide which."
    )
    yield Flag("axes-exchanged", message)


def _coils_swapped(names: str) -> Flag:
    message = f"The coils {names} are swapped: exchange their cables at the supplies."
    return Flag("coils-swapped", message)


def _probe_swapped(names: str) -> Flag:
    message = f"The gaussmeter's axes {names} are swapped: look at its probe's mounting and cable."
    return Flag("probe-axes-swapped", message)


def _reversed(likely: list[Wiring], seen_on: NDArray[np.intp]) -> Iterator[Flag]:
    """Yield what is reversed; both are named where the ambient field does not decide it."""
    for supply, axis in enumerate(seen_on):
        name, seen = COILS[supply], COILS[axis]
        poles = {wiring.poles[supply] for wiring in likely}
        sense = {wiring.sense[axis] for wiring in likely}
        if len(poles) > 1 or len(sense) > 1:
            message = (
                f"The field of coil {name} is reversed: its cable's poles, or axis {seen} of the "
                "probe. State the ambient field in the plan, from a map, to decide which."
            )
            yield Flag("field-reversed", message, name)
            continue
        if sense == {-1}:
            message = (
                f"Axis {seen} of the probe is reversed: it shows the ambient field reversed, too."
            )
            yield Flag("probe-axis-reversed", message, seen)
        if poles == {-1}:
            message = f"The polarity of coil {name} is reversed: exchange the poles of its cable."
            yield Flag("coil-polarity-reversed", message, name)


def _outputs_on(data: Measured) -> Iterator[Flag]:
    for coil, left_mT, u_mT in zip(COILS, data.after_off_mT, data.after_off_u_mT, strict=True):
        k = int(np.abs(left_mT).argmax())
        if abs(left_mT[k]) - COVERAGE * u_mT[k] > AFTER_OFF.limit:
            message = (
                f"With the output of coil {coil} switched off {left_mT[k]:.3g} mT stay on axis "
                f"{COILS[k]}: the output stays on. Switch the supply off by hand."
            )
            yield Flag("output-stays-on", message, coil)


def _ambient(data: Measured, along: tuple[int, ...]) -> Iterator[Flag]:
    """Yield that the ambient field is not the stated one, or none of the earth."""
    within_mT = AMBIENT_MT + COVERAGE * data.ambient_u_mT
    if data.expected_mT is not None:
        # An axis of the probe that is reversed is named as such.
        off_mT = np.abs(np.abs(data.ambient_mT) - np.abs(data.expected_mT[list(along)]))
        if off_mT.max() > within_mT:
            axis = COILS[along[int(off_mT.argmax())]]
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


Own = Mapping[int, tuple[int, int]]
"""Of each coil, the axis of the probe that sees it and the supply that drives it."""


def _constants(data: Measured, own: Own) -> Iterator[Flag]:
    coils = range(len(COILS))
    constants = np.abs(data.constants_mT_per_A)
    stated = np.array([constants[k] / constants[own[k][1]] for k in coils])
    ratio = np.abs([data.response[own[k]] for k in coils]) / stated
    u = np.array([data.response_u[own[k]] for k in coils]) / stated
    scales = [1.0, *(float(np.mean(alike)) for alike in _alike(ratio))]
    off_by = [ratio / scale - 1.0 for scale in scales]
    names = [np.abs(off) - COVERAGE * u > CONSTANT.limit for off in off_by]
    if not names[0].any():
        return
    may_be = np.hypot(u, CONSTANT.limit / np.sqrt(3.0))
    # A scale is a cause, too; what no cause explains may be as far off as a constant may.
    misfits = [
        FAULT * (int(k > 0) + int(is_off.sum())) + float(np.square(off / may_be)[~is_off].sum())
        for k, (off, is_off) in enumerate(zip(off_by, names, strict=True))
    ]
    best = misfits.index(min(misfits))
    scale, is_off = scales[best], names[best]
    if best:
        message = (
            f"All coils measure {100.0 * (scale - 1.0):+.3g} % off alike: rather the gaussmeter's "
            "gain or units than three coils. Compare it with another one; no constant is replaced."
        )
        yield Flag("field-scale-off", message)
    for k, coil in enumerate(COILS):
        if is_off[k]:
            constant = float(ratio[k] / scale * constants[k])
            message = (
                f"The constant of coil {coil} is off by {100.0 * (ratio[k] / scale - 1.0):.3g} %: "
                f"it measures {constant:.4g} mT/A. Compare settings.coil_constant with the coil."
            )
            yield Flag("coil-constant-off", message, coil)
    others = [k for k in range(1, len(scales)) if misfits[k] < misfits[best] + COVERAGE**2]
    if best == 0 and others:
        scale = scales[min(others, key=misfits.__getitem__)]
        message = (
            f"The gaussmeter's gain may be {100.0 * (scale - 1.0):+.3g} % off instead, and the "
            "constant of another coil: compare the gaussmeter with another one."
        )
        yield Flag("field-scale-undecided", message)


def _alike(ratio: Array) -> Iterator[Array]:
    """Yield what two coils or three have in common, where they differ by less than one may."""
    for count in (3, 2):
        for coils in combinations(range(len(COILS)), count):
            if np.ptp(ratio[list(coils)]) < CONSTANT.limit:
                yield ratio[list(coils)]


def _leaning(data: Measured, own: Own) -> Iterator[Flag]:
    for k, coil in enumerate(COILS):
        across, u = across_of(data.response, data.response_u, *own[k])
        if across - COVERAGE * u > CROSS_AXIS.limit:
            message = f"Coil {coil} has {100.0 * across:.2g} % across its axis: coil or probe lean."
            yield Flag("coil-leans", message, coil)
