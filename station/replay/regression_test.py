"""A recorded run as a pytest file of ten lines that replays it, and its data beside it."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from station.errors import InputError
from station.instruments.trace import LINE_SUMS, sums_of
from station.record.layout import BENCH, EVENTS, PLAN
from station.replay.deviations import Deviations
from station.replay.replaying import replay
from station.replay.transcript import read_transcripts

DATA = ".zip"
TEST = '''\
"""The transcript of {name}, replayed to the drivers: they do what they did on that bench."""

from pathlib import Path

from station.replay.regression_test import replayed


def test_the_drivers_do_what_they_did() -> None:
    deviations = replayed(Path(__file__).with_suffix("{data}"))
    assert deviations.none, "\\n".join(deviations.lines())
'''


def write_test(run: Path, file: Path) -> None:
    """Write a pytest file that replays a run, and beside it the run's data.

    Raises InputError where one of the two is there already, or cannot be written.
    """
    data = file.with_suffix(DATA)
    try:
        with file.open("x", encoding="utf-8", newline="\n") as out:
            out.write(TEST.format(name=run.resolve().name, data=DATA))
        with ZipFile(data, "x", ZIP_DEFLATED) as kept:
            for name, content in files_of(run).items():
                kept.writestr(ZipInfo(name), content, ZIP_DEFLATED)
    except OSError as error:
        path = error.filename or file
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from error


def files_of(run: Path) -> dict[str, bytes]:
    """Return what a replay needs of a run folder, byte by byte as it is there."""
    files = {name: (run / name).read_bytes() for name in (PLAN, BENCH, EVENTS)}
    for transcript in read_transcripts(run).values():
        name = transcript.path.relative_to(run)
        content = files[name.as_posix()] = transcript.path.read_bytes()
        sums = run / name.with_suffix(LINE_SUMS)
        lines = content.split(b"\n")[:-1]
        files[name.with_suffix(LINE_SUMS).as_posix()] = (
            sums.read_bytes()
            if sums.is_file()  # what was changed before is not taken for what was recorded
            else "".join(f"{sums_of(line)}\n" for line in lines).encode("ascii")
        )
    return files


def replayed(data: Path) -> Deviations:
    """Replay the run whose data a file holds."""
    with TemporaryDirectory(prefix="station-replay-") as folder:
        with ZipFile(data) as kept:
            kept.extractall(folder)
        return replay(Path(folder))
