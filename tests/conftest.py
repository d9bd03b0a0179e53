"""What tests stand on: a state folder of their own, where no test knows of another; a bench."""

from __future__ import annotations

import atexit
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from station.cli import ONE_BLAS_THREAD

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # Started in the background of a shell: the runs of the tests are to hear Ctrl-C all the same.
    signal.signal(signal.SIGINT, signal.default_int_handler)
os.environ.update(ONE_BLAS_THREAD)  # as a run has it; NumPy reads it when it is first imported
if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
    # The code's folders stay as they are; yet of hundreds of processes only the first compiles.
    COMPILED = tempfile.mkdtemp(prefix="station-tests-compiled-")
    os.environ["PYTHONPYCACHEPREFIX"] = COMPILED
    atexit.register(shutil.rmtree, COMPILED, ignore_errors=True)
IN_MEMORY = Path("/dev/shm")
ROOM_BYTES = 6 * 2**30
if (
    "PYTEST_DEBUG_TEMPROOT" not in os.environ
    and IN_MEMORY.is_dir()
    and shutil.disk_usage(IN_MEMORY).free > ROOM_BYTES
    and not os.statvfs(IN_MEMORY).f_flag & os.ST_NOEXEC
):
    # A run waits for the disk some 70 times. What a disk can do, small disks of their own show.
    os.environ["PYTEST_DEBUG_TEMPROOT"] = str(IN_MEMORY)


@pytest.fixture(autouse=True, scope="session")
def state_folder_of_the_tests(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keep what the station remembers between runs away from the user's own folder."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("state")
        patch.setenv("XDG_STATE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session")
def one_axis_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of one axis, for tests that look at it or change a copy of it."""
    from campaign_helpers import finished_run

    return finished_run(tmp_path_factory.mktemp("one-axis"), ["IA"])


@pytest.fixture
def clock() -> Any:
    """A virtual clock."""
    from station.clock import VirtualClock

    return VirtualClock()


@pytest.fixture
def bench(clock: Any) -> Iterator[Any]:
    """The bench of the tests of simulators, served on virtual time."""
    from sim_bench import served

    with served(clock) as simulation:
        yield simulation


@pytest.fixture
def board(bench: Any, clock: Any) -> Iterator[Any]:
    """A raw client of that bench's pulse board."""
    from sim_bench import Frames

    with Frames(bench, clock) as client:
        yield client


@pytest.fixture(scope="session")
def run_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The finished run of a procedure's plan in its short form, made once; not to be changed."""
    from short_forms import SHORT_FORMS

    from station.cli.validating import read_bench_named, read_plan_for
    from station.runner.execute import Request, execute

    made: dict[str, Path] = {}

    def run(name: str) -> Path:
        if name not in made:
            bench = read_bench_named("sim")
            plan = read_plan_for(name, bench, SHORT_FORMS[name])
            place = tmp_path_factory.mktemp(name)
            made[name] = execute(Request(plan, bench, place, quiet=True, report=False)).folder
        return made[name]

    return run
