"""The built wheel runs the main job in an environment of its own, from another folder."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from places import ROOT

PLAN = """\
plan: 1
procedure: rlg-magnetic-sensitivity
dut: {model: RLG-50, serial: W-1}
parameters:
  frequency: 0.2 Hz
  amplitude: 1 mT
  sample_interval: 0.1 s
  duration: 50 s
  axes: [IA]
  pulse_weight: 0.0625 arcsec
  warm_up: {slope_limit: 10 deg/h^2, window: 1 min, at_most: 5 min}
"""


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.campaign
def test_the_wheel_runs_the_main_job_from_another_folder(tmp_path: Path) -> None:
    run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", tmp_path, ROOT, cwd=tmp_path)
    (wheel,) = tmp_path.glob("inertial_station-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    rooms = {name.split("/")[0] for name in names if "dist-info" not in name}
    assert rooms == {"station", "drivers", "procedures", "sim_instruments", "config"}
    venv.create(tmp_path / "venv", with_pip=True)
    scripts = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")
    run(scripts / "python", "-m", "pip", "install", "-q", "--no-deps", wheel, cwd=tmp_path)
    # The packages ours depends on are lent by this environment, without its editable install of
    # ours: a path file does not follow the path files of the folder it names.
    asked = "import sysconfig; print(sysconfig.get_path('purelib'))"
    own = run(scripts / "python", "-c", asked, cwd=tmp_path).strip()
    lent = Path(own, "lent.pth")
    lent.write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    where = run(scripts / "python", "-c", "import station; print(station.__file__)", cwd=elsewhere)
    assert where.startswith(own)
    (elsewhere / "plan.yaml").write_text(PLAN, encoding="utf-8")
    printed = run(scripts / "station", "run", "plan.yaml", "--non-interactive", cwd=elsewhere)
    assert "verdict: none" in printed
    (folder,) = (elsewhere / "runs").iterdir()
    assert (folder / "report.html").is_file()
    for kind in ("plan", "bench", "procedure"):
        run(scripts / "station", "new", kind, "a-first", cwd=elsewhere)
