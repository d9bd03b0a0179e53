"""A commissioning completes the bench file; the weekly check is held against what stands there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from commissioning_parts import only
from plan_runs import shipped_bench

from procedures.commissioning import coils
from station.cli.commissioning import commission_bench
from station.errors import InputError, NotAcknowledged
from station.files.faults import FaultList
from station.files.lookup import BENCHES, find
from station.files.yaml.reading import read_yaml
from station.record.events import read_events
from station.record.layout import EVENTS
from station.runner.resuming import ResumeRequest, resume
from station.safety.acknowledgement import acknowledge

SHORT = ("parameters.coils.record=2 s", *only("coils"))


def commissioned(
    bench: Path, runs: Path, *, check: bool = False, short: tuple[str, ...] = SHORT
) -> tuple[int, Path]:
    """Commission a bench file, or check it; return the exit code and the run folder."""
    code = commission_bench(str(bench), short, True, None, runs, check=check, as_json=False)
    (folder,) = runs.iterdir()
    return code, folder


def written(folder: Path, change: Any = None) -> Path:
    """Return the file of the simulated bench with its comments, changed in its text."""
    text = find(BENCHES, "sim").read_text(encoding="utf-8")
    path = folder / "bench.yaml"
    path.write_text(change(text) if change else text, encoding="utf-8")
    return path


def stated_low(text: str) -> str:
    return text.replace("coil_constant: 0.333 mT/A", "coil_constant: 0.325 mT/A")


@pytest.fixture(scope="module")
def completed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bench file that a commissioning left where one constant was stated too low."""
    place = tmp_path_factory.mktemp("completed")
    code, folder = commissioned(written(place, stated_low), place / "runs")
    assert code == 1
    return folder / "bench-commissioned.yaml"


def test_a_wrong_constant_is_replaced_and_all_else_stays_as_written(completed: Path) -> None:
    before = stated_low(find(BENCHES, "sim").read_text(encoding="utf-8")).splitlines()
    after = completed.read_text(encoding="utf-8").splitlines()
    gone = [line for line in before if line not in after]
    assert [line.strip() for line in gone] == [
        "settings: {coil_constant: 0.325 mT/A, coil_resistance: 1.1 ohm}"
    ]
    data = yaml.safe_load(completed.read_text(encoding="utf-8"))
    measured = data["instruments"]["coil_supply.y"]["settings"]["coil_constant"]
    assert float(measured.split()[0]) == pytest.approx(0.3332, rel=0.002)
    figures = {(one["name"], one["axis"]): one["value"] for one in data["commissioned"]["figures"]}
    assert figures["coil_constant_ratio", "y"] == 1.0
    told = json.loads((completed.parent / "commissioned.json").read_text(encoding="utf-8"))
    assert [one["key"] for one in told["changes"]] == [
        "instruments.coil_supply.y.settings.coil_constant"
    ]


def off_its_place(text: str) -> str:
    placed = "probe_position: {x: 20 mm, y: -15 mm, z: 30 mm}"
    assert placed in text
    return stated_low(text).replace(placed, "probe_position: {x: 90 mm, y: -15 mm, z: 30 mm}")


def test_no_constant_is_written_while_the_probe_is_off_its_place(tmp_path: Path) -> None:
    short = ("parameters.coils.record=2 s", *only("coils", "probe"))
    code, folder = commissioned(written(tmp_path, off_its_place), tmp_path / "runs", short=short)
    assert code == 1
    flags = json.loads((folder / "results.json").read_text(encoding="utf-8"))["flags"]
    assert "probe-off-centre" in [flag["code"] for flag in flags]
    said = json.loads((folder / "commissioned.json").read_text(encoding="utf-8"))
    assert not said["changes"]
    assert not said["figures"]
    withheld = {each["part"]: each["causes"] for each in said["withheld"]}
    assert "probe-off-centre" in withheld["coils"]
    assert not (folder / "bench-commissioned.yaml").exists()


@pytest.mark.parametrize(("earth", "expected"), [(False, 3), (True, 1)])
def test_a_pulse_weight_that_is_off_is_never_called_good(
    earth: bool, expected: int, tmp_path: Path
) -> None:
    key = "parameters.earth"
    stated = (f"{key}.latitude=39.9 deg", f"{key}.elevation=90 deg", f"{key}.bias=0.01 deg/h")
    short = (
        *only("gyro"),
        "parameters.gyro.warm_up=0 s",
        "parameters.gyro.record=60 s",
        "parameters.gyro.pulse_weight=0.0656 arcsec",
        *(stated if earth else ()),
    )
    code, folder = commissioned(written(tmp_path), tmp_path / "runs", short=short)
    document = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert (code, document["verdict"]) == (expected, "fail" if earth else "inconclusive")
    report = (folder / "report.html").read_text(encoding="utf-8")
    assert ("the pulse weight was not compared" in report) is not earth


def test_the_bench_file_states_which_form_of_an_instrument_was_met(completed: Path) -> None:
    noted = [
        {"instrument": event.details["instrument"], "met": event.details["met"]}
        for event in read_events(completed.parent / EVENTS)
        if event.kind == "instrument-variant"
    ]
    assert "coil_supply.x" in [one["instrument"] for one in noted]
    confirmed = read_yaml(completed).data["commissioned"]["confirmed"]
    in_order = sorted(noted, key=lambda one: (one["instrument"], one["met"]))
    assert [one for one in in_order if one not in confirmed] == []
    assert confirmed == [one for k, one in enumerate(in_order) if one not in in_order[:k]]


def test_a_bench_is_commissioned_again_and_has_one_set_of_figures(
    completed: Path, tmp_path: Path
) -> None:
    code, folder = commissioned(completed, tmp_path / "runs")
    assert code == 0
    again = folder / "bench-commissioned.yaml"
    data = read_yaml(again).data
    assert data["commissioned"]["run"] == folder.name
    assert len(data["instruments"]) == len(shipped_bench()["instruments"])


def test_a_check_of_an_unchanged_bench_passes(completed: Path, tmp_path: Path) -> None:
    code, folder = commissioned(completed, tmp_path / "runs", check=True, short=())
    assert code == 0
    assert not (folder / "bench-commissioned.yaml").exists()


def test_a_bench_that_has_drifted_is_refused_until_somebody_has_looked(
    completed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    text = completed.read_text(encoding="utf-8")
    assert "spacing_error: 0.3 %" in text
    moved = tmp_path / "moved.yaml"
    moved.write_text(text.replace("spacing_error: 0.3 %", "spacing_error: 3 %"), encoding="utf-8")
    code, folder = commissioned(moved, tmp_path / "runs", check=True, short=())
    assert code == 1
    flags = json.loads((folder / "results.json").read_text(encoding="utf-8"))["flags"]
    assert [one["axis"] for one in flags if one["code"] == "drifted"] == ["coil_constant_ratio x"]
    with pytest.raises(NotAcknowledged, match="coil_constant_ratio x drifted since"):
        commissioned(moved, tmp_path / "later", check=True, short=())
    acknowledge(moved)
    code, _ = commissioned(moved, tmp_path / "after", check=True, short=())
    assert code == 1


def test_a_bench_that_was_not_commissioned_cannot_be_checked(tmp_path: Path) -> None:
    with pytest.raises(FaultList, match="holds no figures of a commissioning"):
        commissioned(written(tmp_path), tmp_path / "runs", check=True, short=())


def test_a_check_that_was_interrupted_and_resumed_refuses_a_bench_that_has_drifted(
    completed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    text = completed.read_text(encoding="utf-8")
    moved = tmp_path / "moved.yaml"
    moved.write_text(text.replace("spacing_error: 0.3 %", "spacing_error: 3 %"), encoding="utf-8")
    answers = tmp_path / "answers.yaml"
    answers.write_text("place-probe: no\n", encoding="utf-8")
    runs = tmp_path / "runs"
    assert commission_bench(str(moved), (), True, answers, runs, check=True, as_json=False) == 4
    (folder,) = runs.iterdir()
    assert resume(ResumeRequest(folder, quiet=True, report=False)).exit_code == 1
    with pytest.raises(NotAcknowledged, match="coil_constant_ratio x drifted since"):
        commissioned(moved, tmp_path / "later", check=True, short=())


def test_figures_that_no_check_watches_are_named(completed: Path, tmp_path: Path) -> None:
    data = yaml.safe_load(completed.read_text(encoding="utf-8"))
    data["commissioned"]["figures"] = []
    bench = tmp_path / "bench.yaml"
    bench.write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(InputError, match="holds no figure that a check watches"):
        commissioned(bench, tmp_path / "runs", check=True, short=())


def test_parts_are_chosen_by_name_alone(completed: Path, tmp_path: Path) -> None:
    short = ("parameters.coils.record=2 s", "parameters.checks=[coils]")
    code, folder = commissioned(completed, tmp_path / "runs", short=short)
    assert code == 0
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]
    assert {one["name"] for one in results} == {*coils.PART.results, "named_causes"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda figures: figures[0].update(unit="T"), "states coil_constant_ratio x in 'T'"),
        (lambda figures: figures.append(dict(figures[0])), "states coil_constant_ratio x 2 times"),
    ],
)
def test_figures_that_are_not_those_of_a_check_are_refused(
    completed: Path, tmp_path: Path, change: Any, said: str
) -> None:
    data = yaml.safe_load(completed.read_text(encoding="utf-8"))
    change(data["commissioned"]["figures"])
    bench = tmp_path / "bench.yaml"
    bench.write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(FaultList, match=said):
        commissioned(bench, tmp_path / "runs", check=True, short=())


def test_the_wire_of_a_commissioning_is_recorded(tmp_path: Path) -> None:
    short = (
        "parameters.coils.record=2 s",
        "parameters.checks=[clocks]",
        "parameters.clocks.record=60 s",
    )
    bench, runs = written(tmp_path), tmp_path / "runs"
    commission_bench(str(bench), short, True, None, runs, check=False, as_json=False, trace=True)
    (folder,) = runs.iterdir()
    assert " > " in (folder / "trace" / "gaussmeter.txt").read_text(encoding="utf-8")
