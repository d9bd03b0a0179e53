"""HDF5 with the attributes of NeXus (NXroot, NXentry, NXdata), for MATLAB, LabVIEW and Python.

`raw/<source>/<unit of work>` is an NXdata group: a dataset for each column with `units` and
`long_name`, its `signal`, and its time axes in s. Only gzip and shuffle are used, which every HDF5
library reads. Source: NeXus manual, NXdata and "associating plottable data".
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from station import __version__
from station.record.export.reading import (
    Column,
    RecordedSource,
    blocks_of,
    exported_file,
    sources,
    texts_of,
)

if TYPE_CHECKING:
    from station.record.folder import RunFolder

CHUNK_ROWS = 8192
GZIP_LEVEL = 4
FEW_ROWS = 512
GROWING: dict[str, Any] = {
    "maxshape": (None,),
    "chunks": (CHUNK_ROWS,),
    "shuffle": True,
    "compression": "gzip",
    "compression_opts": GZIP_LEVEL,
}


def export_hdf5(folder: RunFolder, path: Path) -> None:
    """Write a run's raw data, events and texts to an HDF5 file that appears whole.

    Units of work that were not measured to their end are written too, with `state` `unfinished`.
    Raises RecordError when it cannot be written.
    """
    with exported_file(path) as part, Sink(part) as sink, h5py.File(sink, "w") as file:
        file.attrs.update({"NX_class": "NXroot", "creator": f"station {__version__}"})
        file.attrs["run"] = folder.path.name
        raw = file.create_group("raw")
        raw.attrs["NX_class"] = "NXentry"
        for source in sources(folder):
            write_source(raw, folder, source)
        set_default(raw)
        set_default(file, "raw")
        write_events(file, folder)
        for name, text in texts_of(folder).items():
            file.create_dataset(name, data=text, dtype=h5py.string_dtype("utf-8"))


def write_source(raw: h5py.Group, folder: RunFolder, source: str) -> None:
    """Write all units of work of a source below `raw/<source>`."""
    group = raw.create_group(source)
    group.attrs["NX_class"] = "NXsubentry"
    units: dict[str, UnitWriter] = {}
    for recording, rows in blocks_of(folder, source):
        if recording.unit not in units:
            units[recording.unit] = UnitWriter(group, recording)
        units[recording.unit].write(recording.arrays(rows))
    for unit in units.values():
        unit.flush()
    set_default(group)


class UnitWriter:
    """One unit of work of one source: an NXdata group whose datasets grow by whole chunks."""

    def __init__(self, parent: h5py.Group, recording: RecordedSource) -> None:
        self._recording = recording
        self._waiting: list[dict[str, NDArray[Any]]] = []
        self._rows = 0
        self._group = parent.create_group(group_name(recording.unit))
        self._group.attrs.update(
            {
                "NX_class": "NXdata",
                "title": f"{recording.source}: {recording.unit}",
                "unit_of_work": recording.unit,
                "state": recording.state,
            }
        )
        signals = [column.name for column in recording.signals]
        axes = [column.name for column in recording.axes]
        if signals:
            self._group.attrs["signal"] = signals[0]
        if signals[1:]:
            self._group.attrs["auxiliary_signals"] = texts(signals[1:])
        if axes:
            self._group.attrs["axes"] = texts(axes[:1])
        for axis in axes:
            self._group.attrs[f"{axis}_indices"] = np.int32(0)

    def write(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Append rows, an array for each column."""
        self._waiting.append(arrays)
        self._rows += len(next(iter(arrays.values())))
        if self._rows >= CHUNK_ROWS:
            self.flush()

    def flush(self) -> None:
        """Write what waits to the file."""
        if not self._waiting:
            return
        for column in self._recording.columns:
            values = np.concatenate([arrays[column.name] for arrays in self._waiting])
            append(self._group, column, values)
        self._waiting, self._rows = [], 0


def append(group: h5py.Group, column: Column, values: NDArray[Any]) -> None:
    """Append values to the dataset of a column, which is made when it is new."""
    if column.name not in group:
        # Where few rows are all there are, packing takes more room than it saves.
        stored = GROWING if len(values) > FEW_ROWS else {}
        dataset = group.create_dataset(column.name, data=values, **stored)
        dataset.attrs.update({"units": column.unit, "long_name": column.meaning})
        return
    dataset = group[column.name]
    before = len(dataset)
    dataset.resize(before + len(values), axis=0)
    dataset[before:] = values


def write_events(file: h5py.File, folder: RunFolder) -> None:
    """Write the log as a table: run time, kind, and the details as JSON, a row for each event."""
    group = file.create_group("events")
    group.attrs["NX_class"] = "NXcollection"
    times = np.array([event.time_s for event in folder.events], dtype=np.float64)
    kinds = [event.kind for event in folder.events]
    details = [json.dumps(event.details, ensure_ascii=False) for event in folder.events]
    described: Mapping[str, tuple[NDArray[Any], str]] = {
        "time_s": (times, "run time of the event"),
        "event": (fixed_texts(kinds), "kind of event"),
        "details": (fixed_texts(details), "details of the event, as JSON"),
    }
    for name, (values, meaning) in described.items():
        dataset = (
            group.create_dataset(
                name, data=values, shuffle=True, compression="gzip", chunks=(max(len(values), 1),)
            )
            if len(values)
            else group.create_dataset(name, data=values)
        )
        dataset.attrs["long_name"] = meaning
    group["time_s"].attrs["units"] = "s"


def fixed_texts(values: list[str]) -> NDArray[Any]:
    """Return texts as an array of UTF-8 of one length, which every HDF5 library reads."""
    encoded = [value.encode() for value in values]
    length = max((len(value) for value in encoded), default=1)
    return np.array(encoded, dtype=h5py.string_dtype("utf-8", max(length, 1)))


def texts(values: list[str]) -> NDArray[Any]:
    """Return names as the value of an attribute."""
    return np.array(values, dtype=h5py.string_dtype("utf-8"))


def set_default(group: h5py.Group, name: str | None = None) -> None:
    """Name the group that a viewer shows first: `name`, or the first one."""
    first = name or next((key for key in group if isinstance(group[key], h5py.Group)), None)
    if first is not None:
        group.attrs["default"] = first


def group_name(unit: str) -> str:
    """Return a unit of work's name as that of a group: HDF5 knows `/` and `.` as paths."""
    return re.sub(r"^\.+$", "_", unit.replace("/", "_"))


class Sink(io.RawIOBase):
    """A file for a library that crashes when a write fails, as HDF5 does on a full disk.

    It takes everything; what it could not write is raised at its end, instead of whatever the
    library made of it.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w+b", buffering=0)
        self._error: OSError | None = None

    def __exit__(self, *_: object) -> None:
        self.close()
        if self._error is not None:
            raise self._error

    def readable(self) -> bool:
        """Return True."""
        return True

    def writable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a byte of the file."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the present byte of the file."""
        return self._file.tell()

    def readinto(self, buffer: Any) -> int:
        """Read into `buffer`; what a full disk did not take reads as zeros."""
        view = memoryview(buffer).cast("B")
        count = self._file.readinto(view) or 0
        if count < len(view) and self._error is not None:
            view[count:] = bytes(len(view) - count)
            return len(view)
        return count

    def write(self, data: Any) -> int:
        """Write all of `data`, or remember why it could not be."""
        left = memoryview(data).cast("B")
        length = len(left)
        try:
            while self._error is None and left:
                left = left[self._file.write(left) :]
        except OSError as error:
            self._error = error
        return length

    def truncate(self, size: int | None = None) -> int:
        """Give the file a length, or remember why it could not be."""
        try:
            return self._file.truncate(size)
        except OSError as error:
            self._error = self._error or error
            return size or 0

    def flush(self) -> None:
        """Do nothing: what was written is with the system already."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()
