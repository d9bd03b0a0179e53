"""A simulated bench that another process serves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from guardian_helpers import world


@contextmanager
def served_bench(
    folder: Path,
    speed: float,
    bench: str = "sim",
    procedure: str = "rlg-magnetic-sensitivity",
) -> Iterator[tuple[Path, float]]:
    """Serve a simulated bench in another process; yield the file `--served` takes and its epoch."""
    with world(folder, speed, bench, procedure) as served:
        yield served.head, served.epoch_unix
