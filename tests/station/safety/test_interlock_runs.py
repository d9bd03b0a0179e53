"""A tripped interlock under a whole run: exit 5, a safe world, and no further run until somebody
has acknowledged it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import station
from faulted_runs import is_safe, run_with
from interlock_helpers import SHIPPED

from station.errors import InterlockTripped, NotAcknowledged
from station.record.folder import RunFolder
from station.runner.execute import Outcome
from station.safety.acknowledgement import (
    HISTORY,
    acknowledge,
    place_of,
    refuse_until_acknowledged,
    remember,
    state_folder,
    unacknowledged,
)

SUPPLY = "coil_supply.y"
OVERDRIVE = {"instrument": SUPPLY, "fault": "overdrive", "at": "120 s"}


@pytest.fixture
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a test a state folder of its own."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "inertial-station"


def event(outcome: Outcome, kind: str) -> dict[str, Any]:
    (one,) = RunFolder(outcome.folder).events_of(kind)
    return dict(one.details)


def test_a_trip_ends_the_run_with_a_safe_world_and_refuses_the_next_one(
    tmp_path: Path, own_state: Path
) -> None:
    outcome, world = run_with(tmp_path, OVERDRIVE)
    assert outcome.exit_code == 5
    assert outcome.error is not None
    assert outcome.error.startswith("the interlock coil-y-current tripped at 1")
    assert "coil_supply.y current is" in outcome.error
    assert "above 8.2 A (for 0.4 s)" in outcome.error
    assert is_safe(world), world
    assert not outcome.unsafe
    told = event(outcome, "interlock-tripped")
    assert told["interlock"] == "coil-y-current"
    assert abs(told["value"]) > 8.2
    assert told["limit"] == "above 8.2 A"

    with pytest.raises(NotAcknowledged) as raised:
        run_with(tmp_path)
    assert "nothing was opened or energised: the interlock coil-y-current" in str(raised.value)
    assert f"`station acknowledge {tmp_path / 'bench.yaml'}`" in str(raised.value)
    assert raised.value.exit_code == 5

    trip = acknowledge(tmp_path / "bench.yaml")
    assert trip is not None
    assert trip.run == str(outcome.folder.resolve())
    refuse_until_acknowledged(tmp_path / "bench.yaml")
    lines = (own_state / HISTORY).read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["interlock"] for line in lines] == ["coil-y-current"]
    assert acknowledge(tmp_path / "bench.yaml") is None


def test_an_open_chain_keeps_a_run_from_beginning(tmp_path: Path, own_state: Path) -> None:
    opened = {"instrument": "interlock_chain", "fault": "chain-open", "contact": "door"}
    outcome, world = run_with(tmp_path, opened)
    assert outcome.exit_code == 5
    assert "chain is open (open: door)" in (outcome.error or "")
    assert world["coils"]["y"]["largest_current_A"] == 0.0
    assert not [one for one in RunFolder(outcome.folder).events if one.kind == "step-started"]


def test_a_bench_is_known_by_its_file_and_place(tmp_path: Path, own_state: Path) -> None:
    one, other = tmp_path / "one" / "bench.yaml", tmp_path / "other" / "bench.yaml"
    trip = InterlockTripped("door", "the door is open", 3.0)
    remember(one, trip.name, str(trip), tmp_path / "run")
    refuse_until_acknowledged(other)
    with pytest.raises(NotAcknowledged):
        refuse_until_acknowledged(one)
    found = unacknowledged(one)
    assert found is not None
    assert found.message == "the interlock door tripped at 3.000 s: the door is open"


def test_a_note_that_cannot_be_read_still_refuses(tmp_path: Path, own_state: Path) -> None:
    bench = tmp_path / "bench.yaml"
    remember(bench, "door", "open", tmp_path)
    place_of(bench).write_text("{", encoding="utf-8")
    with pytest.raises(NotAcknowledged, match="cannot be read"):
        refuse_until_acknowledged(bench)
    assert acknowledge(bench) is not None
    refuse_until_acknowledged(bench)


def test_the_state_folder_is_the_users_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_STATE_HOME")
    assert state_folder().is_relative_to(Path.home())


def test_acknowledge_is_a_verb(tmp_path: Path, own_state: Path) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text(yaml.safe_dump(SHIPPED), encoding="utf-8")
    nothing = station(tmp_path, "acknowledge", "bench.yaml")
    assert (nothing.returncode, nothing.stdout) == (
        0,
        "bench.yaml: no interlock waits to be acknowledged\n",
    )
    remember(bench, "door", "the door is open", tmp_path / "run")
    refused = station(
        tmp_path, "run", "rlg-magnetic-sensitivity", "--bench", "bench.yaml", "--non-interactive"
    )
    assert refused.returncode == 5
    assert "the door is open" in refused.stderr
    assert "station acknowledge" in refused.stderr
    assert not (tmp_path / "runs").exists()
    done = station(tmp_path, "acknowledge", "bench.yaml", "--json")
    told = json.loads(done.stdout)
    assert done.returncode == 0
    assert told["acknowledged"]["interlock"] == "door"
    assert unacknowledged(bench) is None
    missing = station(tmp_path, "acknowledge", "bensh.yaml")
    assert missing.returncode == 2
