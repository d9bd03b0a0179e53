"""`station export`."""

from __future__ import annotations

from pathlib import Path

from station.console import tell
from station.record.folder import EXPORTS
from station.record.integrity import MOST_FLAGS, sentence_of
from station.record.recorded import read_run


def export_run(path: Path, format: str) -> None:
    """Write the raw data of a run into its `exports` folder, and print the path of what it wrote.

    HDF5 and MAT are one file each, CSV is a folder with a file for each source and unit of work.
    Damaged blocks are passed over and named; their units count as unfinished. Raises DamagedRecord
    where plan, bench or log is not the one of the run.
    """
    folder = read_run(path)
    folder.damage.refuse_altered()
    folder.leave_out(folder.damage.units)
    for part in folder.damage.parts[:MOST_FLAGS]:
        tell(sentence_of(part))
    exports = path / EXPORTS
    name = path.resolve().name
    if format == "hdf5":
        from station.record.export.hdf5 import export_hdf5

        written = exports / f"{name}.h5"
        export_hdf5(folder, written)
    elif format == "mat":
        from station.record.export.mat import export_mat

        written = exports / f"{name}.mat"
        export_mat(folder, written)
    else:
        from station.record.export.csv_files import export_csv

        written = exports / "csv"
        export_csv(folder, written)
    print(written)
