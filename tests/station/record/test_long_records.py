"""Records longer than the memory: read in pieces, averaged with the loss stated, foreseen."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import station
from made_runs import SENSITIVITY, made_run
from rlg_records import analysed, codes, off_in_u, record

from procedures.estimation.alignment import MAX_KEPT, align, align_pieces
from procedures.estimation.linear import BLOCK_ROWS, Columns, least_squares
from procedures.estimation.noise import Autoregression, fit_autoregression, whiten, whitened
from procedures.estimation.sine import (
    LineSums,
    amplitude_spectrum,
    coarse_frequency,
    nearest_lines,
    peak_near,
)
from procedures.rlg_magnetic_sensitivity.averaged import averaged_duration_s, group_means, in_groups
from procedures.rlg_magnetic_sensitivity.frequencies import (
    MAX_ROWS,
    Drive,
    averaged_rows,
    group_size,
    loss,
)
from station import registry
from station.clock import VirtualClock
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import Plan, read_plan
from station.instruments.bench import Bench, read_bench
from station.procedure import Procedures, procedure_of
from station.record.folder import PIECE_ROWS, RunFolder, RunRecord
from station.roles.base import ARRIVAL
from station.runner.evaluation import evaluate_run
from station.runner.resources import Memory, memory_of

NAME = "rlg-magnetic-sensitivity"


def bench_and_plan(*settings: str) -> tuple[Bench, Plan]:
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    return bench, read_plan(find(PLANS, NAME), Procedures(), settings)


def test_the_fit_of_blocks_is_the_fit_of_the_whole() -> None:
    generator = np.random.default_rng(1)
    design = generator.standard_normal((BLOCK_ROWS + 5000, 4))
    data = generator.standard_normal(len(design))
    fit = least_squares(design, data)
    expected = np.linalg.lstsq(design, data, rcond=None)
    assert fit.coefficients == pytest.approx(expected[0], rel=1e-9)
    assert fit.sum_of_squares == pytest.approx(float(expected[1][0]), rel=1e-12)
    kept = generator.random(len(design)) > 0.5
    part = Columns.of(design).where(kept)
    assert least_squares(part, data[kept]).coefficients == pytest.approx(
        np.linalg.lstsq(design[kept], data[kept], rcond=None)[0], rel=1e-9
    )


def test_columns_are_whitened_over_the_edge_of_a_block() -> None:
    generator = np.random.default_rng(2)
    noise = generator.standard_normal(BLOCK_ROWS + 400)
    noise[1:] += 0.6 * noise[:-1]
    index = np.delete(np.arange(len(noise) + 3), (10, BLOCK_ROWS - 2, BLOCK_ROWS + 20))
    colour = fit_autoregression(noise, index, 8)
    assert colour.order > 0
    white = whitened(Columns.of(noise[:, None]), index, colour).times(np.ones(1))
    np.testing.assert_allclose(white, whiten(noise[:, None], index, colour)[:, 0], rtol=1e-14)
    plain = Autoregression(np.zeros((1, 0)), np.ones(1))
    same = whitened(Columns.of(noise[:, None]), index, plain).times(np.ones(1))
    np.testing.assert_array_equal(same, noise)


def test_clocks_are_aligned_by_the_same_line_from_pieces() -> None:
    generator = np.random.default_rng(3)
    count = 2 * MAX_KEPT + 77
    counter = np.arange(count, dtype=np.float64)
    arrival_s = 5.0 + 0.001000012 * counter + 0.003 * generator.random(count)
    arrival_s = np.maximum.accumulate(arrival_s)
    whole = align(counter, arrival_s, 0.001)
    size = count // 7
    pieces = [(counter[k : k + size], arrival_s[k : k + size]) for k in range(0, count, size)]
    pieced = align_pieces(pieces, 0.001)
    assert pieced.offset_s == pytest.approx(whole.offset_s, abs=1e-12)
    assert pieced.rate == pytest.approx(whole.rate, rel=1e-12)
    assert pieced.offset_u_s == pytest.approx(whole.offset_u_s, rel=0.05)


def test_the_published_lines_are_those_of_the_whole_spectrum() -> None:
    values = 9.6 + np.random.default_rng(4).standard_normal(5501)
    lines = LineSums(len(values), nearest_lines(len(values), 0.1, 0.1003))
    for first in range(0, len(values), 1000):
        lines.add(values[first : first + 1000])
    expected = peak_near(*amplitude_spectrum(values, 0.1), 0.1003)
    assert lines.peak() == pytest.approx(expected, rel=1e-10)
    assert LineSums(len(values), nearest_lines(len(values), 0.1, 0.1003)).peak() is None


def test_the_coarse_frequency_of_a_long_record_is_found_to_a_quarter_of_a_line() -> None:
    time_s = np.arange(200_000) * 0.5
    frequency_Hz = 0.1 + 3.3 / time_s[-1]
    data = np.sin(2 * np.pi * frequency_Hz * time_s + 0.4) + 0.2
    found = coarse_frequency(time_s, data, 0.1, 0.002)
    assert abs(found - frequency_Hz) * time_s[-1] <= 0.13


def test_groups_are_whole_and_a_lost_sample_bends_no_mean() -> None:
    place = np.delete(np.arange(1000), (3, 500))
    value = (2.0 + 0.01 * place)[:, None]

    def judge(places, values):  # type: ignore[no-untyped-def]
        return np.ones(len(places), dtype=bool), lambda at: (2.0 + 0.01 * at)[:, None]

    pieces = [(place[:300], value[:300]), (place[300:], value[300:])]
    means = group_means(pieces, 5, 64, judge)
    np.testing.assert_array_equal(means.place, np.arange(200) * 5 + 2.0)
    np.testing.assert_allclose(means.value[:, 0], 2.0 + 0.01 * means.place, rtol=1e-12)


def test_a_record_is_averaged_no_more_than_it_must_be_or_its_fastest_line_allows() -> None:
    assert group_size(MAX_ROWS, 0.1, 0.2) == 1
    assert group_size(72 * 36_000, 0.1, 0.1) == 5
    assert averaged_rows(72 * 3_600_000, 0.001, 0.2) <= MAX_ROWS
    assert group_size(1000 * 36_000, 0.1, 0.2) == 5
    assert group_size(72 * 36_000, 1.0, 0.2) == 1
    assert loss(5, 0.1, 0.1) == pytest.approx(0.004, abs=3e-4)
    assert averaged_duration_s(0.1, 0.1, 5) == pytest.approx(0.5)


def test_an_averaged_record_gives_the_same_sensitivity() -> None:
    drive = {"IA": Drive(0.1, 1.0)}
    for seed in range(5):
        whole = record(seed, drive=drive, cycles=60.0, averaging_s=0.1)
        whole.rate_deg_per_h[[40, 3001]] += 50.0
        short = in_groups(whole, 4)
        assert short.sample_interval_s == pytest.approx(0.4)
        assert short.averaged is not None and short.averaged.rejected == 2
        before, after = analysed(whole), analysed(short)
        one, other = before.estimates[0], after.estimates[0]
        assert one.value is not None and one.standard_uncertainty is not None
        assert other.value is not None and other.standard_uncertainty is not None
        assert abs(other.value - one.value) < 0.5 * one.standard_uncertainty
        assert other.standard_uncertainty == pytest.approx(one.standard_uncertainty, rel=0.25)
        assert off_in_u(after, "IA", 0.05) < 4.0
        assert after.published[0].value == pytest.approx(before.published[0].value, rel=1e-9)
        assert "samples-averaged" in codes(after)
        assert "non-integer-cycles" not in codes(after)


def test_raw_rows_come_in_pieces_and_only_one_piece_is_kept(tmp_path: Path) -> None:
    run = RunRecord(tmp_path, "p", "s", VirtualClock())
    row = np.dtype([("n", "i8"), (ARRIVAL, "f8")])
    for first in range(0, PIECE_ROWS + 30_000, 10_000):
        rows = np.zeros(10_000, row)
        rows["n"] = np.arange(first, first + 10_000)
        run.block("source", "long", {"n": "1"}, rows)
        if first == 0:
            run.block("source", "short", {"n": "1"}, rows)
    run.close()
    run.seal()
    folder = RunFolder(run.path)
    pieces = list(folder.pieces("source", "long"))
    assert len(pieces) == 2
    assert all(len(piece) < PIECE_ROWS + 10_000 for piece in pieces)
    numbers = np.concatenate([piece["n"] for piece in pieces])
    np.testing.assert_array_equal(numbers, np.arange(len(numbers)))
    np.testing.assert_array_equal(folder.rows("source", "long")["n"], numbers)
    (one,) = folder.pieces("source", "short")
    assert next(folder.pieces("source", "short")) is one


@pytest.mark.campaign
def test_a_fast_record_is_averaged_on_its_way_from_the_disk(tmp_path: Path) -> None:
    bench, plan = bench_and_plan(
        "parameters.sample_interval=1 ms", "parameters.duration=600 s", "parameters.axes=[IA]"
    )
    document, _ = evaluate_run(RunFolder(made_run(tmp_path / "whole", plan, bench)))
    found = {flag.code: flag for flag in document.flags}
    assert found["samples-averaged"].details["group"] == 2
    assert found["samples-averaged"].details["count"] == 600_000
    assert "gap" not in found and "field-differs-from-commanded" not in found
    assert document.published[0].value is not None
    (one,) = (result.estimate for result in document.results)
    assert one.value is not None and one.standard_uncertainty is not None
    assert abs(one.value - SENSITIVITY["IA"]) < 4.0 * one.standard_uncertainty
    assert 0.003 < one.standard_uncertainty < 0.005

    lossy = made_run(tmp_path / "lossy", plan, bench, lost=1e-4)
    document, _ = evaluate_run(RunFolder(lossy))
    found = {flag.code: flag for flag in document.flags}
    assert found["gap"].details["missing_samples"] > 30
    assert document.published[0].value is None
    (one,) = (result.estimate for result in document.results)
    assert one.value is not None and one.standard_uncertainty is not None
    assert abs(one.value - SENSITIVITY["IA"]) < 4.0 * one.standard_uncertainty


SAYS_ITS_PEAK = """
import sys
from pathlib import Path
from station.cli import main
try:
    main()
except SystemExit as end:
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    print(next(line for line in lines if line.startswith("VmHWM")).split()[1], flush=True)
    raise
"""


@pytest.mark.campaign
@pytest.mark.skipif(sys.platform != "linux", reason="the peak is read from Linux")
def test_the_evaluation_of_a_long_record_stays_near_the_memory_foreseen(tmp_path: Path) -> None:
    bench, plan = bench_and_plan("parameters.duration=6 h", "parameters.axes=[IA]")
    foreseen = procedure_of(NAME).forecast(plan.parameters, bench)
    needed = memory_of(foreseen).needed_bytes
    run = made_run(tmp_path, plan, bench)
    # Not what the system counts for a child: that holds the peak of whoever started it.
    done = subprocess.run(
        [sys.executable, "-c", SAYS_ITS_PEAK, "analyse", str(run)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    )
    peak = 1024 * int(done.stdout.splitlines()[-1])
    assert peak < 500e6
    assert needed / 2 < peak < needed * 2


def test_validate_says_what_memory_the_evaluation_needs(tmp_path: Path) -> None:
    done = station(tmp_path, "validate", NAME, "--set", "parameters.duration=72 h")
    assert done.returncode == 0, done.stderr
    assert "740 MB of memory to evaluate" in done.stdout


def test_a_plan_that_no_memory_holds_is_refused(tmp_path: Path) -> None:
    settings = ("static_time=1 d", "sample_rate=1000 Hz", "turns=600")
    huge = [part for one in settings for part in ("--set", f"parameters.{one}")]
    plan = "nine-axis-calibration"
    for verb in (
        ("validate", plan),
        ("run", plan, "--non-interactive"),
        ("run", plan, "--dry-run"),
    ):
        done = station(tmp_path, *verb, *huge)
        assert done.returncode == 2
        assert "the evaluation needs about" in done.stderr
        assert "take shorter records, or another computer" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_memory_that_others_hold_is_a_warning() -> None:
    assert Memory(900, 1000, 800).taken
    assert not Memory(900, 1000, 800).too_small
    assert Memory(1100, 1000, 2000).too_small
    assert not Memory(1100, None, None).too_small
