"""A channel's readings that are none are named, and a sound channel has none."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from bias_records import Gyro, record
from numpy.typing import NDArray
from static_records import DEVICES, counted, noise

from procedures.estimation.channel import Channel, Screened, flags, screen, still

Array = NDArray[np.float64]

SLOW = Channel("the thermometer", "the thermometer", "degC", low=-100.0, high=200.0, slow=True)
OUTPUT = Channel(
    "the output of IA", "the gyro", "deg/h", when_coarse="Record more digits.", when_stepped="Look."
)


def counts(screened: Screened) -> dict[str, int]:
    """Return how many readings are no readings, by kind."""
    masks = {
        "missing": screened.missing,
        "wild": screened.wild,
        "frozen": screened.frozen,
        "copied": screened.copied,
        "saturated": screened.saturated,
    }
    return {name: int(mask.sum()) for name, mask in masks.items() if mask.any()}


def thermometers(seed: int, digits: int) -> tuple[Array, Array]:
    """Return the readings of a gyro's and of a chamber's thermometer."""
    dataset = record(Gyro(), seed)
    assert dataset.gyro_degC is not None
    return np.round(dataset.gyro_degC, digits), np.round(dataset.chamber_degC, digits)


@pytest.mark.parametrize("digits", [0, 1, 2, 3, 9])
def test_a_sound_thermometer_has_nothing_taken_out(digits: int) -> None:
    for seed in range(6):
        for readings in thermometers(seed, digits):
            screened = screen(SLOW, readings)
            assert counts(screened) == {} and screened.jump is None
            assert flags([screened]) == []


def at(rows: slice, change: Callable[[Array], Array | float]) -> Callable[[Array], Array]:
    def changed(readings: Array) -> Array:
        readings = readings.copy()
        readings[rows] = change(readings[rows])
        return readings

    return changed


@pytest.mark.parametrize(
    ("change", "kinds"),
    [
        (at(slice(500, 501), lambda _: 850.0), {"wild": 1}),
        (at(slice(500, 501), lambda _: -200.0), {"wild": 1}),
        (at(slice(500, 501), lambda own: own + 2.0), {"wild": 1}),
        (at(slice(500, 501), lambda _: np.nan), {"missing": 1}),
        (at(slice(400, 460), lambda own: own + 6.0), {"wild": 60}),
        (at(slice(400, 519), lambda own: own[0]), {"frozen": 119}),
        (at(slice(150, 389), lambda own: own[0]), {"frozen": 239}),
    ],
)
def test_readings_of_a_thermometer_that_are_none_are_named(
    change: Callable[[Array], Array], kinds: dict[str, int]
) -> None:
    for readings in thermometers(1, 3):
        screened = screen(SLOW, change(readings))
        assert counts(screened) == kinds and screened.jump is None
        assert len(flags([screened])) == (kinds != {"missing": 1})


def test_copied_cut_off_and_stepped_thermometers_are_named() -> None:
    for readings in thermometers(1, 3):
        copied = readings.copy()
        copied[700:800] = readings[200:300]
        assert counts(screen(SLOW, copied)) == {"copied": 100}
        assert counts(screen(SLOW, np.minimum(readings, 50.0))).keys() == {"saturated"}
        stepped = readings.copy()
        stepped[600:] += 3.0
        jump = screen(SLOW, stepped).jump
        assert jump is not None and jump.row == 600 and jump.size == pytest.approx(3.0, abs=0.2)


def test_noise_at_rest_is_screened_and_each_mask_has_its_own_rows() -> None:
    rate = np.round(9.6 + 0.3 * np.random.default_rng(2).standard_normal(3000), 3)
    assert counts(screen(OUTPUT, rate)) == {}
    rate[100:150] = rate[100]
    rate[200:240] = 400.0
    rate[900] += 5.0
    rate[1000] = np.nan
    rate[2000:2100] = rate[1500:1600]
    screened = screen(OUTPUT, rate)
    kinds = {"missing": 1, "wild": 1, "frozen": 50, "copied": 100, "saturated": 40}
    assert counts(screened) == kinds
    assert int(screened.good.sum()) == 3000 - sum(kinds.values())
    assert {flag.code for flag in flags([screened], "IA", "sample")} == {
        "outliers-rejected",
        "frozen",
        "saturated",
    }
    cut = screen(OUTPUT, np.minimum(rate[240:900], 9.9))
    assert counts(cut).keys() == {"saturated"}


def test_an_angle_in_coarse_steps_is_sound_and_stands_still_where_it_does() -> None:
    device = DEVICES["navigator"]
    for seed in range(10):
        rng = np.random.default_rng(seed)
        # About one step in a second: for minutes the noise lies in the middle of a step.
        rate = counted(0.34 + noise(rng, device, 14_400, 1.0), device["pulse"], 1.0, 0.0)
        assert counts(screen(OUTPUT, rate)) == {}
        rate[5000:5200] = rate[5000]
        rate[9000] += 10.0 * device["pulse"]
        marked = screen(OUTPUT, rate)
        assert counts(marked).keys() == {"wild", "frozen"} and marked.wild[9000]
        assert marked.frozen[5000:5200].all() and marked.frozen.sum() < 230


def test_no_mean_is_known_better_than_the_steps_of_its_channel_allow() -> None:
    noise = np.random.default_rng(1).standard_normal(500)
    quiet = screen(OUTPUT, np.round(9.65 + 0.01 * noise, 1))
    assert quiet.coarse and quiet.u_of_step(500) > 0.9 * 0.1 / np.sqrt(12.0)
    assert [flag.code for flag in flags([quiet], "IA")] == ["coarse-output"]
    noisy = screen(OUTPUT, np.round(9.6 + 0.3 * noise, 1))
    assert not noisy.coarse
    assert noisy.u_of_step(500) == pytest.approx(0.1 / np.sqrt(12.0 * 500.0))


@pytest.mark.parametrize(("step_degC", "noise_degC"), [(0.01, 1e-3), (0.01, 3e-3), (0.1, 0.03)])
def test_a_coarse_thermometer_does_not_stand_still_where_the_temperature_rests(
    step_degC: float, noise_degC: float
) -> None:
    """Soaks of two hours and ramps between them, a reading a minute."""
    rng, levels = np.random.default_rng(5), [22.0, -40.0, 0.0, 40.0, 60.0, 20.0]
    parts = [np.full(120, levels[0])]
    for before, after in pairwise(levels):
        parts += [np.linspace(before, after, int(abs(after - before))), np.full(120, after)]
    course = np.concatenate(parts)
    true = np.empty_like(course)
    true[0] = course[0]
    for n in range(1, len(course)):
        true[n] = true[n - 1] + (course[n] - true[n - 1]) / 20.0
    for _ in range(10):
        read = true + noise_degC * rng.standard_normal(len(true))
        assert not still(np.round(read / step_degC) * step_degC).any()
    read[300:400] = read[300]  # fine digits
    assert still(read).sum() == 100
