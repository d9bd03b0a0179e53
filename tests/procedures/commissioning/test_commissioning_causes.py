"""Causes as far as numbers decide them, without a bench."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from procedures.commissioning.causes import coil_causes
from procedures.commissioning.coils import Measured

HEALTHY = Measured(
    response=np.eye(3),
    response_u=np.full((3, 3), 0.003),
    constants_mT_per_A=np.array([0.3, 0.333, 0.375]),
    after_off_mT=np.zeros((3, 3)),
    after_off_u_mT=np.full((3, 3), 1e-4),
    ambient_mT=np.array([0.02, 0.0, -0.04]),
    expected_mT=None,
    ambient_u_mT=0.001,
)


def codes(measured: Measured) -> list[str]:
    return [flag.code for flag in coil_causes(measured)]


def test_a_healthy_bench_has_no_cause() -> None:
    assert codes(HEALTHY) == []


def test_a_field_that_stays_when_the_output_is_off_is_named() -> None:
    left = np.zeros((3, 3))
    left[1, 1] = 0.2
    found = coil_causes(replace(HEALTHY, after_off_mT=left))
    assert [(one.code, one.axis) for one in found] == [("output-stays-on", "y")]


def test_a_coil_without_any_field_is_named() -> None:
    assert codes(replace(HEALTHY, response=np.diag([1.0, 0.0, 1.0]))) == ["coil-without-field"]


def test_exchanged_axes_of_coils_with_one_constant_are_not_decided() -> None:
    exchanged = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    same = replace(HEALTHY, constants_mT_per_A=np.full(3, 0.3))
    assert codes(replace(same, response=exchanged)) == ["axes-exchanged"]
    assert codes(replace(HEALTHY, response=exchanged)) == ["probe-axes-swapped"]


def test_two_coils_on_one_axis_mean_a_probe_that_stands_askew() -> None:
    askew = np.array([[1.0, 0.8, 0.0], [0.1, 0.6, 0.0], [0.0, 0.0, 1.0]])
    assert codes(replace(HEALTHY, response=askew)) == ["probe-askew"]


def test_an_ambient_field_within_its_uncertainty_decides_no_sign() -> None:
    turned = replace(HEALTHY, response=np.diag([1.0, -1.0, 1.0]))
    near_zero = replace(turned, expected_mT=np.array([0.02, 0.001, -0.04]))
    assert codes(near_zero) == ["field-reversed"]


def test_a_constant_within_its_uncertainty_is_not_called_off() -> None:
    off = replace(HEALTHY, response=np.diag([1.03, 1.0, 1.0]))
    assert codes(off) == ["coil-constant-off"]
    assert codes(replace(off, response_u=np.full((3, 3), 0.02))) == []


KNOWN = replace(HEALTHY, expected_mT=np.array([0.021, 0.004, -0.043]))


def test_a_coil_and_its_probe_axis_that_are_both_reversed_are_named_by_the_ambient_field() -> None:
    mirrored = replace(KNOWN, ambient_mT=np.array([0.02, 0.004, 0.04]))
    found = {(one.code, one.axis) for one in coil_causes(mirrored)}
    assert found == {("probe-axis-reversed", "z"), ("coil-polarity-reversed", "z")}


def test_an_ambient_field_that_is_not_the_stated_one_is_named() -> None:
    assert codes(KNOWN) == []
    assert codes(replace(KNOWN, ambient_mT=np.array([0.035, 0.004, -0.043]))) == [
        "ambient-otherwise"
    ]
    assert codes(replace(HEALTHY, ambient_mT=np.array([0.02, 0.0, 2.0]))) == ["ambient-otherwise"]


def test_coils_that_are_all_off_alike_are_the_gaussmeters() -> None:
    alike = np.diag([1.0277, 1.0315, 1.0283])
    assert codes(replace(HEALTHY, response=alike)) == ["field-scale-off"]
    apart = np.diag([1.0277, 1.0515, 1.0283])
    assert codes(replace(HEALTHY, response=apart)) == ["field-scale-off", "coil-constant-off"]
    none = np.diag([1.03, 1.05, 0.96])
    assert codes(replace(HEALTHY, response=none)) == ["coil-constant-off"] * 3


def test_where_two_sets_of_causes_fit_alike_both_are_named() -> None:
    two = np.diag([1.04, 1.041, 1.0])
    assert codes(replace(HEALTHY, response=two)) == [
        "coil-constant-off",
        "coil-constant-off",
        "field-scale-undecided",
    ]


def wired(coil: Sequence[int], along: Sequence[int], scale: Sequence[float]) -> Measured:
    """Return what is measured where supplies drive other coils and the probe's axes are moved."""
    constants = HEALTHY.constants_mT_per_A
    response = np.zeros((3, 3))
    for supply, of in enumerate(coil):
        axis = list(along).index(of)
        response[axis, supply] = constants[of] * scale[of] / constants[supply]
    assert KNOWN.expected_mT is not None
    return replace(KNOWN, response=response, ambient_mT=KNOWN.expected_mT[list(along)])


@pytest.mark.parametrize("along", list(permutations(range(3))), ids=str)
@pytest.mark.parametrize("coil", list(permutations(range(3))), ids=str)
def test_swapped_coils_beside_a_swapped_probe_are_both_named(
    coil: tuple[int, ...], along: tuple[int, ...]
) -> None:
    expected = {
        *({"coils-swapped"} if coil != (0, 1, 2) else ()),
        *({"probe-axes-swapped"} if along != (0, 1, 2) else ()),
    }
    assert set(codes(wired(coil, along, (1.0, 1.0, 1.0)))) == expected


def test_a_swap_hides_no_constant_and_no_scale() -> None:
    assert codes(wired((1, 0, 2), (0, 1, 2), (1.0, 0.96, 1.0))) == [
        "coils-swapped",
        "coil-constant-off",
    ]
    assert codes(wired((0, 1, 2), (0, 2, 1), (1.04, 1.04, 1.04))) == [
        "probe-axes-swapped",
        "field-scale-off",
    ]


def test_a_coil_leans_by_its_own_field_whatever_constant_is_stated() -> None:
    upright, leaning = np.array([0.008, 1.0, 0.001]), np.array([0.1, 1.0, 0.0])
    for scale in (0.2, 10.0):
        stated = replace(HEALTHY, response_u=np.full((3, 3), 0.003 * scale))
        response = np.eye(3)
        response[:, 1] = scale * upright
        assert codes(replace(stated, response=response)) == ["coil-constant-off"]
        response[:, 1] = scale * leaning
        assert codes(replace(stated, response=response)) == ["coil-constant-off", "coil-leans"]


def test_the_sign_of_a_coil_is_decided_with_the_axes_of_the_probe_swapped() -> None:
    exchanged = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    swapped = replace(KNOWN, response=exchanged, ambient_mT=np.array([0.004, 0.021, -0.043]))
    found = {(one.code, one.axis) for one in coil_causes(swapped)}
    assert found == {("probe-axes-swapped", None), ("coil-polarity-reversed", "x")}
