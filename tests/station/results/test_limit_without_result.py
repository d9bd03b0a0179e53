"""A limit whose result the procedure does not return never passes silently."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from station.decision import Limit
from station.errors import EXIT_DONE, EXIT_OUTSIDE_LIMIT, EXIT_UNDETERMINED, InputError
from station.findings import Estimate, Findings
from station.procedure import check_findings, procedure_of
from station.record.folder import RunFolder
from station.report.tables import junit_of
from station.results import ResultDocument, conclude
from station.runner.evaluation import evaluate_run, exit_code_of

CODE = "limit-without-result"


@pytest.fixture(scope="module")
def run(two_axes_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two axes out of three, its limit given for the result as a whole."""
    return Path(
        shutil.copytree(two_axes_run, tmp_path_factory.mktemp("limited") / two_axes_run.name)
    )


def document(*axes: str, value: float = 0.04) -> ResultDocument:
    estimates = [
        Estimate("magnetic_sensitivity", axis, value, "deg/h/mT", 0.001, 50.0, "least-squares")
        for axis in axes
    ]
    limits: dict[tuple[str, str | None], Limit] = {
        ("magnetic_sensitivity", axis): Limit(max_abs=0.1) for axis in ("IA", "NA", "LA")
    }
    findings = Findings(estimates, (), (), (), None)
    return conclude(
        "rlg-magnetic-sensitivity",
        findings,
        limits,
        "simple",
        measured={"magnetic_sensitivity": ("IA", "LA")},
    )


def test_a_limit_on_a_result_that_is_not_returned_is_exit_6_and_flagged() -> None:
    whole = document("IA", "LA")
    assert (whole.verdict, exit_code_of(whole), list(whole.flags)) == ("pass", EXIT_DONE, [])
    part = document("IA")
    assert (part.verdict, exit_code_of(part)) == ("inconclusive", EXIT_UNDETERMINED)
    (flag,) = part.flags
    assert (flag.code, flag.axis) == (CODE, "LA")
    assert flag.details == {"name": "magnetic_sensitivity", "limit": {"max_abs": 0.1}}
    assert part.to_data()["flags"][0]["code"] == CODE


def test_without_any_result_the_limits_are_undecided_and_outside_stays_outside() -> None:
    assert exit_code_of(document()) == EXIT_UNDETERMINED
    assert exit_code_of(document("IA", value=0.2)) == EXIT_OUTSIDE_LIMIT


def test_junit_has_an_error_for_a_limit_without_result(run: Path) -> None:
    xml = junit_of(RunFolder(run), document("IA"))
    assert f'type="{CODE}"' in xml
    assert "magnetic_sensitivity LA" in xml


def test_a_limit_for_a_whole_result_asks_for_the_axes_of_the_plan_only(run: Path) -> None:
    stored = json.loads((run / "results.json").read_text(encoding="utf-8"))
    assert CODE not in {flag["code"] for flag in stored["flags"]}
    found, _ = evaluate_run(RunFolder(run))
    assert found.to_data() == stored
    assert {result.estimate.axis for result in found.results} == {"IA", "LA"}
    assert all(result.limit is not None for result in found.results)


def test_a_result_in_another_unit_than_declared_is_refused() -> None:
    """A limit is compared with the number of the result."""
    estimate = Estimate("magnetic_sensitivity", "IA", 4e-5, "deg/h/uT", 1e-6, 50.0, "x")
    findings = Findings([estimate], (), (), (), None)
    with pytest.raises(InputError, match="in deg/h/uT, its procedure declares deg/h/mT"):
        check_findings(procedure_of("rlg-magnetic-sensitivity"), findings)


def test_a_result_that_is_not_declared_is_refused() -> None:
    """No limit would ever be held against it."""
    estimate = Estimate("magnetic_sensitivty", "IA", 0.04, "deg/h/mT", 1e-3, 50.0, "x")
    findings = Findings([estimate], (), (), (), None)
    with pytest.raises(InputError, match="the `results` of rlg-magnetic-sensitivity name magnetic"):
        check_findings(procedure_of("rlg-magnetic-sensitivity"), findings)
