"""MATLAB file of level 5: structs per source and unit of work, with names valid in MATLAB.

`raw.<source>.<unit>.<column>` is a column vector; `units` and `long_names` beside them say what
the columns are. `events`, `plan`, `bench` and `results` are as in the run folder.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat
from scipy.io.matlab import MatWriteError

from station.errors import RecordError
from station.record.export.reading import (
    RecordedSource,
    blocks_of,
    exported_file,
    sources,
    texts_of,
)

if TYPE_CHECKING:
    from station.record.folder import RunFolder

MAX_NAME = 63
LARGEST_BYTES = 2**31 - 2**20
"""A variable of a level 5 file is below 2 GB, and all raw data is one."""

KEYWORDS = frozenset(
    [
        "break",
        "case",
        "catch",
        "classdef",
        "continue",
        "else",
        "elseif",
        "end",
        "for",
        "function",
        "global",
        "if",
        "otherwise",
        "parfor",
        "persistent",
        "return",
        "spmd",
        "switch",
        "try",
        "while",
    ]
)


def export_mat(folder: RunFolder, path: Path) -> None:
    """Write a run's raw data, events and texts to a MATLAB file that appears whole.

    Units that were not measured to their end have `finished` false. Raises RecordError when it
    cannot be written, or when the data are more than a file of level 5 holds.
    """
    size = sum(file.stat().st_size for file in (folder.path / "raw").glob("*.mcap"))
    if size > LARGEST_BYTES:
        raise RecordError(
            f"{folder.path}: {size / 1e9:.1f} GB of raw data do not fit into a MATLAB file of "
            "level 5; use --format hdf5, which MATLAB reads with h5read"
        )
    names = sources(folder)
    raw = {
        valid: source_struct(folder, source)
        for valid, source in zip(valid_names(names), names, strict=True)
    }
    variables = {"raw": raw, "events": events_struct(folder), **texts_of(folder)}
    with exported_file(path) as part:
        try:
            savemat(
                part,
                variables,
                format="5",
                long_field_names=True,
                do_compression=True,
                oned_as="column",
                appendmat=False,
            )
        except MatWriteError as error:
            raise RecordError(
                f"{folder.path} does not fit into a MATLAB file of level 5 ({error}); "
                "use --format hdf5"
            ) from error


def source_struct(folder: RunFolder, source: str) -> dict[str, Any]:
    """Return the struct of a source, a field for each unit of work."""
    blocks: dict[str, list[dict[str, NDArray[Any]]]] = {}
    recordings: dict[str, RecordedSource] = {}
    for recording, rows in blocks_of(folder, source):
        recordings[recording.unit] = recording
        blocks.setdefault(recording.unit, []).append(recording.arrays(rows))
    return {
        valid: unit_struct(recording, blocks[recording.unit])
        for valid, recording in zip(valid_names(recordings), recordings.values(), strict=True)
    }


def unit_struct(recording: RecordedSource, blocks: list[dict[str, NDArray[Any]]]) -> dict[str, Any]:
    """Return the struct of a unit of work: its columns, and what they are."""
    own = ("unit_of_work", "finished", "units", "long_names")
    columns = recording.columns
    valid = valid_names([*own, *(column.name for column in columns)])[len(own) :]
    return {
        "unit_of_work": recording.unit,
        "finished": np.bool_(recording.finished),
        "units": {name: column.unit for name, column in zip(valid, columns, strict=True)},
        "long_names": {name: column.meaning for name, column in zip(valid, columns, strict=True)},
        **{
            name: np.concatenate([arrays[column.name] for arrays in blocks])
            for name, column in zip(valid, columns, strict=True)
        },
    }


def events_struct(folder: RunFolder) -> dict[str, Any]:
    """Return the log: run time in s, kind, and details as JSON texts for `jsondecode`."""
    details = [json.dumps(event.details, ensure_ascii=False) for event in folder.events]
    return {
        "time_s": np.array([event.time_s for event in folder.events], dtype=np.float64),
        "event": cells([event.kind for event in folder.events]),
        "details": cells(details),
    }


def cells(texts: list[str]) -> NDArray[np.object_]:
    """Return texts as a column of cells, shape (n, 1)."""
    array = np.empty((len(texts), 1), dtype=object)
    array[:, 0] = texts
    return array


def valid_names(names: Iterable[str]) -> list[str]:
    """Return different names that MATLAB takes as fields, in order, as near as may be to `names`.

    A letter, then letters, digits and underscores, 63 at most, and no keyword.
    """
    chosen: list[str] = []
    for name in names:
        valid = re.sub(r"[^A-Za-z0-9_]", "_", name)
        if not re.match(r"[A-Za-z]", valid) or valid in KEYWORDS:
            valid = f"x{valid}"
        valid = candidate = valid[:MAX_NAME]
        number = 1
        while candidate in chosen:
            number += 1
            ending = f"_{number}"
            candidate = valid[: MAX_NAME - len(ending)] + ending
        chosen.append(candidate)
    return chosen
