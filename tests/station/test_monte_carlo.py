"""Budgets propagated through the whole analysis, and held against their linear propagation."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bad_input_files import here
from command_line import station
from places import DATA
from trials import in_this_process, tried

from station.cli.reanalysing import by_trials, refuse_trials_of_many, refuse_without_all
from station.errors import InputError
from station.findings import Analysis, Estimate, Findings, InputQuantity, Trials
from station.parts import Table
from station.reanalysis.monte_carlo import interval_of, tolerance
from station.report.trial_tables import trial_tables
from station.results import Result, ResultDocument, conclude

UNIFORM = InputQuantity("lean", "lean", 0.1, "rad", "the test", distribution="uniform")


def mean_of(data: Any) -> Analysis:
    """Estimate a mean, its square and the cosine by which a lean makes it smaller."""
    readings, lean = data
    mean, u = float(readings.mean()), float(readings.std(ddof=1) / math.sqrt(len(readings)))
    dof = len(readings) - 1.0
    names = {"mean": (mean, u, 0.0), "square": (mean**2, 2.0 * abs(mean) * u, 0.0)}
    names["lean"] = (mean + lean, u, 1.0)
    names["cosine"] = (math.cos(lean), 0.0, 0.0)
    estimates = [
        Estimate(name, None, value, "1", u_a, dof, "mean", {"lean": at} if at else {})
        for name, (value, u_a, at) in names.items()
    ]
    return Analysis(estimates, (), ())


def noisy(data: Any, random: np.random.Generator) -> Any:
    readings, lean = data
    return readings + random.standard_normal(len(readings)) * readings.std(ddof=1), lean


def leaning(data: Any, deviation: float) -> Any:
    return data[0], data[1] + deviation


def findings_of(level: float, inputs: list[InputQuantity], *, served: bool = True) -> Findings:
    readings = level + np.random.default_rng(3).standard_normal(400)
    data = readings - readings.mean() + level, 0.0
    perturbed = {"lean": leaning} if served else {}
    trials = Trials(data, mean_of, noisy, perturbed)
    return Findings(mean_of(data).estimates, (), (), inputs, None, trials=trials)


def document_of(findings: Findings) -> ResultDocument:
    return conclude("toy", findings, {}, "simple")


@pytest.mark.parametrize("served", [True, False])
def test_trials_agree_with_what_is_linear(monkeypatch: pytest.MonkeyPatch, served: bool) -> None:
    in_this_process(monkeypatch)
    findings = tried(findings_of(10.0, [UNIFORM], served=served), 2000)
    document = document_of(findings)
    for name, u in (("mean", 0.05), ("lean", math.hypot(0.05, 0.1))):
        result = document.result(name)
        own = result.estimate.extra["monte_carlo"]
        assert result.estimate.method == "mean"
        assert own["agrees"]
        assert own["n"] == 2000
        assert own["seed"] == 1
        assert own["standard_uncertainty"] == pytest.approx(u, rel=0.06)
        assert own["interval"][0] < own["value"] < own["interval"][1]
    linear = document.result("lean").estimate.extra["monte_carlo"]["linear_inputs"]
    assert linear == ([] if served else ["lean"])


def test_where_linearisation_fails_the_result_is_that_of_the_trials(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a mean of zero the square has no first derivative: its linear u is nothing."""
    in_this_process(monkeypatch)
    document = document_of(tried(findings_of(0.0, []), 1000))
    result = document.result("square")
    own = result.estimate.extra["monte_carlo"]
    assert not own["agrees"]
    assert result.estimate.method == "monte-carlo"
    assert result.estimate.value == own["value"] == pytest.approx(0.05**2, rel=0.2)
    assert result.combined is not None
    assert result.combined.standard_uncertainty == own["standard_uncertainty"] > 0.0
    farther = max(abs(end - own["value"]) for end in own["interval"])
    assert result.expanded_uncertainty == pytest.approx(farther)
    again = Result.of(json.loads(json.dumps(result.to_data())))
    assert again.to_data() == result.to_data()
    (table,) = trial_tables(document)
    assert isinstance(table, Table)
    agree = {row[0]: row[table.columns.index("Agree")] for row in table.rows}
    assert agree["square"] == "no: the trials hold"
    assert agree["mean"] == "yes"


@pytest.mark.parametrize("way", [{"method": "constant"}, {"extra": {"frame": "other"}}])
@pytest.mark.parametrize("share", [1.0, 0.2])
def test_a_trial_whose_value_comes_another_way_is_no_agreement(
    monkeypatch: pytest.MonkeyPatch, way: dict[str, Any], share: float
) -> None:
    in_this_process(monkeypatch)
    nominal = findings_of(10.0, [])
    assert nominal.trials is not None
    middle = np.quantile(np.random.default_rng(1).standard_normal(10_000), share) * 0.05

    def other(data: Any) -> Analysis:
        own_mean = mean_of(data)
        if data[0].mean() > 10.0 + middle:
            return own_mean
        rows = [replace(row, standard_uncertainty=0.0, **way) for row in own_mean.estimates]
        return Analysis(rows, (), ())

    findings = replace(nominal, trials=replace(nominal.trials, analyse=other))
    for estimate in tried(findings, 200).estimates:
        own = estimate.extra["monte_carlo"]
        assert own["undetermined"] == pytest.approx(200 * share, abs=30)
        assert not own["agrees"]
        assert own["standard_uncertainty"] is None
        assert estimate.method == "mean"


def test_a_result_that_holds_more_than_the_trials_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """A u that holds doubts about the model is not made smaller by trials of that model."""
    in_this_process(monkeypatch)
    findings = findings_of(10.0, [])
    doubtful = [replace(e, standard_uncertainty=0.2) for e in findings.estimates]
    document = document_of(tried(replace(findings, estimates=doubtful), 400))
    result = document.result("mean")
    assert not result.estimate.extra["monte_carlo"]["agrees"]
    assert result.estimate.method == "mean"
    assert result.combined is not None
    assert result.combined.standard_uncertainty == pytest.approx(0.2)


def test_trials_without_a_value_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    in_this_process(monkeypatch)

    def failing(data: Any) -> Analysis:
        raise np.linalg.LinAlgError

    findings = findings_of(10.0, [])
    assert findings.trials is not None
    broken = replace(findings, trials=replace(findings.trials, analyse=failing))
    own = document_of(tried(broken, 100)).result("mean").estimate.extra["monte_carlo"]
    assert own["undetermined"] == 100
    assert own["value"] is own["interval"] is None
    assert not own["agrees"]


def test_the_tolerance_is_half_the_last_digit() -> None:
    assert tolerance(0.0312, 1000) == pytest.approx(0.005)
    assert tolerance(0.0312, 200_000) == pytest.approx(0.0005)
    assert tolerance(0.097, 1000) == pytest.approx(0.05)
    assert tolerance(0.0, 1000) == 0.0


def test_the_interval_holds_95_percent_and_says_how_well_it_is_known() -> None:
    values = np.sort(np.random.default_rng(5).standard_normal(20_000))
    ends, errors = interval_of(values)
    assert ends == pytest.approx([-1.96, 1.96], abs=0.06)
    assert errors == pytest.approx([0.0189, 0.0189], rel=0.3)
    ends, errors = interval_of(np.arange(100.0))
    assert ends.tolist() == [1.0, 96.0]
    assert np.isfinite(errors).all()


def test_what_has_no_trials_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    in_this_process(monkeypatch)
    with pytest.raises(InputError, match="no Monte Carlo"):
        tried(replace(findings_of(1.0, []), trials=None))
    with pytest.raises(InputError, match="--all"):
        refuse_trials_of_many(100)
    with pytest.raises(InputError, match="--monte-carlo"):
        refuse_without_all("runs", "tcp://nobody:1", None)
    refuse_without_all("runs", "tcp://nobody:1", None, 100)
    assert by_trials(None, 1, None) is None


@pytest.mark.parametrize("trials", ["0", "-3", "99", "1000000000"])
def test_a_number_of_trials_that_says_nothing_or_never_ends_is_refused(
    trials: str, tmp_path: Path
) -> None:
    done = here(["analyse", str(DATA / "rlg-one-axis"), "--monte-carlo", trials], tmp_path)
    assert done.returncode == 2
    assert "--monte-carlo" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_same_seed_gives_the_same_bytes_whoever_does_the_trials(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    data = str(DATA / "rlg-one-axis")
    words = ("analyse", data, "--monte-carlo", "100", "--output")
    on_dask = station(tmp_path, *words, "dask")
    assert on_dask.returncode == 0, on_dask.stderr
    assert "1 of 1 results agree" in on_dask.stdout
    from station.cli.analysing import analyse_dataset

    in_this_process(monkeypatch)
    analyse_dataset(DATA / "rlg-one-axis", tmp_path / "here", by_trials(100, 1, None))
    texts = [(tmp_path / place / "results.json").read_bytes() for place in ("dask", "here")]
    assert texts[0] == texts[1]
    page = (tmp_path / "dask" / "report.html").read_text(encoding="utf-8")
    assert "Monte Carlo" in page
    analyse_dataset(DATA / "rlg-one-axis", tmp_path / "other", by_trials(100, 2, None))
    assert (tmp_path / "other" / "results.json").read_bytes() != texts[0]
