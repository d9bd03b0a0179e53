"""Where coils, probe and device are, as a bench file states it; what cannot be is refused."""

from __future__ import annotations

import pytest
from test_bench import GOOD, bench_from, faults_of

GEOMETRY = """\
coil_geometry:
  three_axis:
    pairs:
      x: {radius: 300 mm, radius_uncertainty: 1 mm, spacing: 301 mm, spacing_uncertainty: 0.5 mm}
      y: {radius: 270 mm, radius_uncertainty: 1 mm, spacing: 270 mm, spacing_uncertainty: 0.5 mm}
      z: {radius: 240 mm, radius_uncertainty: 1 mm, spacing: 240 mm, spacing_uncertainty: 0.5 mm}
    probe: {x: 20 mm, y: -15 mm, z: 30 mm, uncertainty: 1 mm}
    device: {x: 0 mm, y: 0 mm, z: 5 mm, uncertainty: 1 mm, box: {x: 60 mm, y: 60 mm, z: 60 mm}}
"""
BENCH = GOOD + GEOMETRY
PROBE = "{x: 20 mm, y: -15 mm, z: 30 mm, uncertainty: 1 mm}"
BOX = "box: {x: 60 mm, y: 60 mm, z: 60 mm}"


def test_the_geometry_is_read_in_mm() -> None:
    geometry = bench_from(BENCH).coil_geometry
    assert geometry is not None and geometry.three_axis is not None and geometry.dc is None
    assert geometry.three_axis.probe.point_mm == (20.0, -15.0, 30.0)
    assert geometry.three_axis.device.size_mm == (60.0, 60.0, 60.0)
    assert geometry.three_axis.pairs["x"].spacing_mm == 301.0
    assert bench_from(GOOD).coil_geometry is None


@pytest.mark.parametrize(
    "old, new, says",
    [
        (PROBE, PROBE.replace("30 mm", "130 mm"), "probe: lies outside coil z"),
        (PROBE, PROBE.replace("1 mm", "0 mm"), "probe.uncertainty: must be above 0"),
        (PROBE, PROBE.replace(", uncertainty: 1 mm", ""), "probe.uncertainty: is missing"),
        ("z: 5 mm", "z: 95 mm", "device: reaches out of coil z"),
        (BOX, "sphere: 300 mm", "device: reaches out of coil y"),
        (BOX, f"sphere: 60 mm, {BOX}", "give the size of the device once: `box` or `sphere`"),
        (f", {BOX}", "", "give the size of the device once: `box` or `sphere`"),
        ("radius: 240 mm", "radius: 480 mm", "is 0.5 times the radius"),
        ("radius: 300 mm", "radius: 610 mm", "the radius, not the diameter"),
        (
            "spacing_uncertainty: 0.5 mm",
            "spacing_uncertainty: 9 mm",
            "% of the radius; at most 1 %",
        ),
        ("      z: {radius", "      w: {radius", "pairs.w"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(old: str, new: str, says: str) -> None:
    assert old in BENCH
    assert any(says in fault for fault in faults_of(BENCH.replace(old, new)))


def test_a_sphere_has_no_corner_that_reaches_out() -> None:
    geometry = bench_from(BENCH.replace(BOX, "sphere: 200 mm")).coil_geometry
    assert geometry is not None


def test_every_coil_has_its_pairs() -> None:
    lines = [line for line in BENCH.splitlines(keepends=True) if "z: {radius" not in line]
    assert any("must give the pairs x, y, z" in fault for fault in faults_of("".join(lines)))
