"""A recorded run as one pytest file that replays it: nothing else is needed."""

from __future__ import annotations

from pathlib import Path

from station.errors import InputError
from station.record.layout import BENCH, EVENTS, PLAN
from station.replay.transcript import read_transcripts

HEAD = '''\
"""The transcript of {name}, replayed to the drivers: they do what they did on that bench."""

from pathlib import Path

from station.replay.replaying import replay


def test_the_drivers_do_what_they_did(tmp_path: Path) -> None:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode("utf-8"))
    deviations = replay(tmp_path)
    assert deviations.none, "\\n".join(deviations.lines())


FILES = {{
'''


def write_test(run: Path, file: Path) -> None:
    """Write a pytest file that holds a run's plan, bench, log and transcripts, and replays them.

    Raises InputError where the file is there already, or cannot be written.
    """
    names = [PLAN, BENCH, EVENTS]
    names += [
        transcript.path.relative_to(run).as_posix() for transcript in read_transcripts(run).values()
    ]
    entries = "".join(
        f"    {name!r}: {literal((run / name).read_bytes().decode('utf-8'))},\n" for name in names
    )
    try:
        with file.open("x", encoding="utf-8", newline="\n") as out:
            out.write(HEAD.format(name=run.resolve().name) + entries + "}\n")
    except OSError as error:
        raise InputError(f"{file} cannot be written: {error.strerror or error}") from error


def literal(text: str) -> str:
    """Return a text as a Python literal, readable line by line."""
    lines = "".join(f"        {line!r}\n" for line in text.splitlines(keepends=True))
    return f"(\n{lines}    )" if lines else "''"
