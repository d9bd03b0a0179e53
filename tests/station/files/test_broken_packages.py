"""What is wrong with one installed package costs its own entries only, and the package is named."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from command_line import PLAN, station
from places import ROOT
from plan_runs import shipped_bench

from station import registry
from station.cli.looking import list_what_there_is
from station.cli.running import dry_run_plan
from station.cli.validating import validate_plans
from station.instruments.scan import recognised
from station.roles.role import collected, role
from station.schema import schema_text

OFFERED = {
    "drivers": "lab-meter",
    "procedures": "lab-method",
    "roles": "lab",
    "simulators": "lab-meter",
}
MODULES = {
    "import-fails": "import no_such_library\n",
    "raises": "raise RuntimeError('no licence')\n",
    "exits": "import sys\nsys.exit('no licence')\n",
    "interrupts": "raise KeyboardInterrupt('no licence')\n",
    "ends": "raise BaseException('no licence')\n",
}
HANGS = "import threading\nthreading.Event().wait(60)\n"


def package(folder: Path, name: str, points: bytes | None = None, module: str = "") -> Path:
    """Make an installed package below a folder; it offers one entry of each kind."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8"
    )
    offered = "".join(
        f"[station.{kind}]\n{one} = {name}_module:Thing\n" for kind, one in OFFERED.items()
    )
    (info / "entry_points.txt").write_bytes(offered.encode() if points is None else points)
    (folder / f"{name}_module.py").write_text(module, encoding="utf-8")
    return folder


def installed(folder: Path, patch: pytest.MonkeyPatch) -> None:
    """Have the packages below a folder installed, in this process."""
    patch.syspath_prepend(str(folder))
    registry.offers.cache_clear()
    registry.names.cache_clear()


def beside_ours(folder: Path) -> str:
    """Return the search path of another process: the packages below a folder, then this code."""
    return f"{folder}{os.pathsep}{ROOT}"


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """Have the registry look again after each test."""
    yield
    collected.cache_clear()
    sys.modules.pop("labware_module", None)
    registry.offers.cache_clear()
    registry.names.cache_clear()


@pytest.mark.parametrize("kind", MODULES)
def test_one_broken_package_costs_only_its_own_entries(
    kind: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    installed(package(tmp_path / "site", "labware", module=MODULES[kind]), monkeypatch)
    for what, ours in (("drivers", "kepco-bop-36-12"), ("procedures", "serf-nonorthogonality")):
        list_what_there_is(what, as_json=False)
        listed = capsys.readouterr().out
        (line,) = [one for one in listed.splitlines() if "lab-" in one]
        assert "of the package labware cannot be loaded" in line
        assert ours in listed
    assert "lab-method" not in schema_text("plan")
    assert "lab-method" not in schema_text("dataset")
    assert "kepco-bop-36-12" in schema_text("bench")
    assert recognised("here", "KEPCO,BOP 36-12D,H148201,1.0").driver is not None
    collected.cache_clear()
    assert role("coil_supply") is not None
    (reason,) = collected()[1]
    assert "the role 'lab' of the package labware cannot be loaded" in reason
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    assert validate_plans([str(tmp_path / "plan.yaml")], "sim") == 0
    assert (
        dry_run_plan(
            str(tmp_path / "plan.yaml"), "sim", served=None, output=tmp_path, as_json=False
        )
        == 0
    )


def test_the_reference_pages_are_made_beside_a_broken_package(tmp_path: Path) -> None:
    site = package(tmp_path / "site", "labware", module=MODULES["raises"])
    program = (
        "import reference_faults, reference_instruments, reference_keys\n"
        "print(reference_faults.faults(), reference_keys.drivers(), reference_keys.procedures())\n"
        "print(*reference_instruments.own_drivers())\n"
    )
    places = f"{ROOT / 'docs' / 'from_code'}{os.pathsep}{beside_ours(site)}"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": places},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "kepco-bop-36-12" in done.stdout
    assert "lab-" not in done.stdout


def test_what_loads_and_is_no_procedure_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    installed(package(tmp_path / "site", "labware", module="class Thing: pass\n"), monkeypatch)
    list_what_there_is("procedures", as_json=False)
    assert "is no procedure: it has no title" in capsys.readouterr().out
    assert "lab-method" not in schema_text("plan")


def test_a_driver_or_procedure_that_cannot_be_loaded_is_a_fault_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    installed(package(tmp_path / "site", "labware", module=MODULES["import-fails"]), monkeypatch)
    bench = shipped_bench()
    bench["instruments"]["gaussmeter"]["driver"] = "lab-meter"
    plan, own, path = (tmp_path / name for name in ("plan.yaml", "own.yaml", "bench.yaml"))
    path.write_text(yaml.safe_dump(bench), encoding="utf-8")
    plan.write_text(PLAN, encoding="utf-8")
    own.write_text(PLAN.replace("rlg-magnetic-sensitivity", "lab-method"), encoding="utf-8")
    assert validate_plans([str(plan)], str(path)) == 2
    said = capsys.readouterr().err
    assert re.search(r"bench.yaml:\d+:\d+: instruments.gaussmeter.driver: ", said)
    assert "package labware" in said and "no_such_library" in said
    assert validate_plans([str(own)], "sim") == 2
    said = capsys.readouterr().err
    assert "own.yaml:2:12: procedure: the procedure 'lab-method' of the package labware" in said


@pytest.mark.parametrize("points", [b"\xff\xfe not text", b"[station.drivers]\nno equals sign\n"])
def test_a_package_of_odd_metadata_is_named_and_left_out(points: bytes, tmp_path: Path) -> None:
    path = str(package(tmp_path / "site", "oddware", points))
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    done = station(tmp_path, "validate", "plan.yaml", PYTHONPATH=path)
    assert done.returncode == 0, done.stderr
    assert "WARNING: the entry points of the package oddware cannot be read" in done.stderr


def test_a_name_that_two_packages_offer_is_named_with_both(tmp_path: Path) -> None:
    points = b"[station.drivers]\nlab-driver = firstware_module:Thing\n"
    first = package(tmp_path / "site", "firstware", points)
    package(first, "otherware", points)
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    done = station(tmp_path, "validate", "plan.yaml", PYTHONPATH=str(first))
    assert done.returncode == 0, done.stderr
    assert "WARNING: the driver 'lab-driver' is offered by two packages" in done.stderr


def test_a_name_of_the_stations_own_is_not_taken_by_another_package(tmp_path: Path) -> None:
    points = b"[station.drivers]\nkepco-bop-36-12 = takerware_module:Thing\n"
    module = "raise RuntimeError('it was loaded')\n"
    path = beside_ours(package(tmp_path / "site", "takerware", points, module))
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    done = station(tmp_path, "run", "plan.yaml", "--dry-run", PYTHONPATH=path)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("WARNING") == 1, done.stderr
    assert (
        "WARNING: the driver 'kepco-bop-36-12' is the station's own; that of the package takerware "
        "is left out: rename it there, or remove that package"
    ) in done.stderr


def test_a_run_and_its_report_name_the_package_of_each_driver(one_axis_run: Path) -> None:
    drivers = json.loads((one_axis_run / "run.json").read_text(encoding="utf-8"))["drivers"]
    ours = drivers["kepco-bop-36-12"]
    assert re.fullmatch(r"inertial-station \d.*", ours)
    assert f"drivers of {ours}" in (one_axis_run / "report.html").read_text(encoding="utf-8")


def test_the_package_of_a_laboratorys_own_driver_is_known(tmp_path: Path) -> None:
    points = b"[station.drivers]\nlab-meter = meterware_module:Thing\n"
    module = "from drivers.lakeshore.gaussmeter_f71 import LakeshoreF71 as Thing\n"
    path = beside_ours(package(tmp_path / "site", "meterware", points, module))
    program = (
        "from station.runner.execute import packages_of; print(packages_of(['lab-meter', 'none']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    )
    assert done.stdout == "{'lab-meter': 'meterware 1.0', 'none': ''}\n"


def test_a_package_that_hangs_costs_only_what_needs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(registry, "LOADS_WITHIN_S", 0.3)
    points = b"[station.drivers]\nlab-meter = hangware_module:Thing\n"
    installed(package(tmp_path / "site", "hangware", points, HANGS), monkeypatch)
    list_what_there_is("drivers", as_json=False)
    listed = capsys.readouterr().out
    (line,) = [row for row in listed.splitlines() if "lab-meter" in row]
    assert "of the package hangware cannot be loaded" in line
    assert "its import is not done after 0.3 s" in line
    assert "kepco-bop-36-12" in listed
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    bench = shipped_bench()
    bench["instruments"]["gaussmeter"]["driver"] = "lab-meter"
    (tmp_path / "bench.yaml").write_text(yaml.safe_dump(bench), encoding="utf-8")
    assert validate_plans([str(tmp_path / "plan.yaml")], "sim") == 0
    assert validate_plans([str(tmp_path / "plan.yaml")], str(tmp_path / "bench.yaml")) == 2
    assert "package hangware cannot be loaded" in capsys.readouterr().err


@pytest.mark.campaign
def test_list_names_a_package_that_hangs_after_ten_seconds_and_goes_on(tmp_path: Path) -> None:
    points = (
        b"[station.drivers]\nlab-meter = hangware_module:Thing\nlab-two = hangware_module:Two\n"
    )
    path = beside_ours(package(tmp_path / "site", "hangware", points, HANGS))
    began = time.monotonic()
    done = station(tmp_path, "list", "drivers", PYTHONPATH=path)
    assert 10.0 < time.monotonic() - began < 20.0
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("its import is not done after 10 s") == 2
    assert "watlow-f4t" in done.stdout
