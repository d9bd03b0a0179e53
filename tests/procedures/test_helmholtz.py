"""The field of Helmholtz pairs, held against magpylib, and what it makes of that at a probe."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import magpylib
import numpy as np
import pytest
from numpy.typing import NDArray
from shipped import shipped_bench

from procedures.common.helmholtz import (
    FieldAtDevice,
    box_nodes,
    carried,
    pairs_field,
    sphere_nodes,
)
from procedures.common.homogeneity import Coil, at_device, table

COILS: tuple[Coil, ...] = ("three_axis", "dc")
PAIRS = {"x": (300.0, 303.0), "y": (270.0, 268.0), "z": (240.0, 241.0)}
ALONG = {"x": (90.0, (0, 1, 0)), "y": (-90.0, (1, 0, 0)), "z": (0.0, (0, 0, 1))}


def by_magpylib(axis: str, point_mm: NDArray[Any]) -> NDArray[Any]:
    """Return the field of a pair at points (n, 3) over that at its centre, by magpylib."""
    radius_mm, spacing_mm = PAIRS[axis]
    unit = np.eye(3)["xyz".index(axis)]
    total, centre = np.zeros(point_mm.shape), np.zeros(3)
    for side in (-0.5, 0.5):
        loop = magpylib.current.Circle(
            current=1.0, diameter=2e-3 * radius_mm, position=1e-3 * side * spacing_mm * unit
        )
        angle_deg, about = ALONG[axis]
        loop.rotate_from_angax(angle_deg, about, anchor=loop.position)
        total += loop.getB(1e-3 * point_mm)
        centre += loop.getB(np.zeros(3))
    return np.asarray(total / centre["xyz".index(axis)])


def device(coil: Coil = "three_axis") -> FieldAtDevice:
    at = at_device(shipped_bench(), coil)
    assert at is not None
    return at


def test_the_field_of_pairs_is_that_of_magpylib() -> None:
    points = np.random.default_rng(3).uniform(-100.0, 100.0, (50, 3))
    points[0], points[1] = 0.0, (0.0, 0.0, 40.0)
    ours = pairs_field(points, PAIRS)
    for k, axis in enumerate(PAIRS):
        assert np.abs(ours[..., k] - by_magpylib(axis, points)).max() < 1e-12


def test_the_mean_over_a_sphere_is_the_field_at_its_middle() -> None:
    """Each component is harmonic: the theorem of the mean holds exactly."""
    places, weights = sphere_nodes(100.0)
    middle = np.array([5.0, -10.0, 20.0])
    mean = np.einsum("n,nij->ij", weights, pairs_field(places + middle, PAIRS))
    assert np.abs(mean - pairs_field(middle, PAIRS)).max() < 1e-7


def test_the_mean_over_a_box_is_that_of_many_places() -> None:
    edges = np.array([120.0, 60.0, 80.0])
    places, weights = box_nodes(edges)
    mean = np.einsum("n,nij->ij", weights, pairs_field(places, PAIRS))
    drawn = np.random.default_rng(1).uniform(-0.5, 0.5, (200_000, 3)) * edges
    many = pairs_field(drawn, PAIRS)
    error = many.std(axis=0) / np.sqrt(len(drawn))
    assert weights.sum() == pytest.approx(1.0)
    assert np.all(np.abs(mean - many.mean(axis=0)) < 4.0 * error)


def test_the_matrix_takes_what_the_probe_reads_to_the_device() -> None:
    at = device()
    probe, inside = at.fields(at.stated_mm)
    mean = np.einsum("n,nij->ij", at.weights, inside)
    driven = np.random.default_rng(2).normal(size=(20, 3))
    assert carried(driven @ probe.T, at.matrix) == pytest.approx(driven @ mean.T, abs=1e-12)


def test_a_component_that_was_never_seen_stays_zero() -> None:
    field = np.array([[0.3, 0.0, 0.0], [-0.2, 0.0, 0.0]])
    moved = carried(field, device().matrix)
    assert not moved[:, 1:].any()
    assert moved[:, 0] == pytest.approx(device().ratio("x")[0] * field[:, 0])


@pytest.mark.parametrize("coil", COILS)
def test_the_ratio_is_as_uncertain_as_draws_of_its_inputs(coil: Coil) -> None:
    """Means over places and geometry; the place in a device is left aside, as it moves no mean."""
    at, random = device(coil), np.random.default_rng(5)
    draws = []
    for _ in range(1500):
        lengths = {name: random.normal(value, u) for name, (value, u) in at.lengths_mm.items()}
        draws.append(np.diag(at.matrix_of(lengths)))
    for k, axis in enumerate(at.coils):
        value, u = at.ratio(axis)
        own = (u**2 - (value * at.spread[axis]) ** 2) ** 0.5
        assert np.std(draws, axis=0)[k] == pytest.approx(own, rel=0.08)


@pytest.mark.parametrize("coil", COILS)
def test_the_simulated_truth_lies_within_the_stated_uncertainty(coil: Coil) -> None:
    """The shipped geometry is not the truth of the simulated world, and agrees with it."""
    at, world = device(coil), shipped_bench().simulation
    assert world is not None
    place = world["probe_position"] if coil == "three_axis" else world["dc_coil"]["probe_position"]
    true = {f"probe_{axis}_mm": number(place[axis]) for axis in "xyz"}
    true |= {f"device_{axis}_mm": 0.0 for axis in "xyz"}
    for axis in at.coils:
        own = world["coils"][axis] if coil == "three_axis" else world["dc_coil"]
        radius = number(own["radius"])
        true[f"coil_{axis}_radius_mm"] = radius
        true[f"coil_{axis}_spacing_mm"] = radius * (1.0 + number(own["spacing_error"]) / 100.0)
    for name, (value, u) in at.lengths_mm.items():
        assert 0.0 < abs(value - true[name]) < 2.0 * u, name
    point = replace(at, nodes_mm=np.zeros((1, 3)), weights=np.ones(1))
    for k, axis in enumerate(at.coils):
        value, u = at.ratio(axis)
        off = value - point.matrix_of(true)[k, k]
        assert abs(off) < 2.0 * u
        assert abs(off) < abs(point.matrix_of(true)[k, k] - 1.0), "no better than none"


def number(text: str) -> float:
    return float(text.split()[0])


def test_the_report_says_what_the_correction_is_made_of() -> None:
    shown = table(device())
    assert [row[0] for row in shown.rows] == ["x", "y", "z"]
    assert all(len(row) == len(shown.columns) for row in shown.rows)
