"""Tables name what was measured: the combination, and the temperature that it holds at."""

from __future__ import annotations

import re

import numpy as np
import pytest
from places import DATA

from station.cli.analysing import print_document
from station.dataset_reading import read_dataset
from station.report.run_report import report_of_dataset
from station.runner.evaluation import evaluate_dataset

DATA = DATA / "accelerometer-three-planes"


def test_the_terminal_table_prints_combination_and_temperature(
    capsys: pytest.CaptureFixture[str],
) -> None:
    document, findings = evaluate_dataset(read_dataset(DATA))
    degC = float(np.mean(findings.detail.dataset.temperature_degC))
    print_document(document)
    lines = capsys.readouterr().out.splitlines()
    for combination in ("K0 + Kpp", "Kii − Kpp", "Koo − Kpp"):
        (line,) = [one for one in lines if one.startswith(f"{combination} ")]
        held = re.search(r" at ([\d.]+) degC", line)
        assert held is not None, line
        assert float(held[1]) == pytest.approx(degC, abs=0.3)
    assert not [one for one in lines if re.match(r"(K0|Kii|Koo) +-?\d", one)]
    assert [one for one in lines if re.match(r"Km +-?0?\.?\d.* at ", one)]


def test_the_report_prints_combination_and_temperature() -> None:
    raw = read_dataset(DATA)
    document, _ = evaluate_dataset(raw)
    results = report_of_dataset(raw, document, ()).split('id="results"')[1]
    results = results.split("</section>")[0]
    for combination in ("K0 + Kpp", "Kii − Kpp", "Koo − Kpp"):
        assert re.search(rf"<td>{re.escape(combination)} at [\d.]+ °C</td>", results)
    assert "<td>K0 at" not in results


def test_the_result_document_gives_the_temperature_and_keeps_its_names() -> None:
    document, _ = evaluate_dataset(read_dataset(DATA))
    entry = next(one for one in document.to_data()["results"] if one["name"] == "K0")
    assert entry["terms"] == {"K0": 1.0, "Kpp": 1.0}
    assert re.fullmatch(r"[\d.]+ degC", entry["conditions"]["temperature"])
