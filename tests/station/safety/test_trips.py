"""A trip belongs to the instruments: not to a bench file's name, a state folder or an account.

The places of the system are the tests' own, in a mount namespace; that needs root.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import PLAN, station_command
from guardian_helpers import World, world
from places import ROOT
from run_heads import head_of

from station.files.lookup import BENCHES, find
from station.safety.acknowledgement import (
    notes_of_file,
    refuse_identified,
    refuse_until_acknowledged,
    remember,
)

if sys.platform == "win32" or os.geteuid() != 0 or not shutil.which("unshare"):
    pytest.skip("mount namespaces need root", allow_module_level=True)

NOBODY = 65534
ANSWERS = "mount: done\nconnect-cables: done\ndut-power-on: done\ndut-power-off: done\n"
# The interpreter of the tests may lie in root's home: this user may read there, and write nowhere.
MAY_READ = ("--inh-caps", "+dac_read_search", "--ambient-caps", "+dac_read_search")
INSIDE = 'mount --bind "$1/tmp" /var/tmp && mount --bind "$1/lib" /var/lib && shift && exec "$@"'


class Computer:
    """A computer of the tests' own: its /var, and users whose state folders differ."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.var = folder / "var"
        (self.var / "tmp").mkdir(parents=True)
        (self.var / "tmp").chmod(0o1777)
        (self.var / "lib").mkdir()
        folder.chmod(0o755)

    def station(
        self, *arguments: str, user: int = 0, state: str = "state"
    ) -> subprocess.CompletedProcess[str]:
        """Do a verb as a user."""
        command = station_command(*arguments)
        if user:
            home = self.folder / f"home-{user}"
            home.mkdir(exist_ok=True)
            os.chown(home, user, user)
            as_user = ("--reuid", str(user), "--regid", str(user), "--clear-groups")
            command = ["setpriv", *as_user, *MAY_READ, *command]
            state = str(home / state)
        return subprocess.run(
            ["unshare", "--mount", "sh", "-c", INSIDE, "sh", str(self.var), *command],
            cwd=self.folder,
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
            stdin=subprocess.DEVNULL,
            env={
                **os.environ,
                "XDG_STATE_HOME": str(self.folder / state),
                "PYTHONPATH": str(ROOT),
            },
            timeout=120,
        )

    def runs(self, bench: str, **how: Any) -> subprocess.CompletedProcess[str]:
        """Run the plan; each user has a place for runs."""
        output = f"home-{how['user']}/runs" if how.get("user") else "runs"
        return self.station(
            "run", "plan.yaml", "--bench", bench, "--non-interactive",
            "--answers", "answers.yaml", "--output", output, **how,
        )  # fmt: skip

    def notes(self) -> list[str]:
        folder = self.var / "lib" / "inertial-station" / "trips"
        return sorted(one.name for one in folder.iterdir()) if folder.is_dir() else []


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder into which every user may look; pytest's own are closed to others."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@pytest.fixture
def served(open_folder: Path) -> Iterator[World]:
    with world(open_folder) as one:
        yield one


@pytest.fixture
def computer(open_folder: Path, served: World) -> Computer:
    """A bench file as of real instruments, whose emergency stop is open."""
    data = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))
    del data["simulation"]
    for name, place in head_of(open_folder)["instruments"].items():
        entry = data["instruments"][name]
        entry.pop("simulator", None)
        if not entry.get("shares"):
            entry["address"] = place["address"]
    data["name"] = "lab"
    (open_folder / "lab.yaml").write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    (open_folder / "plan.yaml").write_text(PLAN, encoding="utf-8")
    (open_folder / "answers.yaml").write_text(ANSWERS, encoding="utf-8")
    served.report()  # from now on it listens
    served.inject(instrument="interlock_chain", fault="chain-open", contact="door")
    return Computer(open_folder)


@pytest.mark.campaign
def test_a_trip_is_refused_under_every_name_state_folder_and_account_until_acknowledged(
    computer: Computer, served: World
) -> None:
    tripped = computer.runs("lab.yaml")
    assert tripped.returncode == 5, tripped.stderr
    assert "chain is open (open: door)" in tripped.stderr
    assert computer.notes()

    copy = computer.folder / "copy.yaml"
    text = (computer.folder / "lab.yaml").read_text(encoding="utf-8")
    copy.write_text(text.replace("name: lab", "name: another"), encoding="utf-8")
    (computer.folder / "lab.yaml").rename(computer.folder / "renamed.yaml")
    for bench, how in (
        ("copy.yaml", {}),
        ("renamed.yaml", {}),
        ("copy.yaml", {"state": "another-state"}),
        ("renamed.yaml", {"user": NOBODY}),
    ):
        refused = computer.runs(bench, **how)
        assert refused.returncode == 5, (bench, how, refused.stderr)
        assert "may not be used, nothing was opened or energised" in refused.stderr
        assert f"`station acknowledge {bench}`" in refused.stderr

    # Another account cannot delete the note: it counts as acknowledged by what stands beside it.
    before = computer.notes()
    done = computer.station("acknowledge", "copy.yaml", "--json", user=NOBODY)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["acknowledged"]["interlock"] == "chain"
    assert set(before) < set(computer.notes())
    again = computer.runs("renamed.yaml")
    assert "may not be used" not in again.stderr
    assert "chain is open (open: door)" in again.stderr, "it tripped anew"
    assert computer.runs("copy.yaml", user=NOBODY).returncode == 5


@pytest.mark.campaign
def test_an_instrument_at_another_address_is_known_by_what_it_says(
    computer: Computer, served: World
) -> None:
    assert computer.runs("lab.yaml").returncode == 5
    text = (computer.folder / "lab.yaml").read_text(encoding="utf-8")
    moved = text.replace("TCPIP::127.0.0.1::", "TCPIP::127.1::")
    (computer.folder / "moved.yaml").write_text(moved, encoding="utf-8")
    refused = computer.runs("moved.yaml")
    assert refused.returncode == 5, refused.stderr
    assert "the bench moved may not be used, nothing was" in refused.stderr
    assert "on the same instruments by" in refused.stderr
    assert computer.station("acknowledge", "moved.yaml").returncode == 0
    assert "may not be used" not in computer.runs("lab.yaml").stderr


@pytest.mark.campaign
def test_links_and_strange_files_in_the_shared_place_are_not_followed(
    computer: Computer,
) -> None:
    tmp_path = computer.folder
    victim = tmp_path / "victim"
    victim.mkdir()
    for place in ("tmp", "lib"):
        (computer.var / place / "inertial-station").symlink_to(victim)
    assert computer.runs("lab.yaml").returncode == 5
    assert list(victim.iterdir()) == []
    # Then the user's own state folder remembers it.
    assert list((tmp_path / "state" / "inertial-station" / "trips").iterdir())
    assert "may not be used" in computer.runs("lab.yaml").stderr


def test_two_names_of_one_bench_file_are_one_bench(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    bench = tmp_path / "bench.yaml"
    bench.write_text("simulation: {}\n", encoding="utf-8")
    (tmp_path / "soft.yaml").symlink_to(bench)
    (tmp_path / "hard.yaml").hardlink_to(bench)
    remember(bench, "door", "the door is open", tmp_path)
    for name in ("bench.yaml", "soft.yaml", "hard.yaml"):
        assert len(notes_of_file(tmp_path / name)) == 1
    refuse_until_acknowledged(tmp_path / "other.yaml", [])
    refuse_identified(bench, {"": ("SC10", "not told")})
