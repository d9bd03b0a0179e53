"""Many runs on the processes of Dask: of this computer, or of a cluster by its address."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from station.errors import InputError
from station.reanalysis.one_run import Row, rows_of_run
from station.reanalysis.recall import Recall

if TYPE_CHECKING:
    from distributed import Client

RETRIES = 3
"""So often a run is given to another worker where one died of it."""
CONNECT_S = 30.0


def evaluated(
    folders: Sequence[str], recall: Recall | None, scheduler: str | None
) -> Iterator[list[Row]]:
    """Yield the rows of each run as it is done, in any order.

    What a worker had in hand when it died another does again; a run that kills each of its workers
    has a row that says so. Raises InputError where no cluster answers.
    """
    for number, rows, error in each_done(rows_of_run, folders, scheduler, recall=recall):
        if error is not None:
            rows = [{"folder": folders[number], "error": f"no worker lived through it: {error}"}]
        yield rows


def each_done(
    function: Callable[..., Any], items: Sequence[Any], scheduler: str | None, **shared: object
) -> Iterator[tuple[int, Any, BaseException | None]]:
    """Call a function with each item and what all share; yield in any order what comes of it.

    That is the item's number, what was returned, and the error that ended it instead.
    """
    refuse_without_packages()
    from distributed import as_completed

    with _client(scheduler) as client:
        futures = client.map(function, items, **shared, retries=RETRIES, pure=False)
        numbers = {future.key: number for number, future in enumerate(futures)}
        for future in as_completed(futures):
            error = future.exception()
            yield numbers[future.key], None if error else future.result(), error


def refuse_without_packages() -> None:
    """Raise InputError where a package of the extra `cluster` is not installed."""
    for package in ("distributed", "pyarrow"):
        if find_spec(package) is None:
            raise InputError(
                f"there is no {package}, on which many runs, and trials, are evaluated; install it "
                "with `pip install inertial-station[cluster]`"
            )


@contextmanager
def _client(scheduler: str | None) -> Iterator[Client]:
    from distributed import Client, LocalCluster

    if scheduler is None:
        with (
            LocalCluster(threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            yield client
        return
    try:
        with Client(scheduler, timeout=CONNECT_S) as client:
            yield client
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {scheduler} ({error}); start one with `dask scheduler`, "
            "and workers that see the store at the same path"
        ) from error
