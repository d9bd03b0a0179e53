"""Every change in a run folder is named; what is no evidence is left out."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import pytest

from station.cli.verifying import sign_run, verify_runs
from station.errors import EXIT_OUTSIDE_LIMIT, EXIT_UNDETERMINED, InputError
from station.files.locks import FileLock
from station.record.layout import LOCK, MANIFEST, NOT_COVERED
from station.record.signatures import new_key
from station.record.verification import verify

BITS_EACH = 4


@pytest.fixture
def run(one_axis_run: Path, tmp_path: Path) -> Path:
    """A copy of a finished run."""
    copy = tmp_path / one_axis_run.name
    shutil.copytree(one_axis_run, copy)
    return copy


def test_a_run_as_it_was_left_is_unchanged(run: Path) -> None:
    found = verify(run)
    assert (found.changed, found.proven) == ((), True)
    assert found.to_data()["state"] == "unchanged"


def test_every_changed_bit_is_named_with_its_file(run: Path) -> None:
    chance = random.Random(1)
    files = [
        path
        for path in sorted(run.rglob("*"))
        if path.is_file() and path.relative_to(run).parts[0] not in NOT_COVERED
    ]
    assert {"events.jsonl", MANIFEST, "results.json", "plan.yaml"} <= {one.name for one in files}
    assert any(path.suffix == ".mcap" for path in files)
    for path in files:
        before = path.read_bytes()
        for _ in range(BITS_EACH if before else 0):
            at = chance.randrange(len(before))
            changed = bytearray(before)
            changed[at] ^= 1 << chance.randrange(8)
            path.write_bytes(changed)
            said = " ".join(verify(run).changed)
            assert path.name in said, (path.name, at, said)
        path.write_bytes(before)
    assert not verify(run).changed


def test_files_that_were_lost_or_added_are_named(run: Path) -> None:
    (run / "results.json").unlink()
    (run / "raw" / "more.csv").write_text("1,2\n", encoding="utf-8")
    (run / "other.yaml").symlink_to(run / "plan.yaml")
    said = verify(run).changed
    assert [one.partition(" ")[0].rpartition("/")[2] for one in said] == [
        "results.json",
        "other.yaml",
        "more.csv",
    ]


def test_an_edited_verdict_is_named(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = run / "results.json"
    results.write_text(results.read_text(encoding="utf-8").replace("pass", "fail"), "utf-8")
    assert verify_runs([run], as_json=True) == EXIT_OUTSIDE_LIMIT
    (one,) = json.loads(capsys.readouterr().out)["runs"]
    assert one["state"] == "altered"
    assert "results.json was changed" in one["changed"][0]


def test_an_exported_file_is_no_change(run: Path) -> None:
    (run / "exports").mkdir(exist_ok=True)
    (run / "exports" / "more.csv").write_text("1\n", encoding="utf-8")
    assert not verify(run).changed


def test_a_revision_without_a_manifest_is_named(run: Path) -> None:
    (run / "revisions" / "007").mkdir(parents=True)
    (said,) = verify(run).changed
    assert "007 was added" in said


def test_a_killed_run_is_not_proven(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / MANIFEST).unlink()
    assert verify_runs([run], as_json=False) == EXIT_UNDETERMINED
    assert "not proven" in capsys.readouterr().out


def test_what_is_no_run_and_what_is_running_is_refused(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run folder"):
        verify(tmp_path)
    lock = FileLock(run / LOCK)
    try:
        with pytest.raises(InputError, match="is being run"):
            verify(run)
    finally:
        lock.release()


@pytest.fixture
def key(tmp_path: Path) -> Path:
    """A laboratory's private key."""
    new_key(tmp_path / "key.pem")
    return tmp_path / "key.pem"


def test_a_signed_run_says_who_signed_it_and_when(
    run: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert key.stat().st_mode & 0o777 == 0o600
    assert sign_run(run, key, "A. Metrologist") == 0
    assert verify_runs([run], as_json=False) == 0
    assert "signed by A. Metrologist at 20" in capsys.readouterr().out
    (signature,) = verify(run).signatures
    assert (signature.state, len(signature.key)) == ("valid", 64)


def test_a_signature_of_another_state_counts_for_that_one_alone(run: Path, key: Path) -> None:
    sign_run(run, key, "A")
    manifest = run / MANIFEST
    manifest.write_bytes(manifest.read_bytes() + b"\n")
    assert [signature.state for signature in verify(run).signatures] == ["earlier"]
    assert sign_run(run, key, "A") == EXIT_OUTSIDE_LIMIT
    assert len(list((run / "signatures").iterdir())) == 1


@pytest.mark.parametrize("what", ["signed", "signature", "public_key"])
def test_a_signature_that_was_altered_is_named(run: Path, key: Path, what: str) -> None:
    sign_run(run, key, "A")
    (path,) = (run / "signatures").iterdir()
    kept = json.loads(path.read_text(encoding="utf-8"))
    kept[what] = kept[what][::-1]
    path.write_text(json.dumps(kept), encoding="utf-8")
    (sentence,) = verify(run).changed
    assert sentence == f"{path} is no signature of this run: it was altered"


def test_a_key_that_is_none_is_refused_and_no_key_is_overwritten(run: Path, key: Path) -> None:
    with pytest.raises(InputError, match="cannot write the key"):
        new_key(key)
    key.write_text("no key", encoding="utf-8")
    with pytest.raises(InputError, match="cannot read the key"):
        sign_run(run, key, "A")
    (run / MANIFEST).unlink()
    with pytest.raises(InputError, match="sign a run once it has ended"):
        sign_run(run, key, "A")
