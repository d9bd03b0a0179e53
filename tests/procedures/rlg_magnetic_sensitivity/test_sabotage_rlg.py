"""Faults planted in laser-gyro datasets: none passes in silence, and clean ones raise no flag."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rlg_worlds import FINE_COUNTS, ONE, THREE, Spoil, World, made
from sabotage import Made, analysed, error_u, judged
from sabotage_rlg import CLEAN, FAULTS, USUAL_FLAGS, clipped, stepped

from procedures.estimation.frozen import repeated_rows, stuck_rows
from procedures.estimation.recorder import largest_jump, piled_up, resolution
from station.cli.analysing import analyse_dataset


def seen(one: Made) -> tuple[float, dict[str, dict[str, object]]]:
    """Return the largest error in u, and the flags by code."""
    document = analysed(one)
    return error_u(one, document["results"]), {flag["code"]: flag for flag in document["flags"]}


@pytest.mark.parametrize(
    ("world", "spoil"),
    [(ONE, clipped(0.0, 0.67)), (FINE_COUNTS, clipped(0.0, 0.7)), (THREE, clipped(0.3, 1.0))],
)
def test_saturated_output(world: World, spoil: Spoil) -> None:
    error, flags = seen(made(world, 5, spoil))
    assert 0.2 < flags["saturated"]["part"] < 0.5  # type: ignore[operator]
    assert "range" in str(flags["saturated"]["message"])
    assert error < 3.0
    assert "saturated" not in seen(made(world, 5))[1]


def test_a_saturated_field() -> None:
    def clip(table, _):
        return replace(table, field_mT=np.clip(table.field_mT, -1.0, 1.0))

    error, flags = seen(made(ONE, 5, clip))
    assert flags["saturated"]["channel"] == "field on IA"
    assert error < 3.0


def test_output_coarser_than_its_noise() -> None:
    for step in (0.4, 0.5, 1.0, 2.0):
        error, flags = seen(made(ONE, 6, stepped(step)))
        assert flags["coarse-output"]["step_deg_per_h"] == pytest.approx(step)
        assert error < 3.0  # none where nothing is known
    assert "not-identifiable" in flags
    # Half a step of noise makes rounding harmless, and counts of an angle lose nothing.
    for fine in (made(ONE, 6, stepped(0.3)), made(replace(FINE_COUNTS, pulse_arcsec=0.3), 6)):
        error, flags = seen(fine)
        assert "coarse-output" not in flags
        assert error < 3.5


@pytest.mark.parametrize(
    ("hertz", "collides"),
    [
        ((0.05, 0.1, 0.17), {"NA": "2 IA", "IA": "NA - IA"}),
        ((0.05, 0.08, 0.13), {"LA": "IA + NA", "NA": "LA - IA", "IA": "LA - NA"}),
        ((0.06, 0.1, 0.14), {"IA": "2 NA - LA", "NA": "IA", "LA": "2 NA - IA"}),
        ((0.07, 0.11, 0.17), {}),
    ],
)
def test_lines_that_collide(hertz: tuple[float, ...], collides: dict[str, str]) -> None:
    drive = {axis: (f, 1.0) for axis, f in zip(THREE.drive, hertz, strict=True)}
    flags = analysed(made(replace(THREE, drive=drive, bend=1.0), 7))["flags"]
    told = {f["axis"]: f for f in flags if f["code"] == "lines-collide"}
    assert set(told) == set(collides)
    for axis, product in collides.items():
        assert any(product in one for one in told[axis]["products"])


@pytest.mark.parametrize(
    ("world", "said"),
    [
        (replace(ONE, drive={"IA": (0.25, 1.2)}), "frequency of 0.25 Hz"),
        (replace(ONE, drive={"IA": (0.04, 1.2)}), "frequency of 0.04 Hz"),
        (replace(ONE, drive={"IA": (0.08, 2.5)}), "amplitude of 2.5 mT"),
        (replace(ONE, drive={"IA": (0.08, 0.05)}), "amplitude of 0.05 mT"),
        (replace(ONE, samples=750), "cycles"),
    ],
)
def test_outside_published_range(world: World, said: str) -> None:
    flag = seen(made(world, 8))[1]["outside-published-range"]
    assert flag["axis"] == "IA"
    assert said in str(flag["message"])
    assert "outside-published-range" not in seen(made(replace(ONE, samples=1250), 8))[1]


QUICK = (
    "coil at 0.8 for the last half",
    "field goes on where the coil is off",
    "field's columns exchanged",
    "output stuck for a third",
    "output in arcsec a minute",
    "output's clock off by 0.6 %",
    "answer with a cubic term",
    "output's gain halves",
    "rows of the output lost, closed up",
    "a block of the output copied",
    "interval said to be 0.2 s",
    "drive said to be on NA",
)


@pytest.mark.parametrize("name", QUICK)
def test_a_planted_fault_is_named(name: str) -> None:
    (fault,) = [one for one in FAULTS if one.name == name]
    for seed in (3, 4):
        said = judged(fault, seed)
        assert said["named"], said


def test_clean_datasets_raise_no_flag() -> None:
    assert len(FAULTS) >= 40
    for seed, make in enumerate(CLEAN):
        error, flags = seen(make(100 + seed))
        assert not set(flags) - USUAL_FLAGS
        assert error < 4.0


def test_a_condition_that_the_data_deny_is_named(tmp_path: Path) -> None:
    made(FINE_COUNTS, 1, pulse_weight="0.2 arcsec").write(tmp_path)
    flags = {flag.code: flag for flag in analyse_dataset(tmp_path, None).flags}
    assert flags["contradicts-statement"].details["statement"] == "pulse_weight"


def test_what_a_recorder_did_is_found_and_noise_alone_is_not() -> None:
    for seed in range(40):
        generator = np.random.default_rng(seed)
        step = 10.0 ** -int(generator.integers(1, 5))
        noise = step * np.round(0.2 * generator.standard_normal(2000) / step)
        assert resolution(noise) == pytest.approx(step)
        assert piled_up(noise, step, 0.2, np.zeros(2000)) == (0.0, 0.0)
        assert stuck_rows(noise, step) is None
        assert repeated_rows(noise, step) is None
        assert largest_jump(noise, 100.0, 0.0) is None
    noise = np.round(0.2 * np.random.default_rng(1).standard_normal(2000), 4)
    held, again, up = noise.copy(), noise.copy(), noise.copy()
    held[500:600] = held[500]
    again[900:1100] = again[300:500]
    up[1200:] += 0.4
    assert stuck_rows(held, 1e-4) == (500, 599)
    assert repeated_rows(again, 1e-4) == (300, 900, 200)
    assert largest_jump(up, 100.0, 0.0) == (
        pytest.approx(1200, abs=30),
        pytest.approx(0.4, abs=0.1),
    )
    # A sine without noise stands longest at its peaks; a limit is none of it.
    sine = np.round(np.sin(2.0 * np.pi * np.arange(2000) / 100.0 + 0.1), 4)
    assert piled_up(sine, 1e-4, 3e-5) == (0.0, 0.0)
    assert piled_up(np.clip(sine, -2.0, 0.9), 1e-4, 0.03)[0] > 0.1
    # A few values that were filled in between the steps of counts make them no finer.
    counted = np.floor(23.4 + np.random.default_rng(2).random(500))
    counted[[50, 300]] = 23.417, 23.392
    assert resolution(counted) == 1.0
