"""`station export`."""

from __future__ import annotations

from pathlib import Path

from station.record.folder import EXPORTS, RunFolder


def export_run(path: Path, format: str) -> None:
    """Write the raw data of a run into its `exports` folder, and print the path of what it wrote.

    HDF5 and MAT are one file each, CSV is a folder with a file for each source and unit of work.
    """
    folder = RunFolder(path)
    exports = path / EXPORTS
    name = path.resolve().name
    if format == "hdf5":
        from station.exporting.hdf5 import export_hdf5

        written = exports / f"{name}.h5"
        export_hdf5(folder, written)
    elif format == "mat":
        from station.exporting.mat import export_mat

        written = exports / f"{name}.mat"
        export_mat(folder, written)
    else:
        from station.exporting.csv_files import export_csv

        written = exports / "csv"
        export_csv(folder, written)
    print(written)
