"""Columns of a dataset from a TDMS file, as LabVIEW writes them: a channel for each column.

A dataset's file is a group; where the file has but one, its name is no matter. Rows are counted
from 1. Source: NI, "TDMS file format internal structure".
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from station.files.faults import Fault, FaultList, listed

if TYPE_CHECKING:
    from nptdms import TdmsGroup

SUFFIX = ".tdms"
DAMAGE = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, RuntimeError, TypeError),
    *(ValueError, struct.error),
)
"""What the library raises on bytes that are no TDMS."""


def is_tdms(path: Path) -> bool:
    """Whether a file is TDMS by its name."""
    return path.suffix.lower() == SUFFIX


def read_channels(path: Path, group: str) -> Mapping[str, NDArray[Any]]:
    """Return the channels of a file's group, or of the only group that it has.

    An index file beside it is not looked at. Raises FaultList where the file cannot be read, has
    several groups and none of this name, or channels of different lengths.
    """
    from nptdms import TdmsFile

    try:
        with path.open("rb") as file, TdmsFile.open(file) as read:
            if read.file_status.incomplete_final_segment:
                raise _refused(path, "the file ends within its last segment; copy it again")
            groups = [each for each in read.groups() if each.channels()]
            chosen = _chosen(path, groups, group)
            columns = {channel.name: np.asarray(channel[:]) for channel in chosen.channels()}
    except OSError as error:
        raise _refused(path, f"the file cannot be read: {error.strerror or error}") from None
    except DAMAGE:
        raise _refused(path, "the file is no TDMS file, or it is damaged") from None
    names = list(columns)
    for name, values in columns.items():
        if len(values) != len(columns[names[0]]):
            what = f"has {len(values)} values, '{names[0]}' has {len(columns[names[0]])}"
            raise FaultList([Fault(str(path), 1, 1, name, what)])
    return columns


def _chosen(path: Path, groups: list[TdmsGroup], name: str) -> TdmsGroup:
    if not groups:
        raise _refused(path, "the file is empty")
    if len(groups) == 1:
        return groups[0]
    for group in groups:
        if group.name == name:
            return group
    there = listed([group.name for group in groups])
    raise _refused(path, f"the file has several groups and none is called '{name}'; it has {there}")


def _refused(path: Path, what: str) -> FaultList:
    return FaultList([Fault(str(path), 1, 1, "file", what)])
