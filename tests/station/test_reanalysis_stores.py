"""Runs of a store that a URL names, evaluated again as those of a folder are."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from botocore.exceptions import ClientError
from bucket import Bucket, bucket
from command_line import PLAN, station
from distributed import LocalCluster
from for_people import need_sentences
from history_runs import made_run as history_run
from made_runs import made_run
from places import SIM
from pyarrow import parquet
from quick_yaml import dump_yaml, load_yaml

from station import registry
from station.cli.reanalysing import TABLE, analyse_store
from station.errors import InputError
from station.files.plan import read_plan
from station.history.store import History
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.reanalysis.one_run import certificates_of, rows_of_run
from station.record.stores import run_at_hand, run_urls
from station.runner.evaluation import conclude_run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with its results."""
    place = tmp_path_factory.mktemp("run")
    data = load_yaml(PLAN)
    data["parameters"] |= {"duration": "50 s", "frequency": "0.2 Hz"}
    (place / "plan.yaml").write_text(dump_yaml(data), encoding="utf-8")
    bench = read_bench(SIM, registry.names(registry.DRIVERS))
    folder = made_run(place / "a", read_plan(place / "plan.yaml", Procedures()), bench)
    conclude_run(folder, report=False)
    return folder


@pytest.fixture
def store(run: Path, tmp_path: Path) -> Path:
    """A folder with that run, one below a shelf whose name has blanks, and an altered one."""
    place = tmp_path / "store"
    shutil.copytree(run, place / run.name)
    shutil.copytree(run, place / "a shelf" / f"{run.name} of a colleague")
    altered = shutil.copytree(run, place / "altered")
    (altered / "bench.resolved.yaml").write_text("name: sim\n", encoding="utf-8")
    return place


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of temporary files; a test leaves it empty."""
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    return place


@pytest.fixture(scope="module")
def served() -> Iterator[Bucket]:
    with bucket() as bucket_:
        yield bucket_


@contextmanager
def cluster() -> Iterator[str]:
    with LocalCluster(
        n_workers=1, processes=False, protocol="tcp", dashboard_address=None
    ) as there:
        yield str(there.scheduler_address)


def table_of(store: str, output: Path) -> list[dict[str, Any]]:
    with cluster() as scheduler:
        analyse_store(store, output, scheduler, None, as_json=True)
    rows: list[dict[str, Any]] = parquet.read_table(output / TABLE).to_pylist()
    return rows


def test_a_store_by_its_url_gives_the_table_of_the_same_folder(
    store: Path, served: Bucket, temporary: Path, tmp_path: Path
) -> None:
    served.upload(store, "runs")
    before = served.keys()
    expected = table_of(str(store), tmp_path / "folder")
    digests = {row["results_sha256"] for row in expected if row["error"] is None}
    assert len(digests) == 1 and [row for row in expected if row["error"]]
    for url in ("s3://laboratory/runs", f"file://{store}"):
        rows = table_of(url, tmp_path / "url")
        for row, other in zip(rows, expected, strict=True):
            assert row["folder"] == other["folder"].replace(str(store), url)
            if row["error"] is not None:
                assert "bench.resolved.yaml" in row["error"]
                assert row["error"].replace(url, str(store)) == other["error"]
            else:
                assert row | {"folder": ""} == other | {"folder": ""}
    assert served.keys() == before
    assert not [*temporary.glob("station-run-*")]


@pytest.mark.campaign
def test_the_workers_of_this_computer_read_a_bucket_by_themselves(
    store: Path, served: Bucket, tmp_path: Path
) -> None:
    served.upload(store, "theirs")
    done = station(tmp_path, "analyse", "--all", "s3://laboratory/theirs", "--output", "again")
    assert done.returncode == 2, done.stderr  # one was altered
    assert "2 of 3 runs evaluated again" in done.stdout
    assert "cannot be evaluated: s3://laboratory/theirs/altered:" in done.stdout


def test_nobody_loads_what_reads_urls_without_one(run: Path) -> None:
    code = (
        "import sys; from station.history.store import History; "
        "from station.reanalysis.one_run import certificates_of; import station.cli.reanalysing; "
        f"assert certificates_of({str(run)!r}); print('fsspec' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, encoding="utf-8", check=True
    )
    assert done.stdout == "False\n"


def test_a_copy_that_is_not_complete_has_a_row_that_says_so(
    run: Path, served: Bucket, temporary: Path, tmp_path: Path
) -> None:
    for name in ("begun", "half", "whole"):
        served.upload(run, f"arriving/{name}")
    served.delete("arriving/begun/manifest.json")
    for folder in ("", "whole/", "whole/raw/"):  # as a browser makes a folder
        served.put(f"arriving/{folder}", b"")
    raw = next(iter((run / "raw").iterdir())).name
    served.delete(f"arriving/half/raw/{raw}")
    rows = {row["run"]: row["error"] for row in table_of("s3://laboratory/arriving", tmp_path)}
    assert rows["whole"] is None
    assert "holds no manifest.json: the copy is not complete" in rows["begun"]
    assert f"lacks 1 files that its manifest.json names, such as raw/{raw}" in rows["half"]
    assert not [*temporary.glob("station-run-*")]


@pytest.mark.parametrize("where", ["s3", "memory"])
def test_no_name_in_a_bucket_writes_outside_the_temporary_folder(
    where: str, run: Path, served: Bucket, temporary: Path, tmp_path: Path
) -> None:
    import fsspec

    store = f"{where}://laboratory/sabotage"
    memory = fsspec.filesystem("memory")

    def put(key: str, content: bytes) -> bool:
        if where == "memory":
            memory.pipe(f"/laboratory/sabotage/{key}", content)
            return True
        try:
            served.put(f"sabotage/{key}", content)
        except ClientError:  # moto takes for another address what leads up
            return False
        return True

    evil = (
        "../evil",
        "../../evil",
        "raw/../../evil",
        "raw//evil",
        "a\\..\\evil",
        "C:evil",
        "\nevil",
    )
    planted = [name for number, name in enumerate(evil) if put(f"run {number}/{name}", b"evil")]
    assert len(planted) >= 3
    for number, name in enumerate(evil):
        for file in (path for path in run.rglob("*") if path.is_file() and name in planted):
            put(f"run {number}/{file.relative_to(run).as_posix()}", file.read_bytes())
    named = sum(put(key, b"{}\n") for key in ("up/../events.jsonl", "a\x1b[31m/events.jsonl"))
    runs = run_urls(store)
    rows = [row for url in runs for row in rows_of_run(url)]
    assert len(rows) == len(runs) == len(planted) + named
    for row in rows:
        assert row["error"].isprintable() and row["run"].isprintable()
    assert not [*temporary.glob("station-run-*")]
    assert not [*tmp_path.rglob("*evil*")]


WRONG = {
    "s3://nothing-here/runs": "no run folder below|cannot be read",
    "s3://laboratory/nothing-here": "no run folder below s3://laboratory/nothing-here",
    "nothing://laboratory/runs": "cannot be read .*nothing",
    "file:///nowhere/runs": "no run folder below file:///nowhere/runs|cannot be read",
    "s3://lab:secret@laboratory/runs": "no password",
    "zip://runs::s3://laboratory/runs.zip": "no second URL",
}


@pytest.mark.parametrize("store", WRONG)
def test_a_store_that_cannot_be_read_is_a_sentence(
    store: str, served: Bucket, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match=WRONG[store]) as raised:
        analyse_store(store, tmp_path, "tcp://nobody:1", None, as_json=False)
    need_sentences(str(raised.value), store)
    assert "secret" not in str(raised.value)


def test_a_store_that_is_gone_or_needs_a_package_is_a_sentence(
    served: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="--output"):
        analyse_store("s3://laboratory/runs", None, "tcp://nobody:1", None, as_json=False)
    done = station(tmp_path, "analyse", "--all", "nothing://runs", "--output", "here")
    assert (done.returncode, "cannot be read" in done.stderr) == (2, True)
    import fsspec

    fsspec.filesystem("s3").clear_instance_cache()
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:1")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    with pytest.raises(InputError, match="s3://laboratory/runs cannot be read") as raised:
        run_urls("s3://laboratory/runs")
    need_sentences(str(raised.value), "gone")
    fsspec.filesystem("s3").clear_instance_cache()
    monkeypatch.setitem(sys.modules, "s3fs", None)
    monkeypatch.delitem(sys.modules["fsspec.registry"]._registry, "s3")  # as in a new process
    with pytest.raises(InputError, match=r"pip install inertial-station\[cluster,s3\]"):
        run_urls("s3://laboratory/runs")


def test_what_is_asked_of_a_run_before_needs_no_raw_data(store: Path, temporary: Path) -> None:
    (run, *_) = run_urls(f"file://{store}")
    with run_at_hand(run, raw=False) as folder:
        assert folder.parent.parent == temporary and not (folder / "raw").exists()
    assert "SIM-F71-0001" in certificates_of(run)
    assert not [*temporary.glob("station-run-*")]


def test_a_history_is_rebuilt_from_a_bucket_without_raw_data(
    served: Bucket, temporary: Path, tmp_path: Path
) -> None:
    whole, altered = (history_run(tmp_path / "runs", day, 1.0) for day in (1, 2))
    (altered / "results.json").write_text("{}", encoding="utf-8")
    for folder in (whole, altered):
        (folder / "raw").mkdir()
        (folder / "raw" / "gyro-000.mcap").write_bytes(b"raw")
    served.upload(tmp_path / "runs", "past")
    with closing(History(tmp_path)) as history:
        count, left_out = history.rebuild_from("s3://laboratory/past")
        (row,) = history.runs()
    assert (count, len(left_out)) == (1, 1)
    assert left_out[0].startswith(f"s3://laboratory/past/{altered.name} is not taken into")
    assert (row["computer"], row["verdict"]) == ("s3://laboratory", "pass")
    assert row["folder"] == f"s3://laboratory/past/{whole.name}"
    assert not [*temporary.glob("station-run-*")]
