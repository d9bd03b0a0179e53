"""The results as CSV and as JUnit XML, read back by the standard library alone."""

from __future__ import annotations

import csv
import io
import json
import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from campaign_helpers import station

from station.decision import Limit, Rule
from station.findings import Estimate, Findings, Flag, Published
from station.record.folder import RunFolder
from station.report.context import ReportContext
from station.report.html import badge_of, result_rows
from station.report.tables import csv_of, junit_of
from station.results import WITHHOLDING, WRONG_EXCITATION, ResultDocument, conclude


@pytest.fixture(scope="module")
def run(two_axes_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(
        shutil.copytree(two_axes_run, tmp_path_factory.mktemp("reports") / two_axes_run.name)
    )


def estimate(axis: str, value: float | None, u: float = 0.01) -> Estimate:
    known = value is not None
    return Estimate(
        "magnetic_sensitivity",
        axis,
        value,
        "deg/h/mT",
        u if known else None,
        50.0 if known else None,
        "least-squares",
    )


def document(
    *estimates: Estimate, limit: Limit | None, rule: Rule = "simple", flags: tuple[Flag, ...] = ()
) -> ResultDocument:
    published = [Published(estimates[0].name, "IA", 0.041, "deg/h/mT", "dft-peak")]
    findings = Findings(estimates, published, flags, (), None)
    limits = {} if limit is None else {(one.name, one.axis): limit for one in estimates}
    return conclude("rlg-magnetic-sensitivity", findings, limits, rule)


def cases(xml: str) -> dict[str, ET.Element]:
    """Return the test cases by name; the suite's own counts must be right."""
    root = ET.fromstring(xml)
    assert root.tag == "testsuites"
    (suite,) = root
    found = suite.findall("testcase")
    assert int(suite.attrib["tests"]) == len(found)
    assert int(suite.attrib["failures"]) == len(suite.findall("testcase/failure"))
    assert int(suite.attrib["errors"]) == len(suite.findall("testcase/error"))
    return {case.attrib["name"]: case for case in found}


def properties(case: ET.Element) -> dict[str, str]:
    return {one.attrib["name"]: one.attrib["value"] for one in case.findall("properties/property")}


def test_csv_has_a_row_for_each_result_with_the_published_value_beside_it(run: Path) -> None:
    done = station("report", run, "--format", "csv")
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()) == run / "exports" / "results.csv"
    assert (run / "exports" / "results.csv").read_bytes().startswith(b"\xef\xbb\xbf")
    with (run / "exports" / "results.csv").open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    stored: dict[str, Any] = json.loads((run / "results.json").read_text(encoding="utf-8"))
    assert [row["axis"] for row in rows] == ["IA", "LA"]
    for row, result in zip(rows, stored["results"], strict=True):
        for name in (
            "value",
            "standard_uncertainty",
            "coverage_factor",
            "expanded_uncertainty",
            "degrees_of_freedom",
        ):
            assert float(row[name]) == result[name], name
        assert (row["unit"], row["verdict"]) == ("deg/h/mT", result["verdict"])
        assert float(row["limit_max_abs"]) == result["limit"]["max_abs"]
        assert row["limit_min"] == row["limit_max"] == ""
    published = [float(row["as_published"]) for row in rows]
    assert published == [one["value"] for one in stored["as_published"]]


def test_csv_leaves_empty_what_is_not_determined() -> None:
    text = csv_of(document(estimate("IA", None), limit=None))
    (row,) = csv.DictReader(io.StringIO(text))
    assert row["value"] == row["expanded_uncertainty"] == row["limit_max_abs"] == ""
    assert row["verdict"] == "none"
    assert "None" not in text


def test_no_text_in_csv_is_a_formula_and_numbers_stay_numbers() -> None:
    one = replace(estimate("IA", -0.05), method="=HYPERLINK(0)")
    (row,) = csv.DictReader(io.StringIO(csv_of(document(one, limit=None))))
    assert row["method"] == "'=HYPERLINK(0)"
    assert float(row["value"]) == -0.05


def test_junit_has_a_test_case_for_each_result_with_a_limit(run: Path) -> None:
    done = station("report", run, "--format", "junit")
    assert done.returncode == 0, done.stderr
    path = run / "exports" / "results.junit.xml"
    assert Path(done.stdout.strip()) == path
    found = cases(path.read_text(encoding="utf-8"))
    assert list(found) == ["magnetic_sensitivity IA", "magnetic_sensitivity LA"]
    stored = json.loads((run / "results.json").read_text(encoding="utf-8"))
    for case, result in zip(found.values(), stored["results"], strict=True):
        said = properties(case)
        assert float(said["value"]) == result["value"]
        assert float(said["U"]) == result["expanded_uncertainty"]
        assert said["unit"] == "deg/h/mT"
        assert case.find("failure") is None and case.find("error") is None


@pytest.mark.parametrize("code", WITHHOLDING)
def test_a_flag_that_denies_the_whole_denies_each_result_in_every_document(
    run: Path, code: str
) -> None:
    details = {"instrument": "gaussmeter", "coil": "x"}
    denied = document(
        estimate("IA", 0.02), limit=Limit(max_abs=0.1), flags=(Flag(code, "Why.", details=details),)
    )
    assert denied.verdict == "inconclusive"
    (row,) = csv.DictReader(io.StringIO(csv_of(denied)))
    assert (row["verdict"], row["decision"]) == ("inconclusive", code)
    error = cases(junit_of(RunFolder(run), denied))["magnetic_sensitivity IA"].find("error")
    assert error is not None and error.attrib["type"] == code
    why = "not exposed" if code == WRONG_EXCITATION else "1 undecided"
    assert why in badge_of(denied, ReportContext("A run"))["why"]
    (shown,) = result_rows(denied.results)
    assert shown["words"].startswith("not decided: ")
    stored = denied.to_data()
    assert stored["results"][0]["conformity_probability"] is None
    # What was stored before results were withheld reads the same.
    stored["results"][0] |= {"verdict": "pass", "conformity_probability": 1.0}
    del stored["results"][0]["decision"]
    assert ResultDocument.of(stored).to_data() == denied.to_data()


def test_a_result_outside_its_limit_is_a_failure_with_value_and_limit(run: Path) -> None:
    outside = document(estimate("IA", 0.25), estimate("LA", 0.02), limit=Limit(max_abs=0.1))
    found = cases(junit_of(RunFolder(run), outside))
    failure = found["magnetic_sensitivity IA"].find("failure")
    assert failure is not None
    assert "0.25 ± 0.02 deg/h/mT, limit max_abs 0.1 deg/h/mT" in failure.attrib["message"]
    assert found["magnetic_sensitivity LA"].find("failure") is None


def test_an_undetermined_or_undecidable_result_is_an_error(run: Path) -> None:
    unknown = document(
        estimate("IA", None), estimate("LA", 0.095), limit=Limit(max_abs=0.1), rule="guarded"
    )
    found = cases(junit_of(RunFolder(run), unknown))
    kinds = {name: case.find("error") for name, case in found.items()}
    types = {name: error.attrib["type"] for name, error in kinds.items() if error is not None}
    assert types == {
        "magnetic_sensitivity IA": "undetermined",
        "magnetic_sensitivity LA": "conditional-pass",
    }


def test_a_result_without_a_limit_is_no_test_case(run: Path) -> None:
    assert cases(junit_of(RunFolder(run), document(estimate("IA", 0.25), limit=None))) == {}


def test_a_bench_that_was_not_proven_safe_is_an_error_beside_its_results(run: Path) -> None:
    flag = Flag("safe-state-unverified", "coil\x00 is on", details={"instrument": "coil_supply.x"})
    passed = document(estimate("IA", 0.02), limit=Limit(max_abs=0.1), flags=(flag,))
    found = cases(junit_of(RunFolder(run), passed))
    assert found["magnetic_sensitivity IA"].find("error") is not None
    error = found["safe-state-unverified coil_supply.x"].find("error")
    assert error is not None
    assert error.attrib["message"] == "coil� is on"  # no character that XML cannot hold


def test_a_run_that_did_not_end_is_an_error_beside_what_it_measured(
    run: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(run, tmp_path / run.name)
    lines = (copy / "events.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    first = next(n for n, line in enumerate(lines) if json.loads(line)["event"] == "field-off")
    (copy / "events.jsonl").write_text("".join(lines[:first]), encoding="utf-8")
    (copy / "manifest.json").unlink()
    done = station("report", copy, "--format", "junit")
    assert done.returncode == 0, done.stderr
    found = cases((copy / "exports" / "results.junit.xml").read_text(encoding="utf-8"))
    assert found["run-not-complete"].find("error") is not None
    assert found["magnetic_sensitivity IA"].find("error") is not None
