"""Every change in a run folder is named; what is no evidence is left out."""

from __future__ import annotations

import base64
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from command_line import begun, station, station_command
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)
from places import SIM
from quick_yaml import dump_yaml, load_yaml
from terminal import OnTerminal

from station.cli.analysing import analyse_run
from station.cli.comparing import compare_runs
from station.cli.looking import print_status
from station.cli.verifying import sign_run, verify_runs
from station.clock import RealClock, utc_now
from station.control.status import read_status
from station.errors import (
    EXIT_OUTSIDE_LIMIT,
    EXIT_UNDETERMINED,
    InputError,
    NotPermitted,
    RecordError,
)
from station.files.locks import FileLock
from station.history.store import History
from station.history.summary import summary_of
from station.record.events import read_events
from station.record.folder import RunFolder, RunRecord
from station.record.integrity import state_of
from station.record.later import add_revision, draft_revision, record_later
from station.record.layout import (
    EVENTS,
    LOCK,
    MANIFEST,
    NOT_COVERED,
    covered_files,
    file_hash,
    write_manifest,
)
from station.record.run_list import entry_of
from station.record.signatures import new_key, sign
from station.record.verification import verify
from station.runner.evaluation import evaluate_run, write_revision

BITS_EACH = 4
NOBODY = 65534


@pytest.fixture
def run(one_axis_run: Path, tmp_path: Path) -> Path:
    """A copy of a finished run."""
    copy = tmp_path / one_axis_run.name
    shutil.copytree(one_axis_run, copy)
    return copy


def test_a_run_as_it_was_left_is_unchanged(run: Path) -> None:
    found = verify(run)
    assert (found.changed, found.no_manifest, found.depth) == ((), False, "whole")
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


def cut_after(folder: Path, kind: str) -> None:
    """Leave the log of a run up to its last event of a kind, its chain whole."""
    log = folder / EVENTS
    lines = log.read_bytes().splitlines(keepends=True)
    events = list(read_events(log))
    last = max(n for n, event in enumerate(events) if event.kind == kind)
    log.write_bytes(b"".join(lines[: last + 1]))


def test_a_killed_run_is_not_proven(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / MANIFEST).unlink()
    cut_after(run, "unit-finished")
    assert verify_runs([run], as_json=False) == EXIT_UNDETERMINED
    assert "not proven" in capsys.readouterr().out


def test_a_manifest_that_is_owed_is_missed_and_the_log_knows_the_results(run: Path) -> None:
    (run / MANIFEST).unlink()
    results = run / "results.json"
    results.write_text(results.read_text(encoding="utf-8").replace("pass", "fail"), "utf-8")
    sentences = " ".join(verify(run).changed)
    assert "manifest.json is missing, though the log says" in sentences
    assert "results.json was changed: events.jsonl has another SHA-256" in sentences
    assert verify_runs([run], as_json=True) == EXIT_OUTSIDE_LIMIT
    cut_after(run, "run-ended")  # as in a log of before it named revisions
    assert "is missing" in " ".join(verify(run).changed)


def analysed(run: Path) -> Path:
    analyse_run(run, None, compare=False)
    return max((run / "revisions").iterdir())


@pytest.mark.parametrize("removed", ["revisions/001", "revisions/000", "revisions"])
def test_a_revision_that_was_removed_is_missed(run: Path, removed: str) -> None:
    assert analysed(run).name == "001"
    assert not verify(run).changed
    shutil.rmtree(run / removed)
    sentences = " ".join(verify(run).changed)
    for number in ("000", "001") if removed == "revisions" else (removed[-3:],):
        assert f"{number} is missing: events.jsonl names this revision" in sentences
    for whole in (True, False):
        assert verify(run, whole=whole).state == "altered"


def test_a_removed_revision_keeps_its_number(run: Path) -> None:
    shutil.rmtree(analysed(run))
    assert analysed(run).name == "002"


def test_a_revision_that_was_added_or_written_anew_is_named(run: Path) -> None:
    second = analysed(run)
    results = second / "results.json"
    results.write_text(results.read_text(encoding="utf-8").replace("pass", "fail"), "utf-8")
    write_manifest(second)
    shutil.copytree(second, second.with_name("002"))
    sentences = " ".join(verify(run).changed)
    assert "001/manifest.json was written anew" in sentences
    assert "002 was added: events.jsonl does not name this revision" in sentences


@pytest.mark.parametrize(
    "end",
    [
        signal.SIGKILL,
        *(
            pytest.param(other, marks=pytest.mark.campaign)
            for other in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        ),
    ],
)
def test_an_analysis_that_was_killed_alters_nothing_and_the_next_one_cleans_up(
    run: Path, end: signal.Signals
) -> None:
    analysis = begun(run.parent, "analyse", run)
    while [path.name for path in (run / "revisions").iterdir()] == ["000"]:
        RealClock().sleep(0.001)
    analysis.send_signal(end)
    analysis.communicate(timeout=60)
    assert [verify(run, whole=whole).state for whole in (True, False)] == ["unchanged"] * 2
    analysed(run)
    # A signal that comes when all is written ends nothing.
    written = ["000", "001", "002"] if analysis.returncode == 0 else ["000", "001"]
    assert sorted(path.name for path in (run / "revisions").iterdir()) == written
    assert not verify(run).changed


def test_while_an_analysis_writes_the_run_is_unchanged_and_another_takes_the_next_number(
    run: Path,
) -> None:
    folder = RunFolder(run)
    document, findings = evaluate_run(folder)
    with draft_revision(run) as draft:
        write_revision(folder, draft, document, findings, report=False)
        assert not verify(run).changed
        assert analysed(run).name == "001"
        assert not verify(run).changed
        assert add_revision(run, draft).name == "002"
    assert sorted(path.name for path in (run / "revisions").iterdir()) == ["000", "001", "002"]
    assert not verify(run).changed


def test_a_look_that_began_before_an_analysis_was_recorded_finds_nothing_wrong(run: Path) -> None:
    analysed(run)
    looked_at = RunFolder(run)
    analysed(run)
    assert state_of(looked_at, whole=False).state == "unchanged"


def test_an_analysis_whose_line_the_log_does_not_take_adds_no_revision(run: Path) -> None:
    folder = RunFolder(run)
    document, findings = evaluate_run(folder)
    _, hard = before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with draft_revision(run) as draft:
        write_revision(folder, draft, document, findings, report=False)
        resource.setrlimit(resource.RLIMIT_FSIZE, ((run / EVENTS).stat().st_size + 100, hard))
        try:
            with pytest.raises(RecordError, match=r"cannot write .*events\.jsonl"):
                add_revision(run, draft)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [path.name for path in (run / "revisions").iterdir()] == ["000"]
    assert not verify(run).changed


def as_of_before(run: Path) -> None:
    """Make a run folder one of before the log named what was done once a run had ended."""
    cut_after(run, "run-ended")
    files = {**covered_files(run), EVENTS: file_hash(run / EVENTS)}
    write_manifest(run, files)


def test_a_run_of_before_is_not_altered(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    second = analysed(run)
    as_of_before(run)
    assert verify_runs([run], as_json=False) == 0
    assert "unchanged, " in (said := capsys.readouterr().out)
    assert "revisions not recorded" in said
    third = analysed(run)
    assert verify_runs([run], as_json=False) == 0
    assert "not recorded" not in capsys.readouterr().out
    shutil.rmtree(third)
    shutil.rmtree(second)  # it was there when the third was recorded
    assert len(verify(run).changed) == 2


def test_an_analysis_while_the_run_goes_on_leaves_the_log_alone_and_is_recorded_at_its_end(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    as_of_before(run)
    log = (run / EVENTS).read_bytes()
    record = RunRecord.go_on(run, RealClock())
    revision = analysed(run)
    assert (run / EVENTS).read_bytes() == log
    assert "is not in the log" in capsys.readouterr().err
    record.close()
    record.seal()
    state = verify(run)
    assert (state.changed, state.recorded) == ((), True)
    shutil.rmtree(revision)
    assert "001 is missing" in " ".join(verify(run).changed)


def test_an_analysis_while_the_run_goes_on_says_so_and_not_that_the_run_ended(
    two_axes_run: Path, tmp_path: Path
) -> None:
    run = Path(shutil.copytree(two_axes_run, tmp_path / "run"))
    for file in (MANIFEST, "results.json", "report.html"):
        (run / file).unlink()
    shutil.rmtree(run / "revisions")
    units = [
        n for n, event in enumerate(read_events(run / EVENTS)) if event.kind == "unit-finished"
    ]
    _, first_axis, _ = units
    lines = (run / EVENTS).read_bytes().splitlines(keepends=True)
    (run / EVENTS).write_bytes(b"".join(lines[: first_axis + 1]))
    lock = FileLock(run / LOCK)
    try:
        document = analyse_run(run, None, compare=False)
    finally:
        lock.release()
    flags = {flag.code: flag.message for flag in document.flags}
    assert (document.verdict, "run-goes-on" in flags) == ("inconclusive", True)
    assert "safe-state-unverified" not in flags
    report = (run / "revisions" / "001" / "report.html").read_text(encoding="utf-8")
    assert not re.search("ended (before|without)|cannot pass", report + " ".join(flags.values()))
    document = analyse_run(run, None, compare=False)  # its process is gone now
    assert "safe-state-unverified" in {flag.code for flag in document.flags}


def test_an_analysis_cut_off_before_the_manifest_was_renewed_is_no_damage(run: Path) -> None:
    manifest = (run / MANIFEST).read_bytes()
    analysed(run)
    (run / MANIFEST).write_bytes(manifest)
    assert not verify(run).changed


def test_what_is_recorded_later_changes_nothing_that_is_said_of_the_run(run: Path) -> None:
    before, results = read_status(run), (run / "results.json").read_bytes()
    second = analysed(run)
    assert read_status(run) == before
    assert (second / "results.json").read_bytes() == results
    assert (analysed(run) / "results.json").read_bytes() == results
    folder = RunFolder(run)
    assert folder.events[-1].time_s == next(folder.events_of("run-ended")).time_s


def test_every_verdict_that_is_shown_is_one_that_is_vouched_for(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert entry_of(run)["verdict"] == "pass"
    results = run / "results.json"
    results.write_text(results.read_text(encoding="utf-8").replace("pass", "fail"), "utf-8")
    entry = entry_of(run)
    assert entry["verdict"] is None
    assert entry["state"].startswith("ALTERED")
    print_status(run, as_json=False)
    assert "ALTERED: `station verify" in capsys.readouterr().out
    print_status(run, as_json=True)
    record = json.loads(capsys.readouterr().out)["record"]
    assert (record["state"], record["depth"]) == ("altered", "quick")
    with pytest.raises(InputError, match="not taken into the history"):
        summary_of(run)
    results.unlink()  # what is gone is no less altered
    assert entry_of(run)["state"].startswith("ALTERED")


def test_the_quick_depth_says_that_it_is_quick(run: Path) -> None:
    (run / "plan.yaml").write_text("another", encoding="utf-8")
    assert verify(run, whole=False).to_data()["depth"] == "quick"
    assert "looked at alone" in verify(run, whole=False).sentence()
    assert verify(run).state == "altered"


def test_what_is_no_run_and_what_is_running_is_refused(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run folder"):
        verify(tmp_path)
    with pytest.raises(InputError, match=r"the path .*absent does not exist"):
        verify(tmp_path / "absent")
    lock = FileLock(run / LOCK)
    try:
        with pytest.raises(InputError, match="is being run"):
            verify(run)
    finally:
        lock.release()


def test_of_several_folders_one_that_cannot_be_verified_hides_no_other(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    running = Path(shutil.copytree(run, tmp_path / "running"))
    lock = FileLock(running / LOCK)
    try:
        assert verify_runs([running, run], as_json=False) == 2
        printed = capsys.readouterr()
        assert f"{run}: unchanged" in printed.out
        assert f"not verified: {running} is being run" in printed.err
        (run / "results.json").unlink()
        assert verify_runs([tmp_path / "none", run, running], as_json=True) == EXIT_OUTSIDE_LIMIT
        runs = json.loads(capsys.readouterr().out)["runs"]
        assert [entry["state"] for entry in runs] == ["altered", "not-verified", "not-verified"]
    finally:
        lock.release()


@contextmanager
def as_nobody() -> Iterator[None]:
    """Go on without root's rights, where this is root."""
    if os.getuid() != 0:
        yield
        return
    os.setresuid(NOBODY, NOBODY, 0)
    try:
        yield
    finally:
        os.setresuid(0, 0, 0)


WITHOUT_RIGHTS = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search"]
UNREADABLE = (
    "run.lock",
    "results.json",
    "raw",
    EVENTS,
    MANIFEST,
    "plan.resolved.yaml",
    "revisions",
)


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_this_user_may_not_read_is_said_to_be_that_and_no_more(
    one_axis_run: Path, name: str
) -> None:
    with TemporaryDirectory() as place:
        run = Path(shutil.copytree(one_axis_run, Path(place) / one_axis_run.name))
        Path(place).chmod(0o755)
        (run / name).chmod(0)
        sentence = f"{name} cannot be read by this user: permission denied"
        with as_nobody():
            for whole in (True, False):
                with pytest.raises(NotPermitted, match=sentence):
                    verify(run, whole=whole)
            with pytest.raises(NotPermitted, match=sentence):
                compare_runs(run, run, as_json=False)
            assert sentence in entry_of(run)["state"]
        command = [*WITHOUT_RIGHTS, *station_command("analyse", run)]
        done = subprocess.run(
            command if os.geteuid() == 0 else command[len(WITHOUT_RIGHTS) :],
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert sentence in done.stderr


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


def edited(run: Path) -> None:
    """Change a result, and write every manifest anew."""
    for place in (run, run / "revisions" / "000"):
        results = place / "results.json"
        results.write_text(results.read_text(encoding="utf-8").replace("pass", "fail"), "utf-8")
        write_manifest(place)


def test_a_signed_run_whose_result_was_changed_is_no_earlier_state(
    run: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sign_run(run, key, "A")
    edited(run)
    assert verify_runs([run], as_json=False) == EXIT_OUTSIDE_LIMIT
    printed = capsys.readouterr().out
    assert "results.json was changed: events.jsonl has another SHA-256" in printed
    assert "an earlier state" not in printed


def test_a_chain_made_anew_is_none_that_was_signed(run: Path, key: Path) -> None:
    """Who writes the log's end anew cannot sign it."""
    sign_run(run, key, "A")
    edited(run)
    as_of_before(run)
    record_later(run, "signed", {"signature": "000.json", "signer": "A", "key": "0" * 64})
    (sentence,) = verify(run).changed
    assert "000.json is no signature of this run: what it signs is no state of this run" in sentence


def test_a_signature_from_before_the_log_named_them_counts_for_its_manifest(
    run: Path, key: Path
) -> None:
    as_of_before(run)
    write_old_signature(run, key)
    assert [signature.state for signature in verify(run).signatures] == ["valid"]
    analysed(run)
    (signature,) = verify(run).signatures
    assert (signature.state, len(signature.after)) == ("earlier", 1)
    edited(run)
    assert "is no signature of this run" in " ".join(verify(run).changed)


def write_old_signature(run: Path, key: Path) -> None:
    private = load_pem_private_key(key.read_bytes(), password=None)
    assert isinstance(private, Ed25519PrivateKey)
    words = json.dumps(
        {"run": run.name, "head": file_hash(run / MANIFEST), "signer": "A", "time": "2026-01-01"}
    )
    kept = {
        "signed": words,
        "signature": base64.b64encode(private.sign(words.encode())).decode(),
        "public_key": base64.b64encode(private.public_key().public_bytes_raw()).decode(),
    }
    (run / "signatures").mkdir()
    (run / "signatures" / "000.json").write_text(json.dumps(kept), encoding="utf-8")


def test_an_earlier_state_was_signed_where_the_log_says_what_came_after(
    run: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sign_run(run, key, "A")
    analysed(run)
    assert verify_runs([run], as_json=False) == 0
    printed = capsys.readouterr().out
    assert "an earlier state was signed by A" in printed
    assert "since then: revision 001 was written" in printed
    assert sign_run(run, key, "A") == 0
    assert [signature.state for signature in verify(run).signatures] == ["earlier", "valid"]


def test_a_signature_that_was_removed_is_missed(run: Path, key: Path) -> None:
    sign_run(run, key, "A")
    (run / "signatures" / "000.json").unlink()
    (sentence,) = verify(run).changed
    assert "000.json is missing: events.jsonl says that A signed at" in sentence


def test_a_signature_copied_from_another_run_is_none(
    run: Path, two_axes_run: Path, key: Path, tmp_path: Path
) -> None:
    other = Path(shutil.copytree(two_axes_run, tmp_path / "other"))
    sign_run(other, key, "A")
    shutil.copytree(other / "signatures", run / "signatures")
    (sentence,) = verify(run).changed
    assert "is no signature of this run: what it signs is no state of this run" in sentence


def test_another_key_in_the_same_name_is_named_and_trust_decides(
    run: Path, key: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    right, wrong = "0", new_key(tmp_path / "other.pem")
    sign_run(run, key, "A")
    assert verify_runs([run], as_json=False) == 0
    sign(run, tmp_path / "other.pem", "A", utc_now())
    right = verify(run).signatures[0].key
    assert verify_runs([run], as_json=False) == EXIT_OUTSIDE_LIMIT
    assert "NOT TRUSTED" in (printed := capsys.readouterr().out)
    assert f"signed in the name of A by another key ({wrong})" in printed
    trusted = tmp_path / "trusted.txt"
    trusted.write_text(f"# ours\n{right} A\n{wrong} A  # the old one\n", encoding="utf-8")
    assert verify_runs([run], as_json=True, trusted=trusted) == 0
    (entry,) = json.loads(capsys.readouterr().out)["runs"]
    assert [signature["trusted"] for signature in entry["signatures"]] == [True, True]


def test_a_run_that_no_trusted_key_signed_is_exit_code_1(
    run: Path, key: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trusted = tmp_path / "trusted.txt"
    trusted.write_text(f"{'a' * 64}\n", encoding="utf-8")
    assert verify_runs([run], as_json=False, trusted=trusted) == EXIT_OUTSIDE_LIMIT
    assert "has no signature by a trusted key" in capsys.readouterr().out
    sign_run(run, key, "A")
    capsys.readouterr()
    assert verify_runs([run], as_json=False, trusted=trusted) == EXIT_OUTSIDE_LIMIT
    (signature,) = verify(run).signatures
    assert f"signed by a key that is not trusted: {signature.key}" in capsys.readouterr().out
    trusted.write_text(f"{signature.key} B\n", encoding="utf-8")  # another's, not A's
    assert verify_runs([run], as_json=False, trusted=trusted) == EXIT_OUTSIDE_LIMIT
    private = load_pem_private_key(key.read_bytes(), password=None)
    public = private.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    trusted.write_bytes(b"# of the laboratory\n" + public)
    assert verify_runs([run], as_json=False, trusted=trusted) == 0
    trusted.write_text("no key\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"trusted.txt:1: no trusted key"):
        verify_runs([run], as_json=False, trusted=trusted)


def test_the_trusted_keys_are_those_of_the_bench_that_is_named(
    run: Path, key: Path, tmp_path: Path
) -> None:
    sign_run(run, key, "A")
    (signature,) = verify(run).signatures
    bench = tmp_path / "lab.yaml"
    laboratory = {"name": "L", "address": "1 Field Road", "trusted_keys": [f"{signature.key} A"]}
    data = load_yaml(SIM.read_text(encoding="utf-8"))
    bench.write_text(dump_yaml({**data, "laboratory": laboratory}), encoding="utf-8")
    assert verify_runs([run], as_json=False, bench=str(bench)) == 0
    # The copy in the folder is a forger's to write: it is not asked.
    assert verify_runs([run], as_json=False, bench="sim") == EXIT_OUTSIDE_LIMIT


def test_any_head_of_the_chain_counts_and_what_came_after_is_listed(
    run: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head = verify(run).head
    analysed(run)
    sign_run(run, key, "A")
    capsys.readouterr()
    for known in (head, head[:16].upper()):
        assert verify_runs([run], as_json=False, head=known) == 0
        printed = capsys.readouterr().out
        assert "2 events since that head" in printed
        assert "revision 001 was written" in printed
    assert verify_runs([run], as_json=True, head=verify(run).heads[0]) == 0
    assert verify_runs([run], as_json=False, head="f" * 64) == EXIT_OUTSIDE_LIMIT
    for short in ("", head[:15]):
        with pytest.raises(InputError, match="give 16 digits"):
            verify_runs([run], as_json=False, head=short)
    as_of_before(run)  # the tail is cut off with what it names: only who has the head finds it
    shutil.rmtree(run / "signatures")
    assert verify_runs([run], as_json=False, head=head) == EXIT_OUTSIDE_LIMIT
    with pytest.raises(InputError, match="one run"):
        verify_runs([run, run], as_json=False, head=head)


@pytest.mark.parametrize("name", ["", " ", "A\x1b[2J", "A\nB", "A\u202eB", "x" * 201])
def test_a_name_that_does_not_print_is_refused(run: Path, key: Path, name: str) -> None:
    with pytest.raises(InputError, match="is no name"):
        sign_run(run, key, name)
    assert not (run / "signatures").exists()


def test_a_pipe_among_the_signatures_hangs_nothing(run: Path) -> None:
    (run / "signatures").mkdir()
    os.mkfifo(run / "signatures" / "000.json")
    os.mkfifo(run / "raw" / "pipe")
    sentences = " ".join(verify(run).changed)
    assert "000.json is no signature of this run: it is no plain file" in sentences
    assert "pipe is no plain file" in sentences


DAMAGES: dict[str, Callable[[Path], object]] = {
    "gone": lambda file: None,
    "empty": lambda file: file.write_bytes(b""),
    "no text": lambda file: file.write_bytes(b'\xff\x00[{"' * 50),
    "deep": lambda file: file.write_bytes(b"[" * 100_000),
    "a list": lambda file: file.write_bytes(b"[1, 2]\n"),
    "a pipe": lambda file: os.mkfifo(file),
    "a folder": lambda file: file.mkdir(),
    "a link": lambda file: file.symlink_to("/etc/hostname"),
}


@pytest.mark.usefixtures("database")
def test_whatever_becomes_of_a_file_is_found_and_hangs_nothing(
    run: Path, key: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    analysed(run)
    sign_run(run, key, "A")
    with closing(History(tmp_path)) as history:
        assert history.take_in() == (1, [])
    whole, chance = tmp_path / "whole", random.Random(7)
    shutil.copytree(run, whole / "run")
    for file in sorted(path.relative_to(run) for path in run.rglob("*") if path.is_file()):
        if file.parts[0] in ("exports", LOCK):
            continue
        for damage in chance.sample(sorted(DAMAGES), 2):
            shutil.rmtree(run)
            shutil.copytree(whole / "run", run)
            (run / file).unlink()
            DAMAGES[damage](run / file)
            assert verify_runs([run], as_json=False) == EXIT_OUTSIDE_LIMIT, (file, damage)
            assert "cannot be read" not in entry_of(run)["state"]
            with closing(History(tmp_path)) as history:
                history.take_in()
                assert len(history.results()) == 1


def encrypted(key: Path, password: bytes) -> Path:
    private = load_pem_private_key(key.read_bytes(), password=None)
    forms = (Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(password))
    key.write_bytes(private.private_bytes(*forms))
    return key


def test_an_encrypted_key_needs_a_terminal(run: Path, key: Path) -> None:
    encrypted(key, b"word")
    done = station(run.parent, "sign", str(run), "--key", str(key), "--signer", "A")
    assert done.returncode == 2
    assert "is encrypted, and there is no terminal to ask for its password" in done.stderr


def test_an_encrypted_key_is_asked_for_its_password(run: Path, key: Path) -> None:
    encrypted(key, b"word")
    for answer, code in (("another", 2), ("word", 0)):
        terminal = OnTerminal(run.parent, "sign", run, "--key", key, "--signer", "A")
        terminal.wait_for("password of the key")
        terminal.type(f"{answer}\n")
        assert terminal.ended() == code, terminal.shown
    assert verify(run).signatures[0].state == "valid"


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


@pytest.mark.parametrize("place", ["", "revisions/000"])
@pytest.mark.parametrize("name", ["run.json", "report.html", "results.json"])
def test_what_an_execution_alone_has_is_held_against_the_log_too(
    name: str, place: str, run: Path
) -> None:
    file = run / place / name
    if not file.is_file():
        return
    file.write_bytes(file.read_bytes().replace(b"20", b"19"))
    write_manifest(file.parent)
    if place:
        write_manifest(run)
    assert verify(run).changed


def test_a_run_without_its_manifest_is_not_signed(run: Path, tmp_path: Path) -> None:
    new_key(tmp_path / "lab.pem")
    (run / MANIFEST).unlink()
    assert sign_run(run, tmp_path / "lab.pem", "A") == 1
