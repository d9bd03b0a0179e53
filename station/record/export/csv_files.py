"""CSV: one file for each source and unit of work, the columns as recorded, units in the header."""

from __future__ import annotations

import csv
import re
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.record.export.reading import RecordedSource, blocks_of, exported_file, sources
from station.record.files import A_COPY, not_written

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.record.folder import RunFolder

UNFINISHED = ".unfinished"


def export_csv(folder: RunFolder, place: Path) -> None:
    """Write `<source>-<unit>.csv` into `place`; numbers bring back the recorded ones exactly.

    The name of a unit that was not measured to its end says `.unfinished`. Raises RecordError
    when a file cannot be written.
    """
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise not_written(place, error, A_COPY) from error
    for source in sources(folder):
        written: list[Path] = []
        with ExitStack() as open_files:
            writers: dict[str, Any] = {}
            for recording, rows in blocks_of(folder, source):
                if recording.unit not in writers:
                    path = place / file_name(recording)
                    written.append(path)
                    part = open_files.enter_context(exported_file(path))
                    file = part.open("w", encoding="utf-8", newline="")
                    writers[recording.unit] = csv.writer(
                        open_files.enter_context(file), lineterminator="\n"
                    )
                    writers[recording.unit].writerow(headers(recording))
                writers[recording.unit].writerows(as_python(rows))
        for path in written:
            remove_other_state(path)


def file_name(recording: RecordedSource) -> str:
    """Return the name of a unit's file, safe on every system."""
    unit = re.sub(r"[^A-Za-z0-9._-]+", "_", recording.unit)
    return f"{recording.source}-{unit}{'' if recording.finished else UNFINISHED}.csv"


def remove_other_state(path: Path) -> None:
    """Remove the file of an earlier export that said the opposite of the unit's state."""
    stem = path.name.removesuffix(".csv")
    other = stem.removesuffix(UNFINISHED) if stem.endswith(UNFINISHED) else stem + UNFINISHED
    path.with_name(f"{other}.csv").unlink(missing_ok=True)


def headers(recording: RecordedSource) -> list[str]:
    """Return the recorded column names; one that does not end with its unit gets it in brackets."""
    return [
        column.name
        if column.unit == "1" or column.name.endswith(f"_{column.unit}")
        else f"{column.name} [{column.unit}]"
        for column in recording.recorded
    ]


def as_python(rows: NDArray[Any]) -> list[tuple[Any, ...]]:
    """Return rows as tuples of Python numbers, which print with the digits that bring them back."""
    listed: list[tuple[Any, ...]] = rows.tolist()
    return listed
