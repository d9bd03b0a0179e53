"""What a mounting that leans does to the combinations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from accelerometer_records import record
from campaigns.planted.accelerometer_tables import LEVEL, ONE_FIELD, THREE_PLANES, Kind, made
from campaigns.planted.judging import analysed, worst_of

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.outlook import expected_uncertainty
from station.dataset_reading import read_dataset
from station.runner.evaluation import evaluate_dataset

HELD = {"level": {"K0", "Kii", "Koo"}, "one field": {"Kom", "Kpm"}}


def u_of(document: dict[str, Any]) -> dict[str, float]:
    """Return the u of each result that is determined."""
    found = ((one["name"], one["standard_uncertainty"]) for one in document["results"])
    return {name: u for name, u in found if u is not None}


@pytest.mark.parametrize("kind, held", [(LEVEL, HELD["level"]), (ONE_FIELD, HELD["one field"])])
def test_a_mounting_that_no_row_tells_is_in_the_uncertainty(kind: Kind, held: set[str]) -> None:
    one = made(kind, 0)
    document = analysed(one)
    # The device leans by 0.2 and 0.3 mrad, which noise alone would not cover.
    assert worst_of(one, document["results"])[1] < 3.0
    size = 5e-4 / (0.05 if kind is ONE_FIELD else 1.0)
    for name, u in u_of(document).items():
        if name in held:
            assert size * 0.99 < u < 2.0 * size
        elif name in {"Ki", "Kiii", "Kio"}:
            assert u < 0.1 * size


@pytest.mark.parametrize("kind, held", [(LEVEL, HELD["level"]), (ONE_FIELD, HELD["one field"])])
def test_the_expected_uncertainty_holds_the_mounting_as_the_result_does(
    kind: Kind, held: set[str]
) -> None:
    expected = expected_uncertainty(*kind.plan.points(), kind.noise_V)
    u = u_of(analysed(made(kind, 2)))
    assert set(expected.mounted) == held
    for name, foreseen in expected.standard_uncertainty.items():
        # A linear drift that may be there adds to what resembles it.
        most = 1.02 if name in held else 1.5
        assert foreseen is not None
        assert 0.85 < u[name] / foreseen < most, name


def test_a_plan_whose_rows_tell_the_mounting_expects_nothing_of_it() -> None:
    told = expected_uncertainty(*THREE_PLANES.plan.points(), 3e-6)
    assert not told.mounted


def test_a_stated_mounting_counts_in_the_place_of_the_assumed_one(tmp_path: Path) -> None:
    folder = tmp_path / "dataset"
    folder.mkdir()
    made(LEVEL, 0).write(folder)
    path = folder / "dataset.yaml"
    u = []
    for stated in ("", ", mounting: 20 arcsec"):
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace("1 g}", f"1 g{stated}}}"), encoding="utf-8")
        document, findings = evaluate_dataset(read_dataset(folder))
        u.append(u_of(document.to_data())["K0"])
        source = "conditions, mounting" if stated else "assumed, nobody states it"
        stated_in = {one.source for one in findings.inputs if one.standard_uncertainty}
        assert stated_in == {source}
    assert u[0] == pytest.approx(5e-4, rel=0.01)
    assert u[1] == pytest.approx(20 * 4.848e-6, rel=0.02)


def test_where_the_rows_tell_the_mounting_nothing_is_assumed() -> None:
    for planes in (("io",), ("io", "ip"), ("io", "ip", "op")):
        analysis = analyse(record(0, planes, 12))
        used = {name for one in analysis.estimates for name in one.sensitivities}
        assert not any(name.startswith("mounting") for name in used)
