"""Read an imported dataset: a folder with `dataset.yaml` and the CSV or TDMS files it names."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from station.dataset_tdms import is_tdms, read_channels
from station.fields import StrictModel
from station.files.faults import Fault, FaultList, listed, nearest, not_there
from station.files.lookup import in_place_of_file, is_there
from station.files.validation import check_model, validate_model
from station.files.yaml.reading import Document, read_text, read_yaml

DATASET_FILE = "dataset.yaml"
LARGEST = 1e38
"""Nothing that is measured is larger in its unit, and its powers can still be computed."""
MAX_FAULTS = 20
BLOCK_LINES, BLOCK_CHARACTERS = 20_000, 1_000_000
"""What is taken apart at once: the words of a row take thirty times its numbers' memory."""

Model = TypeVar("Model", bound=StrictModel)
Words = Annotated[str, Field(min_length=1)]


class DatasetHeader(StrictModel):
    """The keys of a dataset; the procedure's own model reads `conditions`."""

    dataset: Literal[1]
    procedure: Words
    title: str | None = None
    files: Annotated[dict[str, Words], Field(min_length=1)]
    conditions: dict[str, Any]


@dataclass(frozen=True)
class RawDataset:
    """A dataset folder whose files are all there; nothing of their content is read yet."""

    document: Document
    procedure: str
    folder: Path
    files: dict[str, Path]

    def file(self, name: str) -> Path:
        """Return the file that the dataset calls `name`; raise FaultList when there is none."""
        if name in self.files:
            return self.files[name]
        hint = nearest(name, self.files)
        what = "is missing" + (f"; '{hint}' is not known here" if hint else "")
        raise FaultList([self.document.fault(("files", name), what)])

    def conditions(self, model: type[Model]) -> Model:
        """Return the dataset's conditions; raise FaultList with every fault in them."""
        return validate_model(self.document, model, at=("conditions",))

    def read_table(
        self,
        name: str,
        required: Sequence[str],
        optional: Sequence[str] = (),
        text: Sequence[str] = (),
        rising: str | None = None,
    ) -> Table:
        """Return the table of the file that the dataset calls `name`, as `read_table` does.

        `rising` names the column of times, in which each row must be after the one above.
        """
        table = read_table(self.file(name), required, optional, text, group=name)
        if rising is not None:
            check_ascending(table.path, table, rising)
        return table

    def require_files(self, needed: Iterable[str], optional: Iterable[str] = ()) -> None:
        """Raise FaultList unless the dataset names the needed files and no unknown one."""
        needed = list(needed)
        known = [*needed, *optional]
        faults = [
            self.document.fault(("files", name), "is missing")
            for name in needed
            if name not in self.files
        ]
        for name in self.files:
            if name not in known:
                hint = nearest(name, known)
                what = "is not known here" + ("" if hint else f"; known are {listed(known)}")
                where = ("files", name)
                fault = self.document.fault(where, what, hint and f"'{hint}'", at_key=True)
                faults.append(fault)
        if faults:
            raise FaultList(faults)


class Table(dict[str, NDArray[Any]]):
    """The columns of a file by name; `lines` holds the line number of each row."""

    def __init__(self, path: Path, columns: dict[str, NDArray[Any]], lines: array[int]) -> None:
        super().__init__(columns)
        self.path = path
        self.lines = lines

    def fault(self, row: int, column: str, what: str, hint: str | None = None) -> Fault:
        """Return a fault in a row, counted from 0, and a column."""
        return Fault(str(self.path), self.lines[row], 1, column, what, hint)

    def unknown_words(self, column: str, known: Sequence[str]) -> list[Fault]:
        """Return a fault for each row whose word is not one of the known ones."""
        faults = []
        for row, word in enumerate(self[column].tolist()):
            if word not in known:
                fault = not_there(f"there is no {column} '{word}'", word, known)
                faults.append(self.fault(row, column, *fault))
        return faults


def refuse(faults: Sequence[Fault]) -> None:
    """Raise FaultList with the first faults, where there are any."""
    if faults:
        raise FaultList(faults[:MAX_FAULTS])


def read_dataset(path: Path) -> RawDataset:
    """Read `dataset.yaml`, given as the file or as its folder; raise FaultList with every fault."""
    file = path / DATASET_FILE if path.is_dir() else path
    document = read_yaml(file)
    header, faults = check_model(document, DatasetHeader)
    named = document.data.get("files")
    files: dict[str, Path] = {}
    for name, text in named.items() if isinstance(named, dict) else ():
        if not isinstance(text, str) or not text:
            continue
        outside = PurePosixPath(text).is_absolute() or PureWindowsPath(text).drive
        if outside or ".." in text.replace("\\", "/").split("/"):
            what = f"'{text}' lies outside the dataset's folder; copy it into the folder"
            faults.append(document.fault(("files", name), what))
        elif is_none := in_place_of_file(file.parent / text):
            faults.append(document.fault(("files", name), f"'{text}' {is_none}"))
        elif not is_there(file.parent / text):
            there = [
                path.name
                for path in sorted(file.parent.iterdir())
                if path.suffix == ".csv" or is_tdms(path)
            ]
            hint = nearest(text, there)
            what = f"there is no file '{text}' in the dataset's folder"
            faults.append(document.fault(("files", name), what, hint and f"'{hint}'"))
        files[name] = file.parent / text
    if header is None or faults:
        raise FaultList(faults)
    return RawDataset(document, header.procedure, file.parent, files)


def read_table(
    path: Path,
    required: Sequence[str],
    optional: Sequence[str] = (),
    text: Sequence[str] = (),
    group: str = "",
) -> Table:
    """Read a CSV file with a header line: columns of finite numbers, and of words for `text`.

    `required` columns must be there, `optional` ones may be, any other is a fault; `text` names
    which of them hold words. Raises FaultList with file, line and column of each fault (the first
    20), the line counted from 1 for the header. Of a TDMS file the channels of a `group` are read.
    """
    if is_tdms(path):
        return _read_tdms(path, required, optional, text, group)
    lines = _lines(path)
    first = next(lines, None)
    if first is None:
        raise FaultList([Fault(str(path), 1, 1, "file", "the file is empty")])
    header_line, header = first
    cells = _cells(header)
    names = [cell.strip() for cell in cells]
    if "," not in header and any(mark in header for mark in ";\t") and {*required} - {*names}:
        what = "the columns are separated by ';' or tabs; separate them by ','"
        raise FaultList([Fault(str(path), header_line, 1, "header", what)])
    faults = _header_faults(path, header_line, cells, required, optional)
    if faults:
        raise FaultList(faults)
    numbers = array("q")
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
    while block := list(islice(lines, BLOCK_LINES)):
        rows = [(number, _cells(line)) for number, line in block]
        faults += [
            Fault(
                str(path), number, 1, "row", f"has {_cells_in_words(len(cells))}, not {len(names)}"
            )
            for number, cells in rows
            if len(cells) != len(names)
        ]
        rows = [row for row in rows if len(row[1]) == len(names)]
        numbers.extend(number for number, _ in rows)
        for index, name in enumerate(names):
            values, more = _column(path, name, index, rows, words=name in text)
            columns[name].append(values)
            faults += more
    if not numbers and not faults:
        what = "the file has a header but no rows"
        raise FaultList([Fault(str(path), header_line, 1, "file", what)])
    if faults:
        raise FaultList(_first(faults, path))
    whole = {name: np.concatenate(values) for name, values in columns.items()}
    return Table(path, whole, numbers)


def _read_tdms(
    path: Path,
    required: Sequence[str],
    optional: Sequence[str],
    text: Sequence[str],
    group: str,
) -> Table:
    """Return the channels of a group as the columns that a CSV file would give, checked alike."""
    channels = read_channels(path, group)
    if faults := _header_faults(path, 1, list(channels), required, optional):
        raise FaultList(faults)
    columns: dict[str, NDArray[Any]] = {}
    for name, values in ((name.strip(), values) for name, values in channels.items()):
        if name in text:
            columns[name] = np.array([str(word).strip() for word in values], dtype=np.str_)
            bad = [n for n, word in enumerate(columns[name]) if not word]
        elif values.dtype.kind not in "fiu":
            what = "holds no numbers; write numbers in the unit that its name has"
            raise FaultList([Fault(str(path), 1, 1, name, what)])
        else:
            columns[name] = values.astype(np.float64)
            with np.errstate(invalid="ignore"):
                bad = np.flatnonzero(~(np.abs(columns[name]) < LARGEST)).tolist()
        for n in bad[: MAX_FAULTS + 1]:
            faults.append(Fault(str(path), n + 1, 1, name, _bad_cell(str(values[n]))))
    rows = len(next(iter(columns.values())))
    if not rows:
        raise FaultList([Fault(str(path), 1, 1, "file", "the file has channels but no values")])
    if faults:
        raise FaultList(_first(faults, path))
    return Table(path, columns, array("q", range(1, rows + 1)))


def _bad_cell(cell: str) -> str:
    """Return what is wrong with a cell that holds no finite number, or no word."""
    if not cell.strip():
        return "is empty"
    if LARGEST <= abs(_number(cell)) < math.inf:
        return f"'{cell.strip()}' is too large for anything that is measured"
    return f"'{cell.strip()}' is not a number"


def _column(
    path: Path, name: str, index: int, rows: list[tuple[int, list[str]]], *, words: bool
) -> tuple[NDArray[Any], list[Fault]]:
    """Return a column of a block of rows, and its cells that are empty or no number."""
    cells = [row[index] for _, row in rows]
    if words:
        values: NDArray[Any] = np.array([cell.strip() for cell in cells], dtype=np.str_)
        bad = [n for n, cell in enumerate(cells) if not cell.strip()]
    else:
        values, bad = _numbers(cells)
    faults = []
    for n in bad:
        number, row = rows[n]
        column = 1 + sum(len(cell) + 1 for cell in row[:index])
        faults.append(Fault(str(path), number, column, name, _bad_cell(cells[n])))
    return values, faults


def check_ascending(path: Path, table: Table, column: str, *, strictly: bool = True) -> None:
    """Raise FaultList where times run backwards, or stand still unless `strictly` is false."""
    values = table[column]
    steps = np.diff(values)
    wrong = np.flatnonzero(steps <= 0 if strictly else steps < 0) + 1
    faults = []
    for n in wrong:
        verb = "repeats" if values[n] == values[n - 1] else "is before"
        what = f"{values[n]:.10g} {verb} {values[n - 1]:.10g} of the row above; times must rise"
        faults.append(Fault(str(path), table.lines[n], 1, column, what))
    if faults:
        raise FaultList(_first(faults, path))


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines that hold something, with their numbers; never all of them at once."""
    text = read_text(path)
    begins = number = 0
    while begins < len(text):
        ends = text.find("\n", begins + BLOCK_CHARACTERS) + 1 or len(text)
        for line in text[begins:ends].splitlines():
            number += 1
            if line.strip():
                yield number, line
        begins = ends


def _cells(line: str) -> list[str]:
    return next(csv.reader([line])) if '"' in line else line.split(",")


def _cells_in_words(count: int) -> str:
    return "one cell" if count == 1 else f"{count} cells"


def _header_faults(
    path: Path,
    line: int,
    cells: Sequence[str],
    required: Sequence[str],
    optional: Sequence[str],
) -> list[Fault]:
    known = [*required, *optional]
    names = [cell.strip() for cell in cells]
    missing = [name for name in required if name not in names]
    faults = [Fault(str(path), line, 1, name, "the column is missing") for name in missing]
    column = 1
    seen: set[str] = set()
    for n, (name, cell) in enumerate(zip(names, cells, strict=True)):
        if len(faults) > MAX_FAULTS:
            rest = f"and more faults; the file has {len(names)} columns"
            return [*faults[:MAX_FAULTS], Fault(str(path), line, column, "header", rest)]
        if name in seen:
            faults.append(Fault(str(path), line, column, name, "the column stands twice"))
        elif name not in known:
            hint = nearest(name, missing or known)
            what = "the column is not known" + ("" if hint else f"; known are {listed(known)}")
            shown = name or f"column {n + 1}"
            faults.append(Fault(str(path), line, column, shown, what, hint and f"'{hint}'"))
        seen.add(name)
        column += len(cell) + 1
    return faults


def _numbers(cells: list[str]) -> tuple[NDArray[np.float64], list[int]]:
    """Return the cells as numbers, and the places of those that are no finite number."""
    try:
        if any("_" in cell for cell in cells):
            raise ValueError("Python reads 1_000 as a number, nobody else does")
        values = np.array(cells, dtype=np.str_).astype(np.float64)
    except ValueError:
        values = np.array([_number(cell) for cell in cells])
    with np.errstate(invalid="ignore"):
        return values, np.flatnonzero(~(np.abs(values) < LARGEST)).tolist()


def _number(cell: str) -> float:
    try:
        return math.nan if "_" in cell else float(cell)
    except ValueError:
        return math.nan


def _first(faults: list[Fault], path: Path) -> list[Fault]:
    """Return the first faults in the file's order, and one that counts the others."""
    ordered = sorted(faults, key=lambda fault: (fault.line, fault.column))
    if len(ordered) <= MAX_FAULTS:
        return ordered
    rest = len(ordered) - MAX_FAULTS
    last = ordered[MAX_FAULTS]
    what = f"and {rest} more faults from here on"
    return [*ordered[:MAX_FAULTS], Fault(str(path), last.line, last.column, "file", what)]
